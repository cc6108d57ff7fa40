"""A new user's start: in Python, at the command line, and in an installed wheel without the checkout."""

import pydoc
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import cosim
from cosim.cli import _COMMANDS, _function, main
from cosim.cli.completing import SHELLS
from cosim.cli.help_texts import _EXAMPLES
from cosim.results.expectations import understood
from cosim.scenario.examples import examples
from cosim.scenario.reader import read_scenario

ROOT = Path(__file__).parents[1]


# Python -----------------------------------------------------------------------------------------------------


def test_the_package_shows_what_it_offers() -> None:
    assert {name for name in dir(cosim) if not name.startswith("__")} == set(cosim.__all__)
    shown = pydoc.plaintext.document(cosim)
    for name in cosim.__all__:
        assert f"class {name}(" in shown or f"    {name}(" in shown, name


def test_the_package_is_a_command() -> None:
    printed = subprocess.run(
        [sys.executable, "-m", "cosim", "--version"], capture_output=True, text=True, check=True, timeout=60
    )
    assert printed.stdout.startswith("formation-cosim ")


def test_a_wheel_has_types_and_scenarios(tmp_path: Path, scenarios: Path) -> None:
    pytest.importorskip("hatchling")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True, timeout=120)
    (wheel,) = tmp_path.glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    assert {"cosim/py.typed", "plants/py.typed", "cosim/__main__.py", "cosim/schema/scenario-1.xsd"} <= names
    assert {f"cosim/scenarios/{path.name}" for path in scenarios.glob("*.xml")} <= names
    assert not [name for name in names if "/tests/" in name or name.startswith("scenarios/")]


def test_an_installed_package_finds_the_scenarios_within_itself(
    tmp_path: Path, scenarios: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cosim.scenario.examples._PACKAGE", tmp_path / "cosim")
    assert examples() == ()
    shutil.copytree(scenarios, tmp_path / "cosim" / "scenarios", ignore=shutil.ignore_patterns("__pycache__"))
    assert tmp_path / "cosim" / "scenarios" / "clmr_line.xml" in examples()


# formation new ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("vehicle", ["car_like", "tractor_trailer"])
def test_a_new_scenario_runs_and_holds(
    vehicle: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", "mine.xml", "--vehicle", vehicle, "--followers", "3"]) == 0
    assert capsys.readouterr().out == "wrote mine.xml\nnext: formation run mine.xml\n"
    text = Path("mine.xml").read_text(encoding="utf-8")
    assert text.count("<!--") > 5
    assert max(map(len, text.splitlines())) <= 120
    scenario = read_scenario("mine.xml")
    assert (scenario.name, len(scenario.followers)) == ("mine", 3)
    assert main(["run", "mine.xml", "--no-figure"]) == 0


@pytest.mark.parametrize("followers", [1, 2, 50])
def test_a_new_scenario_of_any_size(followers: int, tmp_path: Path) -> None:
    path = tmp_path / "mine.xml"
    assert main(["new", str(path), "--followers", str(followers)]) == 0
    assert len(read_scenario(path).followers) == followers


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["mine"], "error: mine: name a file that ends in .xml, such as mine.xml"),
        (
            ["my scenario.xml"],
            "error: my scenario.xml: the file's name becomes the scenario's name: use at most 100 letters, digits, '_'",
        ),
        (["x" * 101 + ".xml"], "use at most 100 letters"),
        (["there.xml"], "error: there.xml exists: --force overwrites"),
        (["none/mine.xml"], "none/mine.xml cannot be written: No such file"),
        (["mine.xml", "--followers", "0"], "--followers 0: expected a number from 1 to 50"),
        (["mine.xml", "--followers", "51"], "--followers 51: expected a number from 1 to 50"),
    ],
)
def test_a_new_scenario_that_cannot_be(
    arguments: list[str],
    sentence: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("there.xml").write_text("mine")
    assert main(["new", *arguments]) == 2
    assert sentence in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["there.xml"]
    assert main(["new", "there.xml", "--force"]) == 0


# formation examples, formation list -------------------------------------------------------------------------


def test_the_examples_are_whole_in_another_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "a" / "b"
    assert main(["examples", str(folder)]) == 0
    printed = capsys.readouterr().out
    count = len(list(folder.glob("*.xml")))
    assert printed == f"{count} scenarios in {folder}\nnext: formation run {folder / 'clmr_line.xml'}\n"
    for path in folder.glob("*.xml"):
        scenario = read_scenario(path)  # of a variant, its base as well
        for expectation in scenario.expectations:
            assert all(other.exists() for other in understood(expectation).others)


def test_examples_that_were_changed_are_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for _ in range(2):
        assert main(["examples", str(tmp_path)]) == 0
    mine, other = tmp_path / "convoy.xml", tmp_path / "clmr_line.xml"
    mine.write_text("mine")
    other.unlink()
    assert main(["examples", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"error: {mine} exists: --force overwrites\n"
    assert not other.exists(), "all or none"
    assert main(["examples", str(tmp_path), "--force"]) == 0
    assert read_scenario(mine).name == "convoy"
    assert main(["examples", str(mine)]) == 2
    assert f"{mine} cannot be made: File exists" in capsys.readouterr().err


def test_the_list_without_scenarios_shows_those_that_come_along(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["list"]) == 0
    printed = capsys.readouterr().out
    assert "Scenarios that come with Formation" in printed
    assert "clmr_line.xml" in printed
    assert '"formation examples" copies them to scenarios/' in printed
    assert main(["examples"]) == 0
    assert main(["list"]) == 0
    assert "Scenarios in scenarios/" in capsys.readouterr().out


# --help and completion --------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["", *_EXAMPLES])
def test_help_has_examples_and_the_exit_status(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([*command.split(), "--help"])
    assert ended.value.code == 0
    printed = capsys.readouterr().out
    assert f"  formation {command}" in printed.split("examples:" if command else "start:")[1]
    assert "exit status:\n  0    " in printed
    assert "  2    bad input" in printed


@pytest.mark.parametrize("command", _COMMANDS)
def test_every_command_has_its_function_and_its_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert callable(_function(command))
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    assert command in capsys.readouterr().out.partition("commands:")[2].split()


@pytest.mark.parametrize("shell", SHELLS)
def test_completion(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("shtab")
    assert main(["completion", shell]) == 0
    printed = capsys.readouterr().out
    for word in ("compare-plants", "no-figure", "tractor_trailer"):
        assert word in printed


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_files_by_their_ending(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("shtab")
    assert main(["completion", "bash"]) == 0
    for name in ("mine.xml", "mine.fmu", "mine.txt"):
        (tmp_path / name).touch()
    words = ("formation", "run", "mi")
    script = f"COMP_WORDS=({' '.join(words)}); COMP_CWORD=2; _shtab_formation mi; echo ${{COMPREPLY[*]}}"
    command = ["bash", "-c", capsys.readouterr().out + "\n" + script]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.strip() == "mine.xml"


def test_completion_without_its_library(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert main(["completion", "bash"]) == 2
    assert "error: completion needs the package shtab; install it: python -m pip install" in capsys.readouterr().err
