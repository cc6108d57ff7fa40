"""Studies from their file to their verdicts: the same numbers however they are run, and nothing lost."""

import csv
import json
import math
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import cosim
from cosim.cli import main
from cosim.results.expectations import judge
from cosim.results.files import save
from cosim.studies.conduct import StudyOutcome, conduct
from cosim.studies.plan import Plan
from cosim.studies.reader import read_study
from cosim.studies.reproduce import as_variant
from cosim.studies.requirements import requirements_of
from cosim.studies.row import BROKEN, FAILED, PASSED, Row
from cosim.studies.store import FILE
from cosim.studies.table import _of_value, as_csv, as_result
from cosim.tests.studies import LAST, MASS, SEEDS, UNIFORM, small_study, write_study

from .crashing_study import crashing_study

NOISE = '<vary name="noise" select="sensor/noise/@x"><list values="0 mm, 5 mm"/></vary>'
CASES = """<vary name="law" cross="yes">
  <case name="soft"><set select="//gain[@name='K_p']/@value" value="1"/></case>
  <case name="stiff"><set select="//gain[@name='K_p']/@value" value="20"/></case>
</vary>"""
SETTLING = '<measure name="settling" figure="settling_time" robots="follower_1"/>'


def here(folder: Path, *parts: str, runs: int | None = None, **named: str) -> StudyOutcome:
    """Write a study and conduct it in this process."""
    study = small_study(folder, *parts, **named)
    (folder / "out").mkdir(exist_ok=True)
    return conduct(study, folder / "out", workers=0, runs=runs)


def test_each_run_is_the_run_of_its_scenario_alone(tmp_path: Path) -> None:
    path = write_study(tmp_path, UNIFORM + CASES + SEEDS, rest=LAST + SETTLING)
    study = read_study(path, ["follower[@id='follower_1']/pose/@y=1.5 m", "simulation/@horizon=0.4 s"])
    outcome = conduct(study, tmp_path, workers=0)
    assert len(outcome.rows) == outcome.planned == outcome.made == 12
    plan = Plan(outcome.study)
    for index in (0, 5, 11):
        file = tmp_path / f"run_{index}.xml"
        file.write_text(as_variant(outcome.study, plan[index], tmp_path))
        read = cosim.read_scenario(file)
        assert read.horizon == 0.4
        result = cosim.run(read)
        row = outcome.rows[index]
        last = max(float(abs(result["range_error"].sel(robot=name)[-1])) for name in result["robot"].values)
        assert row.measures[0] == pytest.approx(1000 * last, rel=1e-14)
        (verdict, *_) = judge(read.expectations, result, None)
        assert row.status == (PASSED if verdict.passed else FAILED)
        assert row.margins == (min(v.margin for v in judge(read.expectations, result, None)),)
    assert len({row.measures[0] for row in outcome.rows}) == 12


def test_a_study_goes_on_where_it_was(tmp_path: Path) -> None:
    whole = here(tmp_path)
    lines = (tmp_path / "out" / FILE).read_bytes().splitlines(keepends=True)
    order = list(range(1, 7))
    random.Random(1).shuffle(order)
    for kept in (0, 2, 5):
        rows = [lines[number] for number in order[:kept]]
        torn = lines[order[5]][:40]
        (tmp_path / "out" / FILE).write_bytes(b"".join([lines[0], *rows, torn]))
        again = here(tmp_path)
        assert (again.made, again.before) == (6 - kept, kept)
        assert again.rows == whole.rows


def test_equal_runs_are_made_once_and_not_told_as_kept_from_before(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    same = """<vary name="law" cross="yes"><case name="one"/><case name="other"/></vary>"""
    write_study(tmp_path, vary=same + SEEDS, sample='<sample method="random" runs="3"/>')
    for before in ("", "6 of them from before; "):
        assert main(["study", "study.xml", "--workers", "1", "--no-figure", "--no-report"]) == 0
        assert f"6 runs; {before}6 passed" in capsys.readouterr().out
    assert (tmp_path / "runs" / "small" / FILE).read_text().count('"key"') < 6


def test_broken_runs_with_one_reason_are_told_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    masses = f'<vary name="mass" select="{MASS}"><list values="30 kg, -1 kg"/></vary>'
    write_study(
        tmp_path, masses + SEEDS.replace("count", "range").replace('"7"', '"1" to="3"'), '<sample method="grid"/>'
    )
    assert main(["study", "study.xml", "--workers", "1", "--no-figure", "--no-report"]) == 0
    printed = capsys.readouterr().out
    assert printed.count("broken: ") == 1
    assert "broken: run 4 and 2 more: base.xml:" in printed


def test_what_changes_a_run_makes_it_anew_and_nothing_else_does(tmp_path: Path) -> None:
    first = here(tmp_path)
    more = here(tmp_path, sample='<sample method="random" runs="9"/>')
    assert (more.made, more.rows[:6]) == (3, first.rows)
    base = tmp_path / "base.xml"
    study = read_study(tmp_path / "study.xml")
    base.write_text(base.read_text().replace("<title>", "<!-- a remark -->\n<title>Another "))
    assert conduct(read_study(study.document.path), tmp_path / "out", workers=0).made == 0
    base.write_text(base.read_text().replace('"0.2 s"', '"0.4 s"'))
    assert conduct(read_study(study.document.path), tmp_path / "out", workers=0).made == 9


COMPARED = '<compare measure="rms" signal="range_error" factor="1" scenario="one.xml"/>'
PUSHED = '<input name="tau_drive"><table file="one.csv" column="f"/></input>'


@pytest.mark.parametrize(
    ("written", "before", "select", "change"),
    [
        (PUSHED, "<leader", "input/table/@file", ("5", "6")),
        (PUSHED, "<leader", "//table/attribute::*[name() = 'file'][1]", ("5", "6")),
        (COMPARED, "</expect>", "//compare/@scenario", ('m_c" value="30 kg"', 'm_c" value="31 kg"')),
    ],
)
def test_a_file_that_a_varied_value_names_makes_its_runs_anew(
    tmp_path: Path, written: str, before: str, select: str, change: tuple[str, str]
) -> None:
    ending = ".csv" if "table" in written else ".xml"
    vary = f'<vary name="file" select="{select}"><list values="one{ending}, other{ending}"/></vary>'
    path = write_study(tmp_path, vary, '<sample method="grid"/>')
    base = tmp_path / "base.xml"
    for name in ("one", "other"):
        text = "time [s],f [N.m]\n0,4\n0.2,5\n" if ending == ".csv" else base.read_text()
        (tmp_path / f"{name}{ending}").write_text(text)
    base.write_text(base.read_text().replace(before, written + before, 1))
    (tmp_path / "out").mkdir()
    made = []
    for file in ("", "other", "", "other"):
        if file:
            changed = tmp_path / f"{file}{ending}"
            changed.write_text(changed.read_text().replace(*change))
            change = change[1], change[0]  # and back, to what is known
        made.append(conduct(read_study(path), tmp_path / "out", workers=0).made)
    assert made == [2, 1, 0, 0]


def test_a_first_look_makes_the_first_runs_without_a_verdict(tmp_path: Path) -> None:
    rest = LAST + '<worst of="last" below="1 mm"/>'
    look = here(tmp_path, runs=2, rest=rest)
    assert (len(look.rows), look.verdicts) == (2, ())
    whole = here(tmp_path, rest=rest)
    assert (whole.rows[:2], whole.made, len(whole.verdicts)) == (look.rows, 4, 1)


def test_a_value_that_is_refused_breaks_its_run_alone(tmp_path: Path) -> None:
    masses = UNIFORM.replace('<uniform from="25 kg" to="40000 g"/>', '<list values="30 kg, -1 kg, 31 kg, 3 m"/>')
    outcome = here(tmp_path, masses, '<sample method="grid"/>')
    assert [row.status for row in outcome.rows] == [PASSED, BROKEN, PASSED, BROKEN]
    assert "m_c" in outcome.rows[1].message
    assert "does not fit" in outcome.rows[3].message
    table = as_result(outcome)
    assert table["mass"].values.tolist() == ["30 kg", "-1 kg", "31 kg", "3 m"]  # two units: texts
    save(table, tmp_path / "runs.nc")
    assert xr.load_dataset(tmp_path / "runs.nc").identical(table.dataset)


def test_values_that_change_the_structure_are_prepared_anew(tmp_path: Path) -> None:
    horizons = '<vary name="end" select="simulation/@horizon"><list values="0.2 s, 0.3 s"/></vary>'
    outcome = here(tmp_path, horizons + SEEDS, '<sample method="grid"/>', LAST)
    assert [row.status for row in outcome.rows] == [PASSED, PASSED]
    assert outcome.rows[0].measures != outcome.rows[1].measures


def test_rows_from_before_name_the_places_of_now(tmp_path: Path) -> None:
    masses = UNIFORM.replace('<uniform from="25 kg" to="40000 g"/>', '<list values="30 kg, -1 kg"/>')
    path = write_study(tmp_path, masses, '<sample method="grid"/>')
    base = tmp_path / "base.xml"
    base.write_text(base.read_text().replace('"99 m"', '"1 mm"'))
    (tmp_path / "out").mkdir()
    first = conduct(read_study(path), tmp_path / "out", workers=0)
    assert [row.status for row in first.rows] == [FAILED, BROKEN]
    base.write_text(base.read_text().replace("<title>", "<!-- a remark\n\n -->\n<title>"))
    again = conduct(read_study(path), tmp_path / "out", workers=0)
    assert again.made == 0
    for row, before in zip(again.rows, first.rows, strict=True):
        file, line, rest = before.message.split(":", 2)
        assert row.message == f"{file}:{int(line) + 3}:{rest}"


# What must hold ---------------------------------------------------------------------------------------------


def test_a_seed_keeps_all_of_its_digits_in_the_table(tmp_path: Path) -> None:
    seeds = SEEDS.replace('"7"', f'"{2**53 + 1}"')
    outcome = here(tmp_path, seeds, '<sample method="random" runs="2"/>')
    assert [line.split(",")[2] for line in as_csv(outcome).splitlines()[1:]] == ["9007199254740993", "9007199254740994"]
    assert as_result(outcome).dataset["seed"].values.tolist() == [2**53 + 1, 2**53 + 2]


@pytest.mark.parametrize(
    ("texts", "values"),
    [
        (["1", "2"], [1, 2]),
        (["7", None], [7.0, math.nan]),
        ([str(2**53 + 1), None], [str(2**53 + 1), ""]),
        ([str(2**64), "1"], [float(2**64), 1.0]),
        ([str(2**64 + 1), "1"], [str(2**64 + 1), "1"]),
        (["1e20", "1e21"], [1e20, 1e21]),
    ],
)
def test_whole_numbers_are_kept_as_what_holds_them(texts: list[str | None], values: list[object]) -> None:
    column = _of_value("seed", texts)
    assert repr(list(column.values)) == repr(values)
    assert np.asarray(column.values).dtype.kind in "ifU"


def rows_of(statuses: Sequence[str], figures: Sequence[float] = (), **about: object) -> list[Row]:
    found = []
    for number, status in enumerate(statuses, 1):
        figure = figures[number - 1] if figures else 0.0
        found.append(Row(str(number), number, number, ("30 kg", "7"), status, (figure,), (), ""))
    return found


def verdict(tmp_path: Path, text: str, rows: list[Row], vary: str = UNIFORM + SEEDS) -> tuple[bool, float, str]:
    (judged,) = requirements_of(small_study(tmp_path, vary, rest=LAST + text))
    found = judged.judge(rows)
    return found.passed, found.figure, found.detail


def test_a_probability_is_shown_by_its_bound(tmp_path: Path) -> None:
    text = '<probability of="passed" above="0.9" confidence="0.95"/>'
    assert verdict(tmp_path, text, rows_of([PASSED] * 29))[0] is True
    assert verdict(tmp_path, text, rows_of([PASSED] * 28))[0] is False
    assert "29 without a failure would show it" in verdict(tmp_path, text, rows_of([PASSED] * 28))[2]
    assert verdict(tmp_path, text, rows_of([PASSED] * 45 + [FAILED]))[0] is True
    assert verdict(tmp_path, text, rows_of([PASSED] * 44 + [FAILED]))[0] is False
    completed = text.replace("passed", "completed")
    assert verdict(tmp_path, completed, rows_of([FAILED] * 29))[0] is True
    assert verdict(tmp_path, completed, rows_of([FAILED] * 29 + [BROKEN]))[0] is False


def test_quantiles_means_and_worst_values(tmp_path: Path) -> None:
    figures = [float(number) for number in range(1, 101)]
    good = rows_of([PASSED] * 100, figures)
    quantile = '<quantile of="last" at="0.9" below="97 mm" confidence="0.95"/>'
    assert verdict(tmp_path, quantile, good)[:2] == (True, 96.0)
    assert verdict(tmp_path, '<worst of="last" below="101 mm"/>', good)[:2] == (True, 100.0)
    assert verdict(tmp_path, '<worst of="last" below="101 mm"/>', good)[2] == "run 100 of 100 runs"
    assert verdict(tmp_path, '<worst of="last" above="1 mm"/>', good)[:2] == (False, 1.0)
    passed, figure, _ = verdict(tmp_path, '<mean of="last" below="60 mm" confidence="0.9"/>', good)
    assert (passed, 50.5 < figure < 60.0) == (True, True)
    broken = [*good[:-1], *(replace(row, number=100, draw=100) for row in rows_of([BROKEN]))]
    assert verdict(tmp_path, '<worst of="last" below="101 mm"/>', broken) == (
        False,
        math.inf,
        "run 100 of 100 runs, 1 run broken",
    )
    (one,) = requirements_of(small_study(tmp_path, rest=LAST + '<worst of="last" below="101 mm"/>'))
    assert str(one.judge(broken)).endswith(": no figure (run 100 of 100 runs, 1 run broken)")
    few = verdict(tmp_path, quantile, rows_of([PASSED] * 5, figures))
    assert (few[0], "too few" in few[2]) == (False, True)


def test_better_is_a_matter_of_pairs(tmp_path: Path) -> None:
    text = '<better of="last" vary="law" case="soft" than="stiff" confidence="0.95"/>'

    def pairs(wins: int, losses: int, ties: int) -> list[Row]:
        found = []
        for draw, (one, other) in enumerate([(1.0, 2.0)] * wins + [(2.0, 1.0)] * losses + [(1.0, 1.0)] * ties, 1):
            for case, figure in (("soft", one), ("stiff", other)):
                found.append(Row("", 2 * draw, draw, ("30 kg", case, str(draw)), PASSED, (figure,), (), ""))
        return found

    vary = UNIFORM + CASES + SEEDS
    assert verdict(tmp_path, text, pairs(5, 0, 10), vary)[0] is True
    assert verdict(tmp_path, text, pairs(4, 0, 10), vary)[0] is False
    assert verdict(tmp_path, text, pairs(10, 10, 0), vary)[0] is False
    assert verdict(tmp_path, text.replace("confidence", 'by="more" confidence'), pairs(0, 5, 0), vary)[0] is True


def test_a_study_may_end_early_with_the_same_run_on_any_number_of_workers(tmp_path: Path) -> None:
    text = '<probability of="passed" above="0.5" confidence="0.95" stop="early"/>'
    many = '<sample method="random" runs="60"/>'
    outcome = here(tmp_path, UNIFORM + SEEDS, many, text)
    assert (outcome.early, outcome.passed) == (True, True)
    assert len(outcome.rows) < 12
    path = tmp_path / "out" / FILE
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([lines[0], *reversed(lines[1:])]))
    assert here(tmp_path, UNIFORM + SEEDS, many, text).rows == outcome.rows
    look = here(tmp_path, UNIFORM + SEEDS, many, text, runs=12)
    assert (look.verdicts, look.made) == (outcome.verdicts, 0), "a first look that is long enough has its verdict"


# The command ------------------------------------------------------------------------------------------------


@pytest.mark.skipif(sys.platform == "win32", reason="nothing is locked there")
def test_no_other_study_begins_while_files_are_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_study(tmp_path)
    monkeypatch.chdir(tmp_path)
    command = ["study", "study.xml", "--workers", "1", "--no-report"]
    others = []

    def meanwhile(*_: object) -> dict[str, bytes]:
        others.append((main([*command, "--no-figure"]), capsys.readouterr().err))
        return {}

    monkeypatch.setattr("cosim.cli.studying._pictures", meanwhile)
    assert main(command) == 0
    ((status, told),) = others
    assert status == 2
    assert "rows.jsonl is in use by another command: wait until it ends" in " ".join(told.split())
    assert (tmp_path / "runs/small/summary.json").is_file()


def test_the_command_with_two_workers_gives_the_same_rows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = here(tmp_path, UNIFORM + SEEDS + NOISE, rest=LAST + '<worst of="last" below="1 mm" fails="too soon"/>')
    monkeypatch.chdir(tmp_path)
    assert main(["study", "study.xml", "--workers", "2", "--junit", "junit.xml"]) == 1
    printed = capsys.readouterr().out
    assert "small: A small study" in printed
    assert "6 runs; 6 passed, 0 failed, 0 broken" in printed
    assert "fails as known: too soon" in printed
    rows = list(csv.DictReader((tmp_path / "runs/small/runs.csv").read_text().splitlines()))
    assert [float(row["last [mm]"]) for row in rows] == [row.measures[0] for row in expected.rows]
    assert f"{rows[0]['mass [kg]']} kg" == expected.rows[0].values[0]
    summary = json.loads((tmp_path / "runs/small/summary.json").read_text())
    assert (summary["runs"], summary["passed"], summary["holds"]) == (6, 6, False)
    assert 'skipped="1"' in (tmp_path / "junit.xml").read_text()
    (worst,) = (tmp_path / "runs/small/runs_to_see").glob("*.xml")
    assert main(["check", str(worst)]) == 0
    dataset = cosim.study("study.xml", out="runs", workers=0)  # nothing is left to make
    assert dataset["last"].attrs["units"] == "mm"
    assert dataset["mass"].dims == ("run",)
    assert dataset["seed"].values.tolist() == [7, 8, 9, 10, 11, 12]
    assert xr.load_dataset("runs/small/runs.nc").identical(dataset)


def test_no_file_of_an_earlier_study_is_taken_for_one_of_a_new_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    few, of_cases = '<sample method="random" runs="2"/>', LAST + '<envelope signal="range_error" unit="m"/>'
    own = ["notes.txt", "tuned-mine.xml"]
    folder = tmp_path / "runs" / "small"

    def files(within: Path = folder) -> list[str]:
        return sorted(path.relative_to(within).as_posix() for path in within.rglob("*") if path.is_file())

    write_study(tmp_path, UNIFORM + CASES, few, of_cases)
    assert main(["study", "study.xml", "--workers", "1", "--keep", "1 to 4"]) == 0
    for name in own:
        (folder / name).write_text("mine")
    assert {"cases.csv", "envelope.png", "figure.png", "kept/run_4/result.nc"} <= set(files())

    bounded = LAST + '<worst of="last" below="99 m"/>'
    write_study(tmp_path, UNIFORM, few, bounded)
    assert main(["study", "study.xml", "--workers", "1", "--no-figure"]) == 0
    made = ["report.html", "runs.csv", "runs.nc", "summary.json"]
    stays = [*own, "kept/run_4/result.nc", "pace.json", "rows.jsonl"]
    assert not any((folder / name).exists() for name in ("cases.csv", "envelope.png", "figure.png", "files.before"))
    assert {*made, *stays} <= set(files())
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert '"cases":[],"pictures":[]' in page
    assert '"kept":{}' in page, "there is no run 4 any more"

    rows = len((folder / FILE).read_text().splitlines())
    write_study(tmp_path, UNIFORM, few, LAST + '<worst of="last" below="99 kg"/>')
    assert main(["study", "study.xml"]) == 2
    assert not {*made} & set(files()), "nothing can be taken for a verdict of the study that is refused"
    assert {*made} <= set(files(folder / "files.before"))
    assert {*stays} <= set(files())
    capsys.readouterr()
    assert main(["report", str(folder)]) == 2
    assert "holds no summary.json; expected the folder of a study" in capsys.readouterr().err

    write_study(tmp_path, UNIFORM, few, bounded)
    cosim.study("study.xml", out="runs", workers=0)
    assert {*made, *stays} <= set(files()), "they are of the same study and runs"
    assert len((folder / FILE).read_text().splitlines()) == rows, "no run is made again"
    cosim.study("study.xml", ["simulation/@horizon=0.3 s"], out="runs", workers=0, runs=1)
    assert not {*made} & set(files())
    assert {*stays} - {"kept/run_4/result.nc"} <= set(files())


def test_a_killed_or_interrupted_study_goes_on(tmp_path: Path) -> None:
    long = '<sample method="random" runs="150"/>'
    write_study(tmp_path, sample=long)
    rows = tmp_path / "runs" / "small" / FILE
    for number in (signal.SIGKILL, signal.SIGINT):
        before = rows.read_bytes().count(b"\n") if rows.exists() else 0
        command = subprocess.Popen(
            [sys.executable, "-m", "cosim", "study", "study.xml", "--workers", "1"],
            cwd=tmp_path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        _wait_for(lambda before=before: rows.exists() and rows.read_bytes().count(b"\n") > before + 2)
        os.kill(command.pid, number)
        status = command.wait(30)
        assert command.stderr is not None
        said = command.stderr.read()
        command.stderr.close()
        if number == signal.SIGINT:
            assert (status, "the same command goes on" in said) == (130, True)
        _wait_for(lambda pid=command.pid: not _session(pid))
    kept = rows.read_bytes().count(b"\n") - 1
    study = read_study(tmp_path / "study.xml")
    again = conduct(study, rows.parent, workers=0)
    assert (len(again.rows), again.made) == (150, 150 - kept)


def test_an_fmu_that_crashes_costs_the_run_that_it_has_ended(tmp_path: Path) -> None:
    study = crashing_study(tmp_path, "9 s, 8 s, 0.2 s, 7 s")
    outcome = conduct(study, tmp_path, workers=1)
    assert [row.status for row in outcome.rows] == [PASSED, PASSED, BROKEN, PASSED]
    assert re.search("leader at t = 0.2 s: the plant car.fmu did not complete the step", outcome.rows[2].message)
    seen = tmp_path / "elsewhere" / "deep"
    seen.mkdir(parents=True)
    (seen / "run.xml").write_text(as_variant(study, Plan(study)[2], seen))
    assert cosim.read_scenario(seen / "run.xml").plants["car"].fmu == tmp_path / "elsewhere" / "deep" / "../../car.fmu"


def _wait_for(condition: Callable[[], bool]) -> None:
    give_up = time.monotonic() + 120
    while not condition():
        assert time.monotonic() < give_up
        time.sleep(0.02)


def _session(leader: int) -> list[str]:
    """Return the processes of a session that have not ended."""
    listed = subprocess.run(["ps", "-wweo", "sid,stat,args"], capture_output=True, text=True, check=True).stdout
    rows = (line.split(None, 2) for line in listed.splitlines()[1:])
    return [args for sid, stat, args in rows if int(sid) == leader and not stat.startswith("Z")]


@pytest.mark.parametrize("options", [["--workers", "0"], ["--runs", "-1"], ["--set", "nowhere/@x=1"]])
def test_options_that_make_no_sense(tmp_path: Path, options: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    path = write_study(tmp_path)
    assert main(["study", str(path), "--out", str(tmp_path / "runs"), *options]) == 2
    assert options[0] in capsys.readouterr().err
