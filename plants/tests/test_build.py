"""Building: the cache, reproducible bytes, a user's own model, and faults of a machine."""

import errno
import json
import math
import os
import re
import stat
import subprocess
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import fmpy
import fmpy.validation
import numpy as np
import pytest
import sympy

import plants
from plants import numeric
from plants.factory import compile, platforms
from plants.factory.generate import generate
from plants.ode import Limit, OdeModel, Output, State, Terminal

from .test_models import rate, s, spring


def python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run code in a new interpreter."""
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=os.environ | environment, check=False
    )


def test_models_are_listed() -> None:
    models = plants.models()
    assert "car_like" in models
    assert all(text and "\n" not in text for text in models.values())
    for name in models:
        model = plants.load(name)
        assert (model.name, model.description) == (name, models[name])


def test_unknown_model_names_the_nearest_and_the_known() -> None:
    for call in (plants.load, plants.build):
        with pytest.raises(
            plants.UnknownModel, match=r"no plant model 'car_lik'; did you mean 'car_like'\? known: car_like"
        ):
            call("car_lik")


def test_a_second_build_loads_nothing(fmu: Path) -> None:
    result = python(
        "import json, sys, plants; path = plants.build('car_like'); plants.models();"
        "print(json.dumps([str(path), sorted(m for m in ('sympy', 'jinja2', 'fmpy', 'numpy') if m in sys.modules)]))"
    )
    assert json.loads(result.stdout) == [str(fmu), []]


def test_bytes_are_reproducible(tmp_path: Path) -> None:
    """Another process, another hash seed, another cache: the same bytes; both versions are compiled alike."""
    code = """
import plants
from plants.factory.generate import generate
print(plants.build("car_like", fmi="3.0"))
print(list(generate(plants.load("car_like"), "2.0").items()))
"""
    printed = python(code, FORMATION_CACHE=str(tmp_path), PYTHONHASHSEED="12345").stdout
    path, files = printed.splitlines()
    assert Path(path).is_relative_to(tmp_path)
    assert Path(path).read_bytes() == plants.build("car_like", fmi="3.0").read_bytes()
    assert files == str(list(generate(plants.load("car_like"), "2.0").items()))


DECAY = """
import plants, sympy
from plants.ode import OdeModel, State
x = sympy.Symbol("x")
decay = OdeModel("decay", "Decay", (State(x, "1", "x", start=1.0),), (-x,))
"""
"""A model that is built fast."""


@pytest.fixture(scope="module")
def decay() -> OdeModel:
    names: dict[str, Any] = {}
    exec(DECAY, names)
    model: OdeModel = names["decay"]
    return model


def test_processes_may_build_at_once(decay: OdeModel, tmp_path: Path) -> None:
    with ThreadPoolExecutor(2) as pool:
        code = f"{DECAY}print(plants.build(decay), end='')"
        runs = list(pool.map(lambda _: python(code, FORMATION_CACHE=str(tmp_path)), range(2)))
    assert {run.returncode for run in runs} == {0}
    (path,) = {Path(run.stdout) for run in runs}
    assert path.read_bytes() == plants.build(decay).read_bytes()
    assert {p for p in tmp_path.rglob("*") if p.is_file()} == {path, path.with_name("decay.fmu.sha256")}


def test_copy_to_a_folder_and_build_anew(decay: OdeModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORMATION_CACHE", str(tmp_path / "cache"))
    fmu = plants.build(decay)
    copy = plants.build(decay, out=tmp_path / "new" / "folder")
    assert copy == tmp_path / "new" / "folder" / "decay.fmu"
    assert copy.read_bytes() == fmu.read_bytes()
    before = fmu.stat().st_mtime_ns
    assert plants.build(decay) == fmu
    assert fmu.stat().st_mtime_ns == before
    assert plants.build(decay, cache=False) == fmu
    assert fmu.stat().st_mtime_ns > before


def test_own_model(tmp_path: Path) -> None:
    """A model that is not built in, with all that the car-like robot lacks: time, outputs, local states, pi."""
    model = spring()
    path = plants.build(model, out=tmp_path)
    assert path.name == "spring_mass.fmu"
    assert fmpy.validation.validate_fmu(str(path)) == []
    description = fmpy.read_model_description(path)
    assert [output.variable.name for output in description.outputs] == ["s", "energy"]
    values = {"s": 0.7, "rate": -0.2, "f": 2.0, "k": 3.0, "spring": 2, "solver": 2}
    result = fmpy.simulate_fmu(
        str(path),
        start_time=1.0,
        stop_time=1.1,
        output_interval=0.02,
        start_values=values,
        output=["s", "rate", "energy"],
    )
    functions = numeric.compile(model)
    x, u, p = np.array([0.7, -0.2]), np.array([2.0]), functions.parameters(k=3.0, spring="hardening")
    for k, row in enumerate(result):
        expected = [*x, *functions.outputs(0.0, x, u, p)]
        np.testing.assert_allclose([row["s"], row["rate"], row["energy"]], expected, rtol=1e-12)
        x = functions.rk4(1.0 + k * 0.02, x, u, p, 0.02)


def test_model_without_inputs_and_parameters(tmp_path: Path) -> None:
    x = sympy.Symbol("x")
    model = OdeModel("decay", 'A "quoted" <name> & 100 % */', (State(x, "1", "x", start=1.0),), (-x,))
    path = plants.build(model, out=tmp_path)
    assert fmpy.validation.validate_fmu(str(path)) == []
    assert fmpy.read_model_description(path).description == model.description
    result = fmpy.simulate_fmu(str(path), stop_time=0.04, output_interval=0.02)
    np.testing.assert_allclose(result["x"], [1.0, 0.98, 0.98**2], rtol=1e-14)


@pytest.mark.parametrize(
    "expression", [sympy.I, sympy.Piecewise((1, sympy.Symbol("x") > 0)), sympy.zeta(sympy.Symbol("x"))]
)
def test_what_c_cannot_compute_is_refused(expression: sympy.Expr) -> None:
    x = sympy.Symbol("x")
    with pytest.raises(plants.ModelError, match="model 'bad': "):
        plants.build(OdeModel("bad", "", (State(x, "1", ""),), (expression * x,)))


def test_description_and_c_come_from_the_model_alone(fmu: Path) -> None:
    """The FMU holds the files that the factory generates now, and two models have different GUIDs."""
    files = generate(plants.load("car_like"), "2.0")
    with zipfile.ZipFile(fmu) as archive:
        assert {name: archive.read(name) for name in files} == files
        assert {name for name in archive.namelist() if not name.startswith("binaries/")} == set(files)
    guid = fmpy.read_model_description(fmu).guid
    assert guid.encode() in files["sources/config.h"]
    assert guid.encode() not in generate(spring(), "2.0")["sources/config.h"]


def test_readme_examples_run_as_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = (Path(plants.__file__).parent / "README.md").read_text(encoding="utf-8")
    examples = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(examples) == 2
    for example in examples:
        exec(example, {})
    (path,) = tmp_path.rglob("*.fmu")
    assert fmpy.validation.validate_fmu(str(path)) == []
    result = fmpy.simulate_fmu(str(path), stop_time=2.0, start_values={"u": 2.0}, output=["v"])
    assert result["v"][-1] == pytest.approx(6.0, rel=1e-3)


# ---- what can go wrong ----


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"outputs": (Output(sympy.Symbol("y"), lambda x: x, "m", ""),)}, "is not an expression"),
        ({"outputs": (Output(sympy.Symbol("y"), "2 * s", "m", ""),)}, "'2 * s' is not an expression"),
        ({"outputs": (Output(sympy.Symbol("y"), sympy.Matrix([s, s]), "m", ""),)}, "is not an expression"),
        ({"outputs": (Output(sympy.Symbol("y"), s > 0, "m", ""),)}, "s > 0 is not an expression"),
        ({"derivatives": (rate, None)}, "None is not an expression"),
        ({"limits": (Limit(sympy.Symbol("z"), max=1.0),)}, "limit 'z' uses the undefined symbol 'z'"),
        ({"limits": (Limit(s, min=2.0, max=1.0),)}, "limit 's': its bounds are [2, 1], the first must be smaller"),
        ({"limits": (Limit(2 * s, max=1.0, unit="yard"),)}, "unit 'yard'"),
        ({"terminals": (Terminal("a pose", (s,)),)}, "terminal 'a pose' is not an FMI and C identifier"),
        ({"terminals": (Terminal("pose", (s,)), Terminal("pose", (s,)))}, "there are two terminals 'pose'"),
        ({"terminals": (Terminal("pose", (s, rate)),)}, "'rate' is neither an input nor an output"),
    ],
)
def test_wrong_models_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(plants.PlantError) as error:
        spring(**changes)
    assert message in str(error.value)


def test_what_has_no_derivative_is_refused() -> None:
    x = sympy.Symbol("x")
    with pytest.raises(plants.ModelError, match=r"gamma\(x\).* cannot be written in C"):
        plants.build(OdeModel("bad", "", (State(x, "1", ""),), (sympy.gamma(x),)))


def test_no_compiler(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(compile, "installed", lambda package: False)
    with pytest.raises(plants.NoCompiler, match="there is no C compiler") as error:
        plants.build("car_like")
    for system in ("Debian, Ubuntu", "Fedora", "macOS", "Windows"):
        assert system in str(error.value)
    monkeypatch.setenv("CC", "nonesuch -m32")
    with pytest.raises(plants.NoCompiler, match=r"that \$CC names, 'nonesuch', was not found"):
        plants.build("car_like")


def test_failing_compiler_is_heard(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    compiler = tmp_path / "broken cc"
    compiler.write_text("#!/bin/sh\necho 'fatal error: No space left on device' >&2\nexit 3\n")
    compiler.chmod(compiler.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("CC", f"'{compiler}'")
    told = r"broken cc.* failed \(status 3\):\nfatal error: No space left on device"
    with pytest.raises(plants.BuildError, match=told) as failed:
        plants.build("car_like")
    assert isinstance(failed.value.__cause__, OSError)  # no fault of the sources
    assert failed.value.__cause__.errno == errno.ENOSPC


def test_folders_that_cannot_be_written(fmu: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("not a folder")
    with pytest.raises(plants.BuildError, match=r"cannot write .*file/car_like.fmu: "):
        plants.build("car_like", out=file)
    monkeypatch.setenv("FORMATION_CACHE", str(file))
    with pytest.raises(plants.BuildError, match="FORMATION_CACHE"):
        plants.build("car_like")


def test_other_versions_of_fmi(fmu: Path) -> None:
    with pytest.raises(plants.BuildError, match=r"FMI 1.0 is not offered; choose 2.0 or 3.0"):
        plants.build("car_like", fmi="1.0")
    assert plants.build("car_like", fmi="2") == fmu
    assert plants.build("car_like", fmi="3") == plants.build("car_like", fmi="3.0") != fmu


def test_platforms_that_cannot_be(monkeypatch: pytest.MonkeyPatch) -> None:
    names = "linux-x86_64, linux-aarch64, windows-x86_64, macos-x86_64, macos-arm64"
    with pytest.raises(plants.BuildError, match=f"the platform 'solaris' is not known; choose from {names}, or all"):
        plants.build("car_like", platforms=["linux-x86_64", "solaris"])
    with pytest.raises(plants.BuildError, match="no platform is named"):
        plants.build("car_like", platforms=[])
    with pytest.raises(plants.BuildError, match=r"FMI 2.0 has one folder, linux64, for both"):
        plants.build("car_like", platforms=["linux-x86_64", "linux-aarch64"])
    monkeypatch.setattr(compile, "installed", lambda package: False)
    with pytest.raises(plants.NoCompiler, match=r'pip install "formation-cosim\[cross\]"'):
        plants.build("car_like", platforms="windows-x86_64")
    monkeypatch.setattr(platforms, "PLATFORMS", {})
    with pytest.raises(plants.BuildError, match="cannot build for this machine"):
        platforms.host()


@pytest.mark.skipif(not compile.installed("ziglang"), reason="needs the Python package ziglang: the extra 'cross'")
@pytest.mark.parametrize(("fmi", "wanted"), [("2.0", {"linux-x86_64", "macos-x86_64", "macos-arm64"}), ("3.0", "all")])
def test_all_platforms(decay: OdeModel, fmi: str, wanted: str | set[str], tmp_path: Path) -> None:
    """Binaries of the right kind for all platforms, the same bytes twice; this machine's runs.

    Both versions are compiled alike. They differ in their folders; that of macOS in FMI 2.0 is for two processors.
    """
    path = plants.build(decay, fmi=fmi, platforms=wanted, out=tmp_path)
    elf, pe, macho = b"\x7fELF\x02\x01", b"MZ", b"\xcf\xfa\xed\xfe"
    kinds = {
        "2.0": {"linux64/decay.so": elf, "darwin64/decay.dylib": b"\xca\xfe\xba\xbe\0\0\0\x02"},
        "3.0": {
            "x86_64-linux/decay.so": elf,
            "aarch64-linux/decay.so": elf,
            "x86_64-windows/decay.dll": pe,
            "x86_64-darwin/decay.dylib": macho + b"\x07\0\0\x01",
            "aarch64-darwin/decay.dylib": macho + b"\x0c\0\0\x01",
        },
    }[fmi]
    with zipfile.ZipFile(path) as archive:
        found = {n.removeprefix("binaries/"): archive.read(n) for n in archive.namelist() if n.startswith("binaries/")}
    assert set(found) == set(kinds)
    assert all(found[name].startswith(kind) for name, kind in kinds.items())
    machine = {"x86_64": 62, "aarch64": 183}
    for name, content in found.items():
        if name.endswith(".so"):
            assert content[18] == machine[name.partition("-")[0].replace("linux64/decay.so", "x86_64")]
    if platforms.host().folder(fmi) + "/decay.so" in found:
        result = fmpy.simulate_fmu(str(path), stop_time=0.04, output_interval=0.02)
        np.testing.assert_allclose(result["x"], [1.0, 0.98, 0.98**2], rtol=1e-14)
    content = path.read_bytes()
    assert plants.build(decay, fmi=fmi, platforms=wanted, cache=False).read_bytes() == content


def test_what_all_platforms_are() -> None:
    """FMI 2.0 has one folder for both kinds of Linux, and so holds the more frequent one."""
    folders = {fmi: {p.name: p.folder(fmi) for p in platforms.choose("all", fmi)} for fmi in ("2.0", "3.0")}
    assert (
        folders["2.0"].keys()
        == folders["3.0"].keys() - {"linux-aarch64"}
        == set(platforms.PLATFORMS) - {"linux-aarch64"}
    )
    assert folders["2.0"]["windows-x86_64"] == "win64"


def test_without_a_cache_an_fmu_can_still_be_built_elsewhere(
    decay: OdeModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("FORMATION_CACHE", str(tmp_path / "file" / "cache"))
    path = plants.build(decay, out=tmp_path / "out")
    assert path == tmp_path / "out" / "decay.fmu"
    assert fmpy.read_model_description(path).modelName == "decay"
    with pytest.raises(plants.BuildError, match="FORMATION_CACHE"):
        plants.build(decay)


def test_start_values_of_ones_own_are_those_of_the_fmu_and_of_its_binary(tmp_path: Path) -> None:
    fmu = plants.build("car_like", starts={"x": 3.0, "drive": "rear_wheel", "m_c": 30.0, "tolerance": 1e-9})
    description = fmpy.read_model_description(fmu)
    starts = {v.name: v.start for v in description.modelVariables}
    assert (starts["x"], starts["m_c"]) == ("3.0", "30.0")
    assert float(description.defaultExperiment.tolerance) == 1e-9, "an importer would set the other one"
    result = fmpy.simulate_fmu(str(fmu), stop_time=0.02, output=["x", "m_c", "drive"])
    assert [result[name][0] for name in ("x", "m_c", "drive")] == [3.0, 30.0, int(starts["drive"])]
    assert int(starts["drive"]) > 1
    assert fmu != plants.build("car_like")


@pytest.mark.parametrize(
    ("starts", "why"),
    [
        ({"mass": 1.0}, "no state or parameter 'mass'"),
        ({"drive": "front"}, "drive has no item 'front'; it has as_printed"),
        ({"m_c": -1.0}, "m_c cannot start at -1.0"),
        ({"m_c": math.inf}, "m_c cannot start at inf"),
        ({"x": -math.inf}, "x cannot start at -inf"),
        ({"m_c": True}, "m_c cannot start at True"),
        ({"m_c": None}, "m_c cannot start at None"),
        ({"m_c": [1.0]}, r"m_c cannot start at \[1.0\]"),
        ({"m_c": np.array([1.0])}, r"m_c cannot start at array\(\[1.\]\)"),
        ({"m_c": np.array("1")}, r"m_c cannot start at array\('1'"),
        ({"m_c": np.bool_(True)}, r"m_c cannot start at "),
        ({"m_c": b"1"}, "m_c cannot start at b'1'"),
        ({"m_c": 1j}, "m_c cannot start at 1j"),
        ({"m_c": np.complex128(1)}, "m_c cannot start at "),
    ],
)
def test_a_start_value_that_does_not_fit_is_refused(starts: dict[str, float | str], why: str) -> None:
    with pytest.raises(plants.ModelError, match=why):
        plants.build("car_like", starts=starts)


@pytest.mark.parametrize(
    "value", [np.array(1.5), np.float32(1.5), Decimal("1.5"), Fraction(3, 2), sympy.Rational(3, 2), sympy.sqrt(9) / 2]
)
def test_a_start_value_may_be_a_number_of_any_kind(value: Any) -> None:
    assert generate(spring(), "2.0", {"s": value}) == generate(spring(), "2.0", {"s": 1.5})
    assert State(s, "m", "", start=value).start == 1.5


def test_a_start_value_cannot_contradict_the_assumptions_of_its_symbol() -> None:
    """SymPy takes |v| for v where v is positive. Zero is usual, at rest."""
    v = sympy.Symbol("v", positive=True)
    model = OdeModel("assumed", "", (State(v, "m/s", ""),), (-abs(v),))
    assert generate(model, "2.0", {"v": 0.0})
    with pytest.raises(plants.ModelError, match=r"v cannot start at -1\.0; its symbol is not negative"):
        generate(model, "2.0", {"v": -1.0})
