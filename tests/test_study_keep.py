"""Full results of runs of a study: which ones are kept, and that each is what ``formation run`` gives."""

import re
import shutil
from collections import namedtuple
from dataclasses import replace
from pathlib import Path

import pytest

import cosim
from cosim.cli import main
from cosim.errors import InputError, OutputError
from cosim.studies import kept_results
from cosim.studies.conduct import StudyOutcome, check_study, conduct
from cosim.studies.kept_results import keep_results, kept_rows
from cosim.studies.read_keep import keeping
from cosim.studies.reader import read_study
from cosim.tests.studies import LAST, MASS, small_study, write_study

from .crashing_study import crashing_study

LONGER = "simulation/@horizon=0.3 s"


def names(folders: list[Path]) -> list[str]:
    return [folder.name for folder in folders]


def test_results_that_a_study_keeps_are_those_of_formation_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_study(tmp_path, rest=LAST + '<keep runs="worst 2" of="last"/>')
    kept = tmp_path / "runs" / "small" / "kept"
    monkeypatch.chdir(tmp_path)
    table = cosim.study(path, [LONGER], out="runs", workers=0, keep="1")
    command = ["study", str(path), "--workers", "1", "--no-figure", "--set", LONGER, "--keep", "5"]
    assert main(command) == 0
    assert "full results in runs/small/kept/: run_2/, run_5/, run_6/\n" in capsys.readouterr().out
    assert names(sorted(kept.iterdir())) == ["run_1", "run_2", "run_5", "run_6"]
    for number in (1, 6):
        folder = kept / f"run_{number}"
        own = cosim.load_result(folder)
        assert own.attrs.pop("study_run") != ""
        assert main(["run", str(folder / "scenario.xml"), "--no-figure"]) == 0
        expected = cosim.load_result(tmp_path / "runs" / f"small-{number}")
        assert own.identical(expected)
        assert all(own[name].values.tobytes() == expected[name].values.tobytes() for name in ("pose", "range_error"))
        assert (folder / "summary.json").read_text() == (tmp_path / f"runs/small-{number}/summary.json").read_text()
        assert 1000 * abs(own["range_error"][-1]).max() == pytest.approx(table["last"].values[number - 1], rel=1e-14)

    # a result that is there is not made again, and one of another run is no longer there
    before = (kept / "run_2" / "result.nc").stat().st_mtime_ns
    cosim.study(path, [LONGER], out="runs", workers=0)
    assert (kept / "run_2" / "result.nc").stat().st_mtime_ns == before
    cosim.study(path, out="runs", workers=0)
    assert cosim.load_result(kept / "run_2").attrs["horizon"] == 0.2
    assert list((kept / "run_5").iterdir()) == []


def test_many_results_are_made_by_several_processes_as_by_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = conduct(small_study(tmp_path, rest=LAST + '<keep runs="all"/>'), tmp_path, workers=0)
    (one := tmp_path / "one").mkdir()
    (two := tmp_path / "two").mkdir()
    keep_results(outcome, one, workers=0)
    made, elsewhere = kept_results._made, []
    monkeypatch.setattr(kept_results, "_WORTHWHILE", 0.0)
    with monkeypatch.context() as patch:
        patch.setattr(kept_results, "_made", lambda own, task: made(own, replace(task, runs=10**12)))
        with pytest.raises(OutputError, match=r"results of 1000000000000 runs need .*: ask for fewer runs"):
            keep_results(outcome, two, workers=2)
    monkeypatch.setattr(kept_results, "_made", lambda own, task: elsewhere.append(task.folder.name) or made(own, task))
    assert names(keep_results(outcome, two, workers=2)) == [f"run_{number}" for number in range(1, 7)]
    assert elsewhere == ["run_3", "run_4", "run_5", "run_6"]
    for number in range(1, 7):
        both = [cosim.load_result(folder / "kept" / f"run_{number}") for folder in (one, two)]
        assert both[0].equals(both[1])


def test_the_worst_and_the_median_are_those_of_a_measure_or_of_the_margins(tmp_path: Path) -> None:
    outcome = conduct(small_study(tmp_path), tmp_path, workers=0)

    def kept(text: str, of: StudyOutcome = outcome) -> list[int]:
        asked = small_study(tmp_path, rest=LAST + text)
        return [row.number for row in kept_rows(replace(of, study=asked))]

    by_figure = sorted(outcome.rows, key=lambda row: -row.measures[0])
    assert kept('<keep runs="worst" of="last"/>') == [by_figure[0].number]
    assert kept('<keep runs="median" of="last"/>') == [by_figure[3].number]
    least = LAST.replace("final", "least")
    by_least = sorted(outcome.rows, key=lambda row: row.measures[0])
    asked = small_study(tmp_path, rest=least + '<keep runs="median" of="last"/>')
    assert [row.number for row in kept_rows(replace(outcome, study=asked))] == [by_least[2].number]
    assert kept('<keep runs="worst"/>') == [min(outcome.rows, key=lambda row: row.least).number]
    assert kept('<keep runs="all"/>') == [1, 2, 3, 4, 5, 6]
    assert kept('<keep runs="2 to 3"/><keep runs="5"/>') == [2, 3, 5]
    look = replace(outcome, rows=outcome.rows[:2])
    assert kept('<keep runs="2 to 6"/>', look) == [2]
    assert kept('<keep runs="worst median"/>', replace(outcome, rows=())) == []


def test_a_run_that_breaks_keeps_what_it_has_and_one_that_cannot_begin_nothing(tmp_path: Path) -> None:
    (folder := tmp_path / "crashing").mkdir()
    study = keeping(crashing_study(folder, "0.2 s"), "all", "keep")
    (kept,) = keep_results(conduct(study, folder, workers=1), folder)
    result = cosim.load_result(kept)
    assert result.attrs["status"] == "incomplete"
    assert "the plant car.fmu did not complete the step" in result.attrs["failure"]

    masses = f'<vary name="mass" select="{MASS}"><list values="30 kg, -1 kg"/></vary>'
    study = small_study(tmp_path, masses, '<sample method="grid"/>', LAST + '<keep runs="all"/>')
    assert names(keep_results(conduct(study, tmp_path, workers=0), tmp_path)) == ["run_1"]


def test_results_for_which_there_is_no_room_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = conduct(small_study(tmp_path, rest=LAST + '<keep runs="all"/>'), tmp_path, workers=0)
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(10**6, 10**6, 10**3))
    with pytest.raises(OutputError, match=r"results of 6 runs need .* GB, and .*/kept has room for 1e-06 GB"):
        keep_results(outcome, tmp_path)


BAD = {
    "other word": ('<keep runs="best"/>', "is not runs such as"),
    "no run": ('<keep runs="0"/>', "is not runs such as"),
    "backwards": ('<keep runs="5 to 3"/>', "there are no runs 5 to 3"),
    "too many": ('<keep runs="3 to 7"/>', "the study has 6 runs, so there is no run 7"),
    "no measure": ('<keep runs="worst" of="lost"/>', "the study has no measure 'lost': "),
    "measure of none": ('<keep runs="3" of="last"/>', "of=... says which run is worst"),
}


@pytest.mark.parametrize(("text", "said"), BAD.values(), ids=BAD)
def test_what_makes_no_sense(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        check_study(small_study(tmp_path, rest=f"{LAST}\n{text}"))
    assert "study.xml:6" in str(caught.value) or "study.xml:7" in str(caught.value)


def test_options_and_scenarios_for_which_there_is_no_worst_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_study(tmp_path)
    for text in ("worse", "1 to", "allworst", "3 to 99999999"):
        assert main(["study", str(path), "--keep", text, "--out", str(tmp_path)]) == 2
        assert f"--keep: error: {text!r} names no runs: expected all, worst, median or" in capsys.readouterr().err
    with pytest.raises(InputError, match="keep='all': full results need a folder, out="):
        cosim.study(path, keep="all")
    base = tmp_path / "base.xml"
    base.write_text(re.sub("<expect>.*</expect>", "", base.read_text()))
    with pytest.raises(InputError, match="a scenario of the study expects nothing, so no run has a least margin"):
        check_study(keeping(read_study(path), "worst", "keep"))
    with pytest.raises(InputError, match="the change '<lambda>' sets no value, so a scenario file cannot state it"):
        cosim.study(path, [lambda root: None], out=tmp_path, workers=0, keep="1")
