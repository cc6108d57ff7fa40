"""The command line: files, exit status, and one sentence for each mistake."""

import hashlib
import json
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePid
from lxml import etree
from numpy.typing import NDArray

import plants
from cosim.cli import main
from cosim.master.simulation import Simulation
from cosim.master.ticks import Ticks
from cosim.plant.fleet import Fleet
from cosim.results.files import load
from cosim.scenario.grammar import NAMESPACE
from cosim.tests.driving import SHORT

from .commands import failed

# What works -------------------------------------------------------------------------------------------------


def test_run_writes_result_summary_and_figure(line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", line, "--out", str(tmp_path), "--timing"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert "\x1b[" not in printed.out
    assert "holds  rms range_error" in printed.out
    assert "loop, per later tick" in printed.out
    folder = tmp_path / "clmr_line"
    assert sorted(path.name for path in folder.iterdir()) == ["figure.png", "report.html", "result.nc", "summary.json"]
    assert (folder / "figure.png").read_bytes().startswith(b"\x89PNG")
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["passed"]
    assert len(summary["followers"]) == 4

    result = load(folder / "result.nc")
    assert result.sizes["time"] == 5001
    assert result["robot"].values.tolist() == [f"follower_{i}" for i in (1, 2, 3, 4)]
    assert result["pose_component"].values.tolist() == ["x", "y", "psi", "gamma"]
    promised = {"pose", "measured_pose", "torque", "range", "bearing", "range_error", "bearing_error", "leader_pose"}
    assert promised | {"leader_velocity", "weight_norm"} <= set(result.data_vars)
    for name, variable in result.data_vars.items():
        assert variable.attrs["units"], name
        assert variable.attrs["long_name"], name
    assert result.attrs["scenario"] == Path(line).read_text(encoding="utf-8")
    assert result.attrs["seed"] == "1"
    fmu = json.loads(result.attrs["plants"])["clmr"]
    assert len(fmu["sha256"]) == 64
    assert fmu["generation_tool"].startswith("Formation")
    (controller,) = json.loads(result.attrs["controllers"])
    assert controller["package"] == "formation-controllers"
    assert json.loads(result.attrs["versions"])["fmpy"] == fmpy.__version__


def test_an_expectation_that_fails(line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["run", line, "--out", str(tmp_path), "--no-figure", *SHORT]
    assert main(arguments) == 1
    assert "FAILS  rms range_error" in capsys.readouterr().out
    assert not json.loads((tmp_path / "clmr_line" / "summary.json").read_text())["passed"]


def test_overrides(line: str, tmp_path: Path) -> None:
    fmu = plants.build("car_like", out=tmp_path)
    with zipfile.ZipFile(fmu, "a") as archive:
        archive.writestr("documentation/mine.txt", "another FMU than the built-in one")
    arguments = ["run", line, "--out", str(tmp_path), "--no-figure", "--seed", "5", "--plant", f"clmr={fmu}", *SHORT]
    assert main([*arguments, "--controller", "pid=neural-adaptive-pid"]) == 1
    result = load(tmp_path / "clmr_line" / "result.nc")
    assert result.attrs["seed"] == "5"
    assert json.loads(result.attrs["plants"])["clmr"]["sha256"] == hashlib.sha256(fmu.read_bytes()).hexdigest()
    for piece in ('horizon="1 s"', 'seed="5"', f'fmu="{fmu}"'):
        assert piece in result.attrs["scenario"], "the text that is kept is the text that was run"
    told = json.loads((tmp_path / "clmr_line" / "summary.json").read_text())["changes"]
    options = ["--seed 5", f"--plant clmr={fmu}", "--controller pid=neural-adaptive-pid", "--horizon '1 s'"]
    assert told[len(SHORT) - 1 :] == options


@pytest.mark.parametrize("law", ["feedback-linearisation", "lqg", "neural-high-gain", "observer-pid"])
def test_every_law_keeps_the_formation(line: str, tmp_path: Path, law: str) -> None:
    """At its default gains, with noise: the expectations of the scenario hold for the baselines too."""
    arguments = ["run", line, "--out", str(tmp_path), "--no-figure", "--controller", f"pid={law}"]
    assert main(arguments) == 0
    result = load(tmp_path / "clmr_line" / "result.nc")
    assert json.loads(result.attrs["controllers"])[0]["name"] == law
    assert f'name="{law}"' in result.attrs["scenario"]


def test_a_figure_of_an_earlier_run_does_not_stay(line: str, tmp_path: Path) -> None:
    stale = tmp_path / "clmr_line" / "figure.png"
    stale.parent.mkdir()
    stale.touch()
    main(["run", line, "--out", str(tmp_path), "--no-figure", *SHORT])
    assert not stale.exists()


def test_one_bad_scenario_does_not_stop_the_others(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    printed = failed(capsys, 2, "run", "none.xml", line, "--out", str(tmp_path), "--no-figure", *SHORT)
    assert printed == "none.xml: error: there is no such file\n"
    assert (tmp_path / "clmr_line" / "result.nc").exists()


def test_check(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", line]) == 0
    assert "clmr_line, 4 followers, 100 s in 5000 steps" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["run", "check"])
def test_an_error_of_one_of_several_scenarios_names_its_file(
    scenarios: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    files = [str(scenarios / name) for name in ("clmr_line.xml", "mixed_team.xml")]
    printed = failed(capsys, 2, command, *files, "--set", "//nowhere/@x=1")
    said = "error: --set //nowhere/@x=1: '//nowhere/@x' selects nothing in the scenario"
    assert printed.splitlines() == [f"{file}: {said}" for file in files]
    assert failed(capsys, 2, command, files[0], "--set", "//nowhere/@x=1") == f"{said}\n"


def test_a_time_beyond_the_end_of_several_runs(line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "other.xml"
    other.write_text(Path(line).read_text(encoding="utf-8").replace('name="clmr_line"', 'name="other"'))
    printed = failed(capsys, 2, "run", line, str(other), "--until", "2 s", "--out", str(tmp_path), *SHORT)
    told = "error: --until 2 s: expected a time after 0 s and not after the end at 1 s"
    assert printed.splitlines() == [f"{file}: {told}" for file in (line, other)]


def test_build(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["build", "--out", str(tmp_path)]) == 0
    built = [Path(path) for path in capsys.readouterr().out.split()]
    assert [path.stem for path in built] == list(plants.models())
    for path in built:
        fmpy.read_model_description(str(path))


def test_build_for_fmi_3(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["build", "car_like", "--fmi", "3", "--out", str(tmp_path)]) == 0
    path = capsys.readouterr().out.strip()
    assert fmpy.read_model_description(path).fmiVersion.startswith("3.")


def test_build_for_an_unknown_platform(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    printed = failed(capsys, 2, "build", "--platform", "amiga", "--out", str(tmp_path))
    assert "the platform 'amiga' is not known; choose from" in printed


def test_list(scenarios: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(scenarios.parent)
    assert main(["list"]) == 0
    printed = capsys.readouterr().out
    for name in ("car_like", "neural-adaptive-pid", "formation-controllers", "clmr_line.xml"):
        assert name in printed
    (path,) = (line.split(": ", 1)[1] for line in printed.splitlines() if line.startswith("Schema"))
    assert etree.parse(path).getroot().get("targetNamespace") == NAMESPACE


def test_the_command_is_installed() -> None:
    command = Path(sys.executable).with_name("formation")
    printed = subprocess.run([command, "--version"], capture_output=True, text=True, check=True, timeout=60).stdout
    assert printed.startswith("formation-cosim ")


# Bad input --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ["--set", "//controller/@name=neural-pid"],
            "did you mean 'neural-adaptive-pid'? Known: feedback-linearisation, lqg, neural-",
        ),
        (["--set", "//controller/@version=>=99"], "needs formation-controllers >=99, but version"),
        (["--set", "//controller/@version=new"], 'version="new" is no version range'),
        (["--set", "//controller/@package=other"], "from the package formation-controllers, not from other"),
        (["--set", "//gain[1]/@name=K_P"], "did you mean 'K_p'?"),
        (["--set", "//gain[1]/@value=-1"], "gain 'K_p' is -1: must be greater than 0"),
        (["--set", "//plant/@model=car_lke"], "did you mean 'car_like'?"),
        (["--set", "//parameter[@name='m_c']/@value=-30 kg"], "parameter m_c of car_like.fmu: -30 kg is out of bounds"),
        (["--set", "//parameter[@name='m_c']/@name=mass"], "has no parameter 'mass'"),
        (["--set", "//rms[1]/@signal=range_eror"], "did you mean 'range_error'?"),
        (["--set", "//rms[1]/@below=1 s"], "cannot convert"),
        (["--plant", "car=x.fmu"], "has no plant 'car'"),
        (["--plant", "clmr=none.fmu"], "error: --plant clmr=none.fmu: there is no such file"),
        (["--plant", "clmr=car_like"], '"formation build car_like" makes the FMU of the built-in model'),
        (["--binding", "clmr=none.xml"], "error: --binding clmr=none.xml: there is no such file"),
        (["--plant", "clmr"], "--plant clmr: expected ID=FMU"),
        (["--controller", "pid=none"], "no installed package offers a controller 'none'"),
        (["--seed", "-1"], 'seed="-1" of <simulation> is not a whole number'),
        (
            ["--controller", "pid=lqg", "--controller", "pid=none"],
            "pid=none: pid is given twice, first as lqg: give it",
        ),
    ],
)
def test_bad_input(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], sentence: str
) -> None:
    printed = failed(capsys, 2, "run", line, "--out", str(tmp_path), *arguments)
    assert sentence in printed
    if arguments[0] == "--set":
        assert printed.startswith(f"{line}:"), "an error in the scenario names its place"
    assert not list(tmp_path.glob("*/result.nc"))


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--seed", "1", "--seed", "2"], "argument --seed: is given twice, as 1 and as 2: give it once"),
        (["--seed=1", "--seed=1"], "argument --seed: is given twice"),
        (["--no-fig"], "unknown option --no-fig: did you mean '--no-figure'? Known: --binding, "),
        (["--se=1"], "unknown option --se: did you mean '--set'?"),
        (["--verbose"], "unknown option --verbose: "),
    ],
)
def test_options_are_taken_as_they_are_written_or_refused(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], sentence: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["run", line, "--out", str(tmp_path), *arguments])
    assert ended.value.code == 2
    assert sentence in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_two_scenarios_of_one_name(line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    printed = failed(capsys, 2, "run", line, line, "--out", str(tmp_path), "--no-figure", *SHORT)
    assert "are both named 'clmr_line'" in printed
    assert failed(capsys, 2, "check", line, line) == printed


def test_no_compiler(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("FORMATION_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setitem(sys.modules, "ziglang", None)
    printed = failed(capsys, 2, "run", line, "--out", str(tmp_path))
    assert printed.startswith(f"{line}:13:3: error: there is no C compiler")
    assert "sudo apt install gcc" in printed


@pytest.mark.parametrize("command", ["run", "build"])
def test_a_folder_that_cannot_be_written(
    command: str, line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file"
    file.touch()
    arguments = [line] if command == "run" else []
    printed = failed(capsys, 2, command, *arguments, "--out", str(file / "results"))
    assert "cannot" in printed
    assert "writ" in printed
    assert f"{file} is no folder" in printed or "Not a directory" in printed


def test_a_disk_that_fills_up_loses_nothing(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The folder becomes a file while the run goes on."""
    out = tmp_path / "runs"
    original = Simulation.run_to_end

    def run_and_take_the_folder_away(self: Simulation, *_: object) -> object:
        (out / "clmr_line").rmdir()
        (out / "clmr_line").touch()
        return original(self)

    monkeypatch.setattr(Simulation, "run_to_end", run_and_take_the_folder_away)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    printed = failed(capsys, 2, "run", line, "--out", str(out), "--no-figure", *SHORT)
    assert "cannot be written" in printed
    kept = Path(printed.strip().rsplit("kept in ", 1)[1])
    assert load(kept).sizes["time"] == 51


# Runs that fail ---------------------------------------------------------------------------------------------


def test_a_run_that_diverges(line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A mass so small that explicit Euler at 20 ms is unstable."""
    light = ["--set", "//parameter[@name='m_c']/@value=0.01 kg", "--no-figure"]
    printed = failed(capsys, 3, "run", line, "--out", str(tmp_path), *light)
    assert "error: " in printed
    assert "at t = " in printed
    result = load(tmp_path / "clmr_line" / "result.nc")
    assert result.attrs["status"] == "incomplete"
    assert result.sizes["time"] > 1
    time = float(printed.split("at t = ")[1].split(" s")[0])
    assert result["time"].values[-1] <= time < 100
    assert json.loads((tmp_path / "clmr_line" / "summary.json").read_text())["status"] == "incomplete"


def test_a_controller_that_raises(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    original = NeuralAdaptivePid.on_step
    ticks = iter(range(100))

    def fails_at_tick_20(self: NeuralAdaptivePid, *arguments: object) -> object:
        if next(ticks) == 20:
            raise ZeroDivisionError("no such luck")
        return original(self, *arguments)

    monkeypatch.setattr(NeuralAdaptivePid, "on_step", fails_at_tick_20)
    printed = failed(capsys, 3, "run", line, "--out", str(tmp_path), "--no-figure", *SHORT)
    assert "follower_4 at t = 0.4 s: the controller 'neural-adaptive-pid' failed: ZeroDivisionError" in printed
    assert load(tmp_path / "clmr_line" / "result.nc").sizes["time"] == 20


def test_a_plant_that_fails(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A leader's torque that is not a number, from the third tick on."""

    original = Fleet.step

    def breaks(fleet: Fleet, tick: int, step: float, given: NDArray[np.float64]) -> None:
        if tick == 3:
            given[1] = np.nan
        original(fleet, tick, step, given)

    monkeypatch.setattr(Fleet, "step", breaks)
    monkeypatch.setattr("cosim.master.ticks.Ticks.some", lambda ticks, most: False)
    printed = failed(capsys, 3, "run", line, "--out", str(tmp_path), "--no-figure", *SHORT)
    assert "leader at t = 0.06 s: the plant car_like.fmu did not " in printed
    assert "tau_steer" in printed
    assert load(tmp_path / "clmr_line" / "result.nc").sizes["time"] == 4


def test_ctrl_c_keeps_what_was_recorded(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    original = Ticks.some

    def some(self: Ticks, most: int) -> bool:
        if self.tick == 30:
            signal.raise_signal(signal.SIGINT)
        return original(self, 1)

    monkeypatch.setattr(Ticks, "some", some)
    printed = failed(capsys, 130, "run", line, "--out", str(tmp_path), "--no-figure", *SHORT)
    assert "interrupted" in printed
    result = load(tmp_path / "clmr_line" / "result.nc")
    assert result.sizes["time"] == 31, "the tick in which the signal came is finished"
    assert result.attrs["status"] == "incomplete"
