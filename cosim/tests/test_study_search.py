"""Searches for the worst case: planted faults are found, and each is a scenario that fails."""

import json
import math
import random
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cosim.cli import main
from cosim.errors import InputError
from cosim.studies.conduct import check_study, conduct
from cosim.studies.figure_search import draw, picture
from cosim.studies.plan import Run
from cosim.studies.reader import read_study
from cosim.studies.row import BROKEN, FAILED, PASSED, Row
from cosim.studies.searching import Searching
from cosim.studies.store import FILE
from cosim.studies.summary import remarkable
from cosim.tests.studies import LAST, MASS, SEEDS, UNIFORM, Played, small_study, write_study

BEARING = """<vary name="bearing" select="follower[@id='follower_1']/desired/@bearing">
<uniform from="-40 deg" to="40 deg"/></vary>"""
BUDGET = 150


def search(runs: int = BUDGET, more: str = "") -> str:
    return f'<search runs="{runs}" {more}/>'


class Pit:
    """A margin of 0.5 everywhere but near a payload and a bearing, where it fails; low, and yet passing, elsewhere.

    It fails in 0.3 % of the area.
    """

    def __init__(self, where: tuple[float, float], decoy: tuple[float, float] | None) -> None:
        self._where, self._decoy = np.array(where), decoy

    def __call__(self, run: Run, key: str) -> Row:
        mass, bearing = (float(str(value).split()[0]) for value in run.values[:2])
        point = np.array([(mass - 25.0) / 15.0, (bearing + 40.0) / 80.0])
        least = 0.5 - 0.6 * math.exp(-(((point - self._where) / 0.05) ** 2).sum() / 2.0)
        if self._decoy is not None:
            least -= 0.3 * math.exp(-(((point - self._decoy) / 0.25) ** 2).sum() / 2.0)
        status = FAILED if least < 0.0 else PASSED
        return Row(key, run.number, run.draw, run.values, status, (), (least,), "", least)


def places(seed: int) -> tuple[tuple[float, float], tuple[float, float]]:
    at = np.random.default_rng(seed).uniform(0.1, 0.9, 4)
    return (at[0], at[1]), (at[2], at[3])


@pytest.mark.parametrize("decoy", [False, True])
def test_a_narrow_fault_is_found_where_random_search_rarely_does(tmp_path: Path, decoy: bool) -> None:
    study = small_study(tmp_path, UNIFORM + BEARING, search(more='stop="early"'), rest="")
    assert study.search is not None
    found = by_chance = 0
    for seed in range(30):
        where, low = places(seed)
        pit = Pit(where, low if decoy else None)
        searching = Searching(study, replace(study.search, seed=seed), BUDGET)
        while (asked := searching.ask(4)) and searching.take([pit(run, "") for run in asked]):
            pass
        worst = searching.worst()
        assert worst is not None
        found += bool(worst.failing)
        assert len(searching.rows) <= BUDGET
        draws = np.random.default_rng(1000 + seed).random((BUDGET, 2))
        by_chance += any(_least(pit, draw) < 0.0 for draw in draws)
    assert found >= 29
    assert decoy or by_chance < 15  # the decoy makes the region a little larger


def _least(pit: Pit, draw: "np.ndarray[tuple[int], np.dtype[np.float64]]") -> float:
    values = (f"{25.0 + 15.0 * draw[0]} kg", f"{-40.0 + 80.0 * draw[1]} deg")
    return pit(Run(1, 1, (), values, ()), "").least


def test_the_least_margin_is_sought_and_the_first_failures_are_not_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = small_study(tmp_path, UNIFORM + BEARING, search(), rest="")
    (tmp_path / "out").mkdir()
    outcome = conduct(study, tmp_path / "out", executor=Played(monkeypatch, Pit((0.31, 0.77), None)))
    assert outcome.worst is not None
    assert -0.1 <= outcome.worst.row.least < -0.099
    assert len(outcome.rows) == BUDGET
    (verdict,) = outcome.verdicts
    assert (verdict.passed, verdict.unit) == (False, "%")
    assert "do not pass" in verdict.detail
    shown = remarkable(outcome)
    assert outcome.worst.row.number in shown
    assert set(shown) <= {row.number for row in outcome.worst.failing}
    figure = draw(outcome)
    figure.canvas.draw()
    for panel in figure.axes[:-1]:  # the last one is the colour bar
        height = panel.yaxis.label.get_window_extent().height
        assert height < 1.2 * panel.get_window_extent().height, "the label is as long as its panel"
    assert picture(outcome)[:4] == b"\x89PNG"


def test_the_same_search_with_one_worker_or_four_and_after_any_interruption(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = small_study(tmp_path, UNIFORM + BEARING + SEEDS, search(60, 'stop="early"'), rest="")
    (tmp_path / "out").mkdir()
    pit = Pit((0.4, 0.4), (0.8, 0.8))
    whole = conduct(study, tmp_path / "out", executor=Played(monkeypatch, pit))
    labels = [panel.get_xlabel() for panel in draw(whole).axes if panel.get_xlabel()]
    assert labels == ["run", "mass [kg]", "bearing [deg]", "mass [kg]"], "a seed is nothing that is searched"
    lines = (tmp_path / "out" / FILE).read_bytes().splitlines(keepends=True)
    for kept in (0, 20):
        rows = random.Random(kept).sample(lines[1:], kept)
        (tmp_path / "out" / FILE).write_bytes(lines[0] + b"".join(rows))
        for workers in (1, 4):
            again = conduct(study, tmp_path / "out", executor=Played(monkeypatch, pit), workers=workers)
            assert (again.rows, again.verdicts) == (whole.rows, whole.verdicts)


def test_a_run_without_a_margin_is_worst_and_does_not_stop_the_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks(run: Run, key: str) -> Row:
        row = Pit((0.5, 0.5), None)(run, key)
        return (
            replace(row, status=BROKEN, least=-math.inf)
            if run.number % 7 == 0
            else replace(row, status=PASSED, least=math.inf)
        )

    study = small_study(tmp_path, UNIFORM + BEARING, search(60), rest="")
    (tmp_path / "out").mkdir()
    outcome = conduct(study, tmp_path / "out", executor=Played(monkeypatch, breaks))
    assert outcome.worst is not None
    assert [row.number for row in outcome.worst.failing] == [*range(7, 61, 7)]
    assert picture(outcome)[:4] == b"\x89PNG"


def test_each_counterexample_is_a_scenario_that_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a start that is too far away, in one corner of three values, one of them a list."""
    far = """<vary name="x" select="follower[@id='follower_1']/pose/@x"><uniform from="-6 m" to="-5 m"/></vary>"""
    gain = """<vary name="K_p" select="//gain[@name='K_p']/@value"><list values="5, 10, 20"/></vary>"""
    write_study(tmp_path, far + gain + SEEDS, search(24, 'batch="6" fails="too far"'), rest=LAST)
    base = tmp_path / "base.xml"
    least = re.sub('below="99 m"', 'below="6.11 m" robots="follower_1"', base.read_text())
    base.write_text(least)
    monkeypatch.chdir(tmp_path)
    assert main(["check", "study.xml"]) == 0
    assert "a search for the worst case in at most 24 runs" in capsys.readouterr().out
    assert main(["study", "study.xml", "--workers", "1"]) == 1
    printed = capsys.readouterr().out
    assert "fails as known: too far" in printed
    summary = json.loads((tmp_path / "runs/small/summary.json").read_text())
    worst = summary["worst"]
    assert worst["least_margin_over_bound"] == min(0.0, worst["least_margin_over_bound"]) != 0.0
    file = tmp_path / "runs" / "small" / "runs_to_see" / f"run_{worst['run']}.xml"
    assert main(["run", str(file), "--no-figure"]) == 1
    said = worst["message"].partition(": ")[2]
    assert said.startswith("final range_error below 6.11 m")
    assert said in capsys.readouterr().out
    assert pytest.main(["-q", "-p", "no:cacheprovider", "-p", "no:xdist", str(file)]) == 1
    assert said in capsys.readouterr().out


BAD = {
    "no budget": (UNIFORM, '<search runs="0"/>', "is not a whole number from 1"),
    "no end": (
        f'<vary name="m" select="{MASS}"><normal mean="30 kg" deviation="1 kg"/></vary>',
        search(),
        "'m' has no end",
    ),
    "crossed": (
        '<vary name="gain" cross="yes" select="//gain[@name=\'K_p\']/@value"><list values="1, 2"/></vary>',
        search(),
        "'gain' is crossed, and a search chooses all values",
    ),
    "nothing": (SEEDS, search(), "nothing is left to search"),
    "both": (UNIFORM, search() + '<sample method="random" runs="3"/>', "<sample> is not expected here"),
}


@pytest.mark.parametrize(("vary", "text", "said"), BAD.values(), ids=BAD)
def test_what_makes_no_sense(tmp_path: Path, vary: str, text: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        small_study(tmp_path, vary, text, rest="")
    assert caught.value.where is not None
    assert caught.value.where.file.endswith("study.xml")


def test_a_scenario_that_expects_nothing_cannot_fail(tmp_path: Path) -> None:
    path = write_study(tmp_path, UNIFORM, search())
    base = tmp_path / "base.xml"
    base.write_text(re.sub("<expect>.*</expect>", "", base.read_text()))
    with pytest.raises(InputError, match="the scenario expects nothing, so that no run can fail"):
        check_study(read_study(path))


def test_nothing_is_said_with_confidence_of_runs_that_were_sought(tmp_path: Path) -> None:
    text = '<mean of="last" below="1 m" confidence="0.9"/>'
    with pytest.raises(InputError, match="the runs of a <search> are sought where they are bad, so that <mean>"):
        check_study(small_study(tmp_path, UNIFORM, search(), rest=LAST + text))
    check_study(small_study(tmp_path, UNIFORM, search(), rest=LAST + '<worst of="last" below="1 m"/>'))
