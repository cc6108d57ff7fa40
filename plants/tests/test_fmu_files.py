"""The content of an FMU of either version: descriptions, images, documentation, sources that can be built."""

import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import fmpy
import fmpy.validation
import numpy as np
import pytest
from lxml import etree

import plants
from plants.factory.compile import compile_library, find_compiler
from plants.factory.platforms import host

from .fmus import MODELS, Fmu

# ---- descriptions ----


@pytest.mark.parametrize("name", MODELS)
def test_validation_is_silent(fmus: Callable, name: str, fmi: str) -> None:
    assert fmpy.validation.validate_fmu(str(fmus(name, fmi).path)) == []


def test_description_promises_what_is_there(car: Fmu, fmi: str) -> None:
    description = fmpy.read_model_description(car.folder)
    assert description.fmiVersion == fmi
    for interface in (description.modelExchange, description.coSimulation):
        assert interface.canGetAndSetFMUstate
        assert interface.canSerializeFMUstate
        assert fmi == "3.0" or interface.providesDirectionalDerivative
    assert description.coSimulation.canHandleVariableCommunicationStepSize
    assert description.coSimulation.canInterpolateInputs == (fmi == "2.0")
    if fmi == "3.0":
        root = etree.parse(car.folder / "modelDescription.xml")
        for element in ("ModelExchange", "CoSimulation"):
            assert root.find(element).get("providesDirectionalDerivatives") == "true"
            assert root.find(element).get("providesAdjointDerivatives") == "true"
    variables = {variable.name: variable for variable in description.modelVariables}
    if fmi == "3.0":
        assert (variables["time"].causality, variables["time"].unit) == ("independent", "s")
    else:
        assert "time" not in variables, "nothing depends on it, and FMI Library reports it as an error"
    assert variables["psi"].displayUnit == "deg"
    assert [v.valueReference for v in description.modelVariables] == list(range(len(variables)))
    assert {category.name for category in description.logCategories} == {
        "logEvents",
        "logStatusWarning",
        "logStatusDiscard",
        "logStatusError",
        "logAll",
    }
    names = [item.name for item in variables["at_singularity"].declaredType.items]
    assert names == ["warn", "stop"]


def test_files_of_the_standard_are_there_and_valid(fmus: Callable) -> None:
    two, three = fmus("many_functions", "2.0").folder, fmus("many_functions", "3.0").folder
    images = [two / "model.png", three / "terminalsAndIcons" / "icon.png"]
    assert all(image.read_bytes().startswith(b"\x89PNG\r\n\x1a\n") for image in images)
    etree.parse(three / "terminalsAndIcons" / "icon.svg")
    schemas = Path(fmpy.__file__).parent / "schema" / "fmi3"
    for schema, file in (
        ("fmi3TerminalsAndIcons.xsd", "terminalsAndIcons/terminalsAndIcons.xml"),
        ("fmi3BuildDescription.xsd", "sources/buildDescription.xml"),
    ):
        etree.XMLSchema(etree.parse(schemas / schema)).assertValid(etree.parse(three / file))
    members = etree.parse(three / "terminalsAndIcons" / "terminalsAndIcons.xml").findall(".//TerminalMemberVariable")
    assert [member.get("variableName") for member in members] == ["u", "x", "energy"]


def test_vehicles_have_their_terminals(fmus: Callable) -> None:
    for name in plants.models():
        tree = etree.parse(fmus(name, "3.0").folder / "terminalsAndIcons" / "terminalsAndIcons.xml")
        assert [t.get("name") for t in tree.findall(".//Terminal")] == ["pose", "velocity", "torque", "disturbance"]


@pytest.mark.parametrize("name", MODELS)
def test_documentation_stands_alone(fmus: Callable, name: str, fmi: str) -> None:
    page = (fmus(name, fmi).folder / "documentation" / "index.html").read_text(encoding="utf-8")
    assert "<script" not in page
    assert "src=" not in page
    assert "href=" not in page
    root = etree.HTML(page)
    model = MODELS[name]
    terms = [term for term in model.terms if term.equation or not term.expression.is_Function]
    assert name == "many_functions" or len(terms) < len(model.terms), "terms such as cos_psi are written out"
    equations = len(model.states) + len(terms) + len(model.outputs)
    assert len(root.findall(".//table[@class='equations']/tr")) == equations
    assert len(root.findall(".//math")) == 2 * equations + len(model.limits)
    text = " ".join(root.itertext())
    for variable in (*model.states, *model.inputs, *model.reals):
        assert variable.description in text


# ---- builds ----


@pytest.mark.skipif(shutil.which("cmake") is None, reason="FMPy rebuilds an FMU with CMake, which is not installed")
def test_fmu_can_be_rebuilt_from_its_own_sources(car: Fmu, tmp_path: Path) -> None:
    from fmpy.build import build_platform_binary

    shutil.copytree(car.folder, tmp_path / "fmu")
    shutil.rmtree(tmp_path / "fmu" / "binaries")
    (tmp_path / "cmake").mkdir()
    build_platform_binary(tmp_path / "fmu", tmp_path / "cmake", configuration="Release")
    results = [
        fmpy.simulate_fmu(str(folder), start_values={"tau_drive": 8.0, "gamma": 0.2})
        for folder in (car.folder, tmp_path / "fmu")
    ]
    np.testing.assert_allclose(results[1]["psi"], results[0]["psi"], rtol=1e-12)


@pytest.mark.parametrize("name", MODELS)
def test_c_has_no_warnings(fmus: Callable, fmi: str, name: str) -> None:
    root = fmus(name, fmi).folder
    sources = sorted(path.relative_to(root).as_posix() for path in root.glob("sources/*.c"))
    strict = (
        "-Werror",
        "-Wshadow",
        "-Wconversion",
        "-O1",
    )  # which follows values as well as -O3, in a third of its time
    assert compile_library(find_compiler(), host(), root, sources, name, strict)
    text = (root / "sources" / "model.c").read_text()
    assert "pow(" not in text.replace("pow(k, 3.0/2.0)", "").replace("pow(k, 1.0/2.0)", "")


@pytest.mark.skipif(sys.platform != "linux", reason="reads the symbols of an ELF library with nm")
def test_all_functions_of_the_standard_are_exported_and_no_data_is_writable(car: Fmu, fmi: str) -> None:
    prefix = f"fmi{fmi[0]}"
    header = (car.folder / "sources" / f"{prefix}Functions.h").read_text()
    declared = set(re.findall(rf"^\s*{prefix.upper()}_Export {prefix}\w+TYPE\s+({prefix}\w+);", header, re.MULTILINE))
    (binary,) = (car.folder / "binaries").glob("*/*")
    listing = subprocess.run(["nm", "-f", "sysv", binary], capture_output=True, text=True, check=True).stdout
    symbols = [[part.strip() for part in line.split("|")] for line in listing.splitlines() if line.count("|") == 6]
    assert len(declared) > 40
    assert {name for name, _, kind, *_ in symbols if kind == "T"} == declared
    # Only what the linker itself puts there.
    writable = {name for name, *_, section in symbols if section in (".data", ".bss")}
    assert {name for name in writable if not name.startswith(("_", "completed."))} == set()


def test_runtime_is_layered(fmus: Callable, fmi: str) -> None:
    """Model and solver know no FMI; the shared files know neither version nor model."""
    sources = {path.name: path.read_text() for path in (fmus("car_like", fmi).folder / "sources").iterdir()}
    for name, text in sources.items():
        if name in (
            *("model.c", "model.h", "config.h", "solver.c", "solver.h", "simulation.c", "simulation.h"),
            *("simulation_state.h", "values.c", "values.h", "variables.h"),
        ):
            assert "fmi2" not in text
            assert "fmi3" not in text
        if name.startswith("instance"):
            assert not re.search(r"fmi[23][A-Z]", text)
        if name not in ("model.c", "config.h", "buildDescription.xml"):
            assert not any(word in text for word in ("car_like", "tau_", "gamma", "m_c"))


@pytest.mark.parametrize("shortcut", ["-ffast-math", "-funsafe-math-optimizations", "-flto"])
def test_a_compiler_with_shortcuts_of_arithmetic_makes_the_same_library(
    car: Fmu, monkeypatch: pytest.MonkeyPatch, shortcut: str
) -> None:
    """With -ffast-math, sin(1.7) would be 1, and the library would flush small numbers of its whole process to zero."""
    of = (host(), car.folder, ["sources/model.c"], "model", ("-O1",))
    expected = compile_library(find_compiler(), *of)
    monkeypatch.setenv("CC", f"{shlex.join(find_compiler().command)} {shortcut}")
    assert compile_library(find_compiler(), *of) == expected


@pytest.mark.skipif(sys.platform == "win32", reason="a compiler that is a script")
def test_temporary_files_of_the_compiler_lie_in_the_folder_of_the_build(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So a compiler that is killed leaves nothing elsewhere."""
    elsewhere, compiler = tmp_path / "elsewhere", tmp_path / "compiler"
    elsewhere.mkdir()
    makes = 'case "$*" in *unit.c*) : > "$TMPDIR/temporary";; esac'
    compiler.write_text(f'#!/bin/sh\n{makes}\nexec {shlex.join(find_compiler().command)} "$@"\n')
    compiler.chmod(0o700)
    (tmp_path / "one.c").write_text("int one(void) { return 1; }\n")
    monkeypatch.setenv("CC", str(compiler))
    monkeypatch.setenv("TMPDIR", str(elsewhere))
    assert compile_library(find_compiler(), host(), tmp_path, ["one.c"], "one")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["compiler", "elsewhere", "one.c"]
    assert not list(elsewhere.iterdir())
