"""The cases of a study side by side."""

import csv
import io
import math
import re
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


# Sums and differences --------------------------------------------------------------------------------------------

APART = """<measure name="apart" figure="rms" signal="desired_range" unit="m"
 robots="follower_3" minus_robot="follower_1"/>
<measure name="held" figure="effort" signal="desired_range" unit="m.s" robots="follower_1"/>
<measure name="near" figure="distance" unit="cm"/>
<measure name="all"><cost of="apart" per="50 cm"/><cost of="held" per="2 m.s"/><cost of="near" per="1 m"/></measure>
<worst of="all" below="1000"/>"""


def test_sums_and_differences_have_the_values_that_are_known(tmp_path: Path) -> None:
    """Desired ranges are 3 m and 8 m throughout the run of 0.2 s."""
    (tmp_path / "out").mkdir()
    study = small_study(tmp_path, rest=APART)
    outcome = conduct(study, tmp_path / "out", workers=0, runs=2)
    apart, held, near, whole = outcome.rows[0].measures
    assert (apart, held) == pytest.approx((8.0 - 3.0, 0.2 * 3.0))
    assert whole == pytest.approx(apart / 0.5 + held / 2.0 - near / 100.0)
    other = small_study(tmp_path, rest=APART.replace('per="50 cm"', 'per="5 cm"'))
    again = conduct(other, tmp_path / "out", workers=0, runs=2)
    assert again.made == 0, "other weights need no other runs"
    assert again.rows[0].measures[3] == pytest.approx(apart / 0.05 + held / 2.0 - near / 100.0)
    worst = outcome.study.measures[3]
    assert (worst.greatest_is_worst, worst.unit) == (True, "")


def test_measures_that_differ_in_what_is_taken_of_the_followers_alone_may_change_places(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    one, other = LAST, LAST.replace("last", "mean").replace("<measure", '<measure over="mean"')
    assert '"mean"' in other
    first, second = (
        conduct(small_study(tmp_path, rest=text), tmp_path / "out", workers=0, runs=1).rows[0].measures
        for text in (one + other, other + one)
    )
    assert first == second[::-1]
    assert first[0] > first[1]


def test_what_is_measured_otherwise_over_the_followers_is_measured_anew(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    worst, mean = (
        conduct(small_study(tmp_path, rest=text), tmp_path / "out", workers=0, runs=1).rows[0].measures[0]
        for text in (LAST, LAST.replace("<measure", '<measure over="mean"'))
    )
    assert mean < worst


BAD_MEASURES = {
    "neither": ('<measure name="a"/>', "needs figure=..., or <cost> elements that are added up"),
    "both": (
        LAST + '<measure name="a" figure="rms"><cost of="last"/></measure>',
        "a sum of costs: leave figure=...",
    ),
    "unknown": (LAST + '<measure name="a"><cost of="lst"/></measure>', "no measure 'lst': did you mean 'last'?"),
    "itself": (LAST + '<measure name="a"><cost of="a"/></measure>', "'a' is the sum itself: name measures above it"),
    "below": ('<measure name="a"><cost of="last"/></measure>' + LAST, "the study has no measure 'last': add"),
    "unit": (LAST + '<measure name="a"><cost of="last" per="1 kg"/></measure>', 'per="1 kg" of <cost>: '),
    "minus": ('<measure name="a" figure="distance" minus="pose"/>', "has no minus=...: leave it out"),
}


@pytest.mark.parametrize(("rest", "said"), BAD_MEASURES.values(), ids=BAD_MEASURES)
def test_measures_that_make_no_sense(tmp_path: Path, rest: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        small_study(tmp_path, rest=rest)
    assert caught.value.where is not None
    assert caught.value.where.file.endswith("study.xml")
