"""The files of a run: its changes, the reason of a failure, and the summary from them later."""

import json
import re
import shutil
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import cosim
import plants
from cosim.cli import main
from cosim.cli.console import out
from cosim.cli.earlier_results import label
from cosim.cli.summary import print_summary
from cosim.master.simulation import Simulation
from cosim.results.drawable_part import drawable
from cosim.results.figure import draw
from cosim.results.figure_panels import view
from cosim.results.files import load, save
from cosim.results.follower_figures import FollowerFigures
from cosim.results.panels import panels
from cosim.results.provenance import Provenance
from cosim.results.result import Result
from cosim.results.summary import Summary
from cosim.scenario.edits import in_words, set_binding, set_controller, set_fmu, set_seed, set_value

FILES = ["figure.png", "report.html", "result.nc", "summary.json"]


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory, scenarios: Path) -> str:
    """Return a copy of a scenario that runs for one second."""
    text = (scenarios / "clmr_line.xml").read_text(encoding="utf-8")
    for old, new in (
        ('horizon="100 s"', 'horizon="1 s"'),
        ('by="80 s"', 'by="0.5 s"'),
        ('from="80 s"', 'from="0.5 s"'),
    ):
        assert old in text
        text = text.replace(old, new)
    path = tmp_path_factory.mktemp("scenarios") / "clmr_line.xml"
    path.write_text(text, encoding="utf-8")
    return str(path)


@pytest.fixture(scope="module")
def ran(line: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run."""
    out = tmp_path_factory.mktemp("runs")
    assert main(["run", line, "--seed", "3", "--out", str(out)]) == 1
    return out / "clmr_line"


@pytest.fixture(scope="module")
def diverged(line: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run with a mass so small that explicit Euler is unstable."""
    out = tmp_path_factory.mktemp("diverged")
    assert main(["run", line, "--set", "//parameter[@name='m_c']/@value=0.01 kg", "--out", str(out)]) == 3
    return out / "clmr_line"


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Run a scenario without a figure and return its standard output."""
    assert main(["run", *arguments, "--no-figure"]) == 1
    return capsys.readouterr().out


# What was changed -------------------------------------------------------------------------------------------


def test_a_change_has_the_words_of_its_option(tmp_path: Path) -> None:
    changes = [
        set_value("//gain[@name='K_p']/@value=2"),
        set_seed(2),
        set_fmu("car", Path("my car.fmu")),
        set_binding("car", Path("car.xml")),
        set_controller("pid", "lqg", "formation-controllers", "0.1.0"),
    ]
    assert [in_words(change) for change in changes] == [
        "--set \"//gain[@name='K_p']/@value=2\"",
        "--seed 2",
        "--plant 'car=my car.fmu'",
        "--binding car=car.xml",
        "--controller pid=lqg",
    ]
    assert in_words(partial(partial(_nothing, about=1))) == "_nothing"


def _nothing(root: object, about: int) -> None:
    pass


def test_terminal_summary_result_and_figure_say_what_was_changed(
    line: str, ran: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    printed = run(capsys, line, "--seed", "3", "--out", str(tmp_path))
    assert "\nchanged by --seed 3\n" in printed
    assert "\nseed 3; formation-cosim 0." in printed
    summary = json.loads((ran / "summary.json").read_text())
    assert summary["changes"] == ["--seed 3"]
    assert summary["seed"] == 3
    assert summary["file"] == line
    assert {"formation-cosim", "formation-controllers", "numpy"} <= summary["versions"].keys()
    assert json.loads(load(ran / "result.nc").attrs["changes"]) == ["--seed 3"]
    told = texts(drawn(cosim.load_result(ran)))
    assert "changed by --seed 3" in told
    assert "seed 3; formation-cosim 0." in told


def test_files_that_options_name_are_said_once(line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fmu = plants.build("car_like", out=tmp_path)
    printed = run(capsys, line, "--plant", f"clmr={fmu}", "--controller", "pid=lqg", "--out", str(tmp_path))
    assert f"\nchanged by --plant clmr={fmu} --controller pid=lqg\n" in printed


def test_earlier_results_that_cannot_be_kept_are_told(
    line: str, ran: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(ran, tmp_path / "clmr_line")
    (tmp_path / "clmr_line+seed=3").touch()
    assert main(["run", line, "--out", str(tmp_path), "--no-figure"]) == 1
    assert "warning: the results of the run before could not be kept and are overwritten: " in capsys.readouterr().err
    assert load(tmp_path / "clmr_line" / "result.nc").attrs["seed"] == "1"


def test_a_run_that_does_not_begin_leaves_no_verdict_of_an_earlier_one(
    line: str, ran: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its result is kept until there is another one."""
    folder = tmp_path / "clmr_line"
    shutil.copytree(ran, folder)
    earlier = (folder / "result.nc").read_bytes()
    arguments = ["run", line, "--seed", "3", "--out", str(tmp_path), "--no-figure"]
    assert main([*arguments, "--pace", "0"]) == 2
    assert {path.name for path in folder.iterdir()} == {*FILES}, "it is refused before anything is touched"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cosim.cli.run.whole_run", lambda *_: (_ for _ in ()).throw(cosim.InputError("no plant")))
        for _ in range(2):
            assert main(arguments) == 2
            assert {path.name: path.read_bytes() for path in folder.iterdir()} == {"result.before.nc": earlier}
    assert main(arguments) == 1
    assert {path.name for path in folder.iterdir()} == {"report.html", "result.nc", "summary.json"}


def test_nothing_is_said_to_be_changed_where_nothing_is(line: str, tmp_path: Path, capsys) -> None:
    printed = run(capsys, line, "--out", str(tmp_path))
    assert "changed" not in printed
    assert "kept" not in printed
    assert json.loads((tmp_path / "clmr_line" / "summary.json").read_text())["changes"] == []


def test_python_says_it_too(line: str) -> None:
    result = cosim.run(line, [set_seed(2)], horizon="0.6 s")
    assert cosim.summary_of(result).provenance.changes == ("--seed 2", "--horizon '0.6 s'")


# Two results ------------------------------------------------------------------------------------------------


def test_a_run_that_is_refused_says_where_the_results_before_are(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path)
    run(capsys, line, "--out", out)
    refused = "controller/gain[@name='nonsense']/@value=1"
    assert main(["run", line, "--out", out, "--no-figure", "--set", refused]) == 2
    told = capsys.readouterr().err
    assert f"warning: results of the run before ({line}, unchanged) are kept in {out}/clmr_line+unchanged/" in told
    assert not (tmp_path / "clmr_line" / "summary.json").exists(), "nobody takes it for that of the refused run"


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ([], "unchanged"),
        (["--seed 2"], "seed=2"),
        (["--at 40s", """--set "//plant[@id='clmr']/parameter[@name='m_c']/@value=45 kg\""""], "at=40s+clmr.m_c=45kg-"),
        (["""--set "//*[@id='clmr']/@value=45 kg\""""], "clmr=45kg-"),
        (["--set '//follower[1]/desired/@range=3 m'"], "follower.desired.range=3m-"),
        (["--set '//follower[2]/desired/@range=3 m'"], "follower.desired.range=3m-"),
        (["--horizon '20 s'", "--no-expectations"], "horizon=20s+no-expectations-"),
        (["--set '//event[@at=\"../1 s\"]/@at=2 s'"], "event.at=2s-"),
        (["--set 'no setting'"], "set=no_setting-"),
        (["--controller pid=../law"], "controller=pid=.._law-"),
    ],
)
def test_names_of_folders_can_be_read(changes: list[str], expected: str) -> None:
    name = label(Provenance("line.xml", tuple(changes)), "line")
    assert re.fullmatch(re.escape(expected) + ("[0-9a-f]{8}" if expected.endswith("-") else ""), name)
    other = label(Provenance("other/line_2.xml", tuple(changes)), "line")
    assert other.startswith("line_2+")
    longer = label(Provenance("line.xml", (*changes, "--set " + "x" * 100)), "line")
    assert len(longer) < 80
    assert longer != label(Provenance("line.xml", (*changes, "--set " + "x" * 101)), "line")


def test_results_of_other_changes_are_kept(line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path)
    run(capsys, line, "--out", out)
    printed = run(capsys, line, "--out", out, "--seed", "2")
    assert f"results of the run before ({line}, unchanged) are kept in {out}/clmr_line+unchanged/\n" in printed
    printed = run(capsys, line, "--out", out, "--seed", "2")
    assert "kept" not in printed, "a run of the same changes takes the place of the one before"
    printed = run(capsys, line, "--out", out)
    assert f"({line}, changed by --seed 2) are kept in {out}/clmr_line+seed=2/\n" in printed
    seeds = {path.parent.name: load(path).attrs["seed"] for path in tmp_path.glob("*/result.nc")}
    assert seeds == {"clmr_line": "1", "clmr_line+unchanged": "1", "clmr_line+seed=2": "2"}
    for folder in seeds:
        summary = json.loads((tmp_path / folder / "summary.json").read_text())
        assert str(summary["seed"]) == seeds[folder], "the files of a run stay together"


def test_results_of_another_file_of_the_same_name_are_kept(line: str, ran: Path, tmp_path: Path, capsys) -> None:
    shutil.copytree(ran, tmp_path / "clmr_line")
    copy = tmp_path / "mine.xml"
    shutil.copy(line, copy)
    run(capsys, str(copy), "--out", str(tmp_path), "--seed", "3")
    assert sorted(path.name for path in (tmp_path / "clmr_line+seed=3").iterdir()) == FILES
    run(capsys, line, "--out", str(tmp_path), "--seed", "3")
    assert (tmp_path / "clmr_line+mine+seed=3").is_dir()


def test_results_of_files_in_other_folders_are_kept(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of its own, also where their names are the same."""
    monkeypatch.chdir(tmp_path)
    for folder in "abc":
        Path(folder).mkdir()
        shutil.copy(line, folder)
    run(capsys, "a/clmr_line.xml")
    with Path("a/clmr_line.xml").open("a") as edited:
        edited.write("<!-- edited -->")
    assert "kept" not in run(capsys, f"{tmp_path}/a/../a/clmr_line.xml"), "an edited file is the same file"
    run(capsys, "b/clmr_line.xml")
    run(capsys, "c/clmr_line.xml")
    files = {path.parent.name: load(path).attrs["scenario_file"] for path in Path("runs").glob("*/result.nc")}
    (another,) = files.keys() - {"clmr_line", "clmr_line+unchanged"}
    assert another.startswith("clmr_line+b_clmr_line+unchanged-")
    assert files["clmr_line"] == "c/clmr_line.xml"
    assert files["clmr_line+unchanged"].endswith("a/clmr_line.xml")
    assert files[another] == "b/clmr_line.xml"


def test_what_is_no_result_is_overwritten(line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "clmr_line"
    folder.mkdir()
    (folder / "result.nc").write_text("no result")
    (folder / "notes.txt").write_text("mine")
    assert "kept" not in run(capsys, line, "--out", str(tmp_path))
    run(capsys, line, "--out", str(tmp_path), "--seed", "2")
    assert (folder / "notes.txt").exists(), "only the files of a run are moved"


def test_long_changes_have_short_folders_of_their_own(line: str, tmp_path: Path, capsys) -> None:
    gains = [f"//gain[@name='gamma_w']/@value={value}" for value in ("0.1", "0.2")]
    for gain in gains:
        run(capsys, line, "--out", str(tmp_path), "--set", gain)
    run(capsys, line, "--out", str(tmp_path))
    names = {path.name for path in tmp_path.iterdir()} - {"clmr_line"}
    assert len(names) == 2
    assert all(name.startswith("clmr_line+gamma_w=0.") for name in names)


# Why a run failed -------------------------------------------------------------------------------------------


def test_why_a_run_failed_is_kept(diverged: Path) -> None:
    failure = json.loads((diverged / "summary.json").read_text())["failure"]
    assert failure["robot"] == "leader"
    assert 0 < failure["time"] < 1
    assert failure["variable"] in ("x", "v")
    assert failure["message"].startswith("the plant car_like.fmu has diverged: ")
    assert json.loads(load(diverged / "result.nc").attrs["failure"]) == failure


def test_a_run_that_diverged_has_a_figure(diverged: Path) -> None:
    assert (diverged / "figure.png").read_bytes().startswith(b"\x89PNG")
    told = texts(drawn(cosim.load_result(diverged)))
    assert "the plant car_like.fmu has diverged: " in told
    assert "diverged values are not drawn" in told


@pytest.mark.parametrize("runaway", [np.nan, np.inf, 1e308, -1e200])
@pytest.mark.parametrize("samples", [1, 2, 51])
def test_a_figure_of_numbers_that_ran_away(ran: Path, runaway: float, samples: int) -> None:
    """Whatever the last samples are, the axes show the rest at its own scale."""
    result = cosim.load_result(ran).isel(time=slice(samples)).copy(deep=True)
    result.attrs["status"] = "incomplete"
    for variable in result.data_vars.values():
        variable[-2:] = runaway
    limits = [limit for axes in drawn(result).axes for limit in (*axes.get_xlim(), *axes.get_ylim())]
    limits += [limit for panel in panels(drawable(Result.of(result))) for limit in view(panel, ())]
    assert max(map(abs, limits)) < 200


def test_axes_of_a_run_that_ended_early_show_what_led_there(ran: Path) -> None:
    result = cosim.load_result(ran).copy(deep=True)
    result["pose"][-2:] = 1e5
    result["range_error"][-2:] = 1e5
    widths = {}
    for status in ("incomplete", "completed"):
        result.attrs["status"] = status
        paths = next(axes for axes in drawn(result).axes if axes.get_title("left") == "paths")
        widths[status] = float(np.ptp(paths.get_xlim()))
    assert widths["incomplete"] < 100
    assert widths["completed"] > 1e4, "of a completed run, all that can be drawn is"


def test_an_interrupted_run_says_so(line: str) -> None:
    simulation = Simulation(cosim.read_scenario(line))

    def stop(tick: int) -> None:
        if tick > 5:
            raise KeyboardInterrupt

    with simulation, pytest.raises(cosim.RunInterrupted) as interrupted:
        simulation.run(stop)
    failure = cosim.summary_of(interrupted.value.result).provenance.failure
    assert failure is not None
    assert failure.interrupted
    assert str(failure) == f"interrupted at t = {simulation.time:.6g} s"


def test_the_table_does_not_contradict_a_verdict(capsys: pytest.CaptureFixture[str]) -> None:
    """A `<settled>` may have wider bands than the table, or a later time than the table's twentieth of the run."""
    times = {"a": (40.0, 40.0), "b": (None, 98.2), "c": (None, None)}
    figures = [FollowerFigures(robot, settled, 0.1, 0.1, 9.0, within) for robot, (settled, within) in times.items()]
    print_summary(out(), Summary("one", "completed", 100.0, tuple(figures), None, None, (), ()))
    printed = capsys.readouterr().out
    lines = [line.split() for line in printed.splitlines()]
    assert ["a", "40.00"] in [line[:2] for line in lines]
    assert ["b", "since", "98.20"] in [line[:3] for line in lines]
    assert ["c", "outside"] in [line[:2] for line in lines]
    assert "\nsince: within 0.1 m and 2 deg, but for less than a twentieth of the run\n" in printed
    assert "\noutside: not within 0.1 m and 2 deg at the end\n" in printed


# Looked at later --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("named", ["result.nc", ""])
def test_show_prints_what_run_printed(line: str, tmp_path: Path, capsys, named: str) -> None:
    printed = run(capsys, line, "--out", str(tmp_path), "--seed", "2").partition("results in")[0]
    assert main(["show", str(tmp_path / "clmr_line" / named)]) == 1
    shown = capsys.readouterr()
    assert shown.out == printed
    assert shown.err == ""


def test_show_of_a_failed_run(diverged: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figure = tmp_path / "later.png"
    assert main(["show", str(diverged), "--figure", str(figure)]) == 3
    shown = capsys.readouterr()
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert "changed by --set \"//parameter[@name='m_c']/@value=0.01 kg\"" in shown.out
    assert "the run ended early: leader at t = 0." in shown.err


def test_a_summary_is_the_same_in_python_and_in_its_file(ran: Path) -> None:
    summary = cosim.summary_of(cosim.load_result(ran))
    assert summary.to_json() == (ran / "summary.json").read_text()
    assert isinstance(summary, cosim.Summary)
    assert all(isinstance(verdict, cosim.Verdict) for verdict in summary.verdicts)


def test_a_result_without_verdicts_is_judged_by_its_scenario(ran: Path, scenarios: Path) -> None:
    result = cosim.load_result(ran)
    kept = cosim.summary_of(result)
    del result.attrs["verdicts"]
    judged = cosim.summary_of(result)
    assert len(judged.verdicts) > 4
    assert judged.to_json() == kept.to_json()


def test_nothing_is_run_to_show_a_result(line: str, ran: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The other scenario of a <compare> may be anything, as may the result."""
    result = cosim.load_result(ran)
    compare = '<compare measure="rms" signal="range_error" factor="2" scenario="other.xml"/></expect>'
    result.attrs["scenario"] = result.attrs["scenario"].replace("</expect>", compare)
    del result.attrs["verdicts"]
    monkeypatch.delattr(Simulation, "__init__")
    verdict = cosim.summary_of(result).verdicts[-1]
    assert not verdict.passed
    assert "no run of other.xml" in verdict.finding


@pytest.mark.parametrize("judged", [True, False])
@pytest.mark.parametrize(
    ("change", "samples"),
    [
        (lambda run: run.sel(time=slice(0, 0.1)), "6 samples, 0.00 s to 0.10 s"),
        (lambda run: run.isel(time=slice(1, None)), "samples, 0.02 s to "),
        (lambda run: run.isel(time=slice(None, None, 2)), "samples, 0.00 s to "),
        (lambda run: run.assign_coords(time=run.time + 0.01), "samples, 0.01 s to "),
        (lambda run: run.isel(time=[]), "0 samples: nothing is judged"),
    ],
)
def test_a_part_of_a_result_is_not_judged_and_does_not_pass(
    ran: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: Callable[[xr.Dataset], xr.Dataset],
    samples: str,
    judged: bool,
) -> None:
    """Whether it carries the verdicts of the whole run or not."""
    result = cosim.load_result(ran)
    if not judged:
        del result.attrs["verdicts"]
    result.attrs["scenario"] = re.sub("(?s)<expect>.*</expect>", "", result.attrs["scenario"])  # nothing can fail
    part = change(result)
    summary = cosim.summary_of(part)
    assert (summary.status, summary.completed, summary.passed, summary.verdicts) == ("part", False, False, ())
    assert "has not all ticks of its run" in summary.notes[0]
    assert samples in summary.notes[0]
    part.to_netcdf(tmp_path / "part.nc", engine="h5netcdf")
    assert main(["show", str(tmp_path / "part.nc")]) == 1
    shown = capsys.readouterr()
    assert samples in " ".join(shown.out.split())
    assert shown.err == ""


@pytest.mark.parametrize("dims", [("robot", "time"), ("pose_component", "robot", "time")])
def test_a_summary_is_of_a_result_with_its_dimensions_in_any_order(ran: Path, dims: tuple[str, ...]) -> None:
    result = cosim.load_result(ran)
    assert cosim.summary_of(result.transpose(*dims, ...)).to_json() == cosim.summary_of(result).to_json()


@pytest.mark.parametrize(
    ("content", "sentence"), [(b"no result", "is no netCDF file"), (xr.Dataset(), "'scenario_name' is missing in it")]
)
def test_why_it_is_no_result(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: object, sentence: str
) -> None:
    path = tmp_path / "result.nc"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        save(content, path)
    assert main(["show", str(path)]) == 2
    assert sentence in capsys.readouterr().err


def test_a_result_without_versions_says_only_its_seed(ran: Path) -> None:
    result = cosim.load_result(ran)
    result.attrs |= {"versions": "{}", "controllers": "[]"}
    assert cosim.summary_of(result).provenance.basis == "seed 3"


@pytest.mark.parametrize("kind", ["missing", "empty folder", "text", "other", "half"])
def test_what_is_no_result(ran: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str) -> None:
    path = tmp_path / "result.nc"
    if kind == "empty folder":
        path = tmp_path
    elif kind == "text":
        path.write_text("no result")
    elif kind == "other":
        save(xr.Dataset({"a": ("b", [1.0, 2.0])}), path)
    elif kind == "half":
        save(cosim.load_result(ran).drop_vars("pose"), path)
    assert main(["show", str(path)]) == 2
    said = capsys.readouterr().err
    assert "error: " in said
    assert "the result of a run" in said
    assert "Traceback" not in said


def drawn(result: xr.Dataset) -> Figure:
    """Return the figure of a result, with all that is laid out when it is drawn."""
    figure = draw(result)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure.draw_without_rendering()
    return figure


def texts(figure: Figure) -> str:
    """Return the texts above and below the panels of a figure, with single spaces."""
    return " ".join(f"{figure.get_suptitle()} {figure.get_supxlabel()}".split())
