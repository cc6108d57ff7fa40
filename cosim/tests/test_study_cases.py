"""The cases of a study side by side."""

import csv
import io
import math
from pathlib import Path

import pytest

from cosim.errors import InputError
from cosim.studies import by_case
from cosim.studies.conduct import StudyOutcome, conduct
from cosim.studies.row import Row
from cosim.tests.studies import LAST, SEEDS, UNIFORM, small_study

LAWS = """<vary name="law" cross="yes">
  <case name="soft"/>
  <case name="lost"><set select="//follower[@id='follower_2']/pose/@y" value="-90 m"/></case>
</vary>"""
SETTLED = '<measure name="settled" figure="settling_time" over="count" range="8 m" bearing="180 deg"/>'
WOBBLE = '<measure name="wobble" figure="chatter" signal="torque" component="tau_drive" unit="N.m" over="mean"/>'
ROW = Row("", 1, 1, ("30 kg", "7"), "passed", (1.0,), (), "")


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> StudyOutcome:
    folder = tmp_path_factory.mktemp("cases")
    study = small_study(folder, UNIFORM + LAWS + SEEDS, rest=LAST + SETTLED + WOBBLE)
    (folder / "out").mkdir()
    return conduct(study, folder / "out", workers=0)


def test_each_case_has_its_worst_its_mean_and_its_deviation(outcome: StudyOutcome) -> None:
    soft, lost = by_case.by_case(outcome)
    assert (soft.names, lost.names) == (("soft",), ("lost",))
    assert (soft.passed, lost.passed, soft.broken) == (6, 6, 0)
    own = [row.measures[0] for row in outcome.rows if row.values[1] == "soft"]
    mean = sum(own) / 6
    deviation = math.sqrt(sum((value - mean) ** 2 for value in own) / 5)
    assert vars(soft.figures[0]) == pytest.approx({"worst": max(own), "mean": mean, "deviation": deviation})
    assert lost.figures[0].worst > soft.figures[0].worst + 50_000


def test_followers_that_settle_are_counted_and_fewer_are_worse(outcome: StudyOutcome) -> None:
    followers = len(next(iter(outcome.study.bases.values())).followers)
    soft, lost = by_case.by_case(outcome)
    assert soft.figures[1].worst == followers
    assert lost.figures[1].worst == followers - 1


def test_the_table_has_units(outcome: StudyOutcome) -> None:
    heading, *rows = csv.reader(io.StringIO(by_case.as_csv(outcome)))
    assert heading[:5] == ["law", "passed", "failed", "broken", "last, worst [mm]"]
    assert "settled, mean" in heading
    assert "wobble, deviation [N.m]" in heading
    assert [row[0] for row in rows] == ["soft", "lost"]


def test_without_cases_there_is_no_table(tmp_path: Path) -> None:
    study = small_study(tmp_path)
    assert by_case.by_case(StudyOutcome(study, (ROW,), 1, (), 1, False)) == []


def test_only_followers_that_settle_are_counted(tmp_path: Path) -> None:
    wrong = LAST.replace("<measure", '<measure over="count"')
    with pytest.raises(InputError, match=r'study.xml:\d+:\d+: over="count" of <measure> counts followers that settle'):
        small_study(tmp_path, rest=wrong)
