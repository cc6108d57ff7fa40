"""``--binding`` and ``--untrusted`` of ``run`` and ``check``."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cosim
import plants
from cosim.cli import main
from cosim.results.files import load
from cosim.scenario.edits import set_binding, set_fmu
from cosim.scenario.reader import read_scenario
from cosim.tests import driving

from .fmus import NAMES, renamed
from .stub.stub import make_fmu

ROLES = "".join(f'<role name="{role}" variable="{name}"/>' for role, name in NAMES.items() if role != "m_c")


def scenario(folder: Path, fmu: Path, inside: str = "", expect: str = "", name: str = "one.xml") -> Path:
    return driving.scenario(folder / name, f'<plant id="car" fmu="{fmu}">{inside}</plant>', horizon="2 s", more=expect)


def binding(path: Path, roles: str = ROLES) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text(f'<binding xmlns="urn:formation-cosim:scenario:1" vehicle="car_like">{roles}</binding>')
    return path


# --binding --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "inside", ["", f'<binding vehicle="car_like">{ROLES.replace("Chassis.yaw", "none")}</binding>']
)
def test_another_binding(tmp_path: Path, inside: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = scenario(tmp_path, renamed(tmp_path / "vendor.fmu"), inside)
    assert main(["check", str(path)]) == 2
    capsys.readouterr()
    option = ["--binding", f"car={binding(tmp_path / 'elsewhere' / 'b.xml')}"]
    assert main(["check", str(path), *option]) == 0
    assert main(["run", str(path), "--out", str(tmp_path), "--no-figure", *option]) == 0
    result = load(tmp_path / "one" / "result.nc")
    assert f'binding="{tmp_path / "elsewhere" / "b.xml"}"' in result.attrs["scenario"]
    assert '"psi": "Chassis.yaw"' in result.attrs["plants"]


def test_with_another_plant(tmp_path: Path) -> None:
    """Our robot under other names moves as it does."""
    path = scenario(tmp_path, plants.build("car_like"))
    changes = [set_fmu("car", renamed(tmp_path / "vendor.fmu")), set_binding("car", binding(tmp_path / "b.xml"))]
    np.testing.assert_array_equal(cosim.run(path)["pose"], cosim.run(path, changes)["pose"])


def test_a_parameter_that_another_plant_lacks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = scenario(tmp_path, plants.build("car_like"), '<parameter name="m_c" value="30 kg"/>')
    options = [f"--plant=car={renamed(tmp_path / 'vendor.fmu')}", f"--binding=car={binding(tmp_path / 'b.xml')}"]
    assert main(["check", str(path), *options]) == 2
    said = capsys.readouterr().err
    assert "the FMU vendor.fmu has no parameter 'm_c': " in said
    assert '"formation swap" writes a variant without the parts that an FMU lacks' in said


@pytest.mark.parametrize(
    ("option", "sentence"),
    [
        ("cat={good}", "the scenario has no plant 'cat': did you mean 'car'?"),
        ("car", "--binding car: expected ID=FILE.xml"),
        ("car={folder}/none.xml", "none.xml: there is no such file"),
        ("car={bad}", "has no variable 'Chassis.yaaw': did you mean 'Chassis.yaw'?"),
        ("car={open}", """open.xml:1:68: error: the role 'psi' has variable="...", which is to be filled in"""),
    ],
)
def test_bindings_that_do_not_fit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, sentence: str
) -> None:
    files = {
        "good": binding(tmp_path / "good.xml"),
        "bad": binding(tmp_path / "bad.xml", ROLES.replace("Chassis.yaw", "Chassis.yaaw")),
        "open": binding(tmp_path / "open.xml", '<role name="psi" variable="..."/>'),
    }
    path = scenario(tmp_path, renamed(tmp_path / "vendor.fmu"))
    assert main(["check", str(path), "--binding", option.format(folder=tmp_path, **files)]) == 2
    assert sentence in capsys.readouterr().err


# --untrusted ------------------------------------------------------------------------------------------------


def test_which_plants_are_untrusted(tmp_path: Path) -> None:
    path = scenario(tmp_path, tmp_path / "a" / "b" / "c.fmu")
    for folder, isolated in ((tmp_path, True), (tmp_path / "a", True), (tmp_path / "a" / "b" / ".." / "b", True)):
        assert read_scenario(path, untrusted=[folder]).plants["car"].isolated == isolated
    assert not read_scenario(path).plants["car"].isolated
    assert not read_scenario(path, untrusted=[tmp_path / "a" / "bb"]).plants["car"].isolated
    assert not read_scenario(path, ["//plant/@fmu=../x.fmu"], [tmp_path]).plants["car"].isolated
    assert read_scenario(path, untrusted=[tmp_path / "z", tmp_path / "a"]).plants["car"].isolated


def test_a_built_in_model_is_trusted(scenarios: Path) -> None:
    assert not read_scenario(scenarios / "clmr_line.xml", untrusted=["/"]).plants["clmr"].isolated


@pytest.mark.skipif(sys.platform == "win32", reason="needs symbolic links")
def test_a_link_into_an_untrusted_folder(tmp_path: Path) -> None:
    (tmp_path / "untrusted").mkdir()
    (tmp_path / "trusted").mkdir()
    fmu = make_fmu(tmp_path / "untrusted")
    (tmp_path / "trusted" / "link.fmu").symlink_to(fmu)
    path = scenario(tmp_path, tmp_path / "trusted" / "link.fmu")
    assert read_scenario(path, untrusted=[tmp_path / "untrusted"]).plants["car"].isolated


def test_a_crash_of_an_untrusted_plant_ends_only_the_run(tmp_path: Path) -> None:
    path = scenario(tmp_path, make_fmu(tmp_path / "fmus", behaviour="segfault", when=1.0))
    command = [str(Path(sys.executable).with_name("formation")), "run", str(path), "--out", str(tmp_path)]
    done = subprocess.run(
        [*command, "--untrusted", str(tmp_path / "fmus")], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 3, done.stderr
    assert "t = 1 s" in done.stderr
    assert load(tmp_path / "one" / "result.nc").sizes["time"] == 51


def test_plants_of_scenarios_to_compare_with_are_untrusted_too(tmp_path: Path) -> None:
    other = scenario(tmp_path, make_fmu(tmp_path / "fmus", behaviour="exit", when=1.0), name="other.xml")
    expect = f'<expect><compare measure="rms" signal="range_error" factor="2" scenario="{other}"/></expect>'
    path = scenario(tmp_path, make_fmu(tmp_path), expect=expect)
    command = [str(Path(sys.executable).with_name("formation")), "run", str(path), "--out", str(tmp_path)]
    done = subprocess.run(
        [*command, "--untrusted", str(tmp_path / "fmus")], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 1, done.stderr
    assert "the run of other.xml failed: " in done.stdout
    assert "exited with status 7" in done.stdout


def test_no_such_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = scenario(tmp_path, make_fmu(tmp_path))
    assert main(["check", str(path), "--untrusted", str(tmp_path / "none")]) == 2
    assert "none: there is no such folder" in capsys.readouterr().err


def test_a_folder_that_no_plant_lies_in(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = scenario(tmp_path, make_fmu(tmp_path / "here"))
    (tmp_path / "there").mkdir()
    for folder in ("here", "there"):
        assert main(["check", str(path), "--untrusted", str(tmp_path / folder)]) == 0
    assert capsys.readouterr().err == f"warning: --untrusted {tmp_path / 'there'}: no FMU of {path} is in this folder\n"
