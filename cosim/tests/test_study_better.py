"""A law is called better no more often than the confidence allows if it is not, and often enough if it is.

Figures are made up, and go through the study's own verdict.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from scipy import stats

from cosim.results.verdict import Verdict
from cosim.studies.requirements import requirements_of
from cosim.studies.row import BROKEN, PASSED, Row
from cosim.tests.studies import LAST, SEEDS, small_study

LAWS = '<vary name="law" cross="yes"><case name="one"/><case name="other"/></vary>'
Judge = Callable[[Sequence[Row]], Verdict]


@cache
def judge_of(text: str) -> Judge:
    with TemporaryDirectory() as folder:
        (judged,) = requirements_of(small_study(Path(folder), LAWS + SEEDS, rest=LAST + text))
    return judged.judge


def better(confidence: float, by: str = "less") -> Judge:
    return judge_of(f'<better of="last" vary="law" case="one" than="other" by="{by}" confidence="{confidence}"/>')


def rows(pairs: Sequence[tuple[float, float]]) -> list[Row]:
    """Return runs of two laws on the same draws; one without a figure is broken."""
    return [
        Row("", 2 * draw + place, draw, (law, str(draw)), BROKEN if math.isnan(figure) else PASSED, (figure,), (), "")
        for draw, pair in enumerate(pairs, 1)
        for place, (law, figure) in enumerate(zip(("one", "other"), pair, strict=True))
    ]


def outcomes(wins: int, ties: int, losses: int) -> list[Row]:
    return rows([(1.0, 2.0)] * wins + [(1.0, 1.0)] * ties + [(2.0, 1.0)] * losses)


@pytest.mark.parametrize("confidence", [0.8, 0.95, 0.99])
@pytest.mark.parametrize("tie", [0.0, 0.5])
def test_equal_laws_are_told_apart_no_more_often_than_it_says(confidence: float, tie: float) -> None:
    """By enumeration of how many draws each law wins, and how many neither does."""
    greatest = 0.0
    for draws in (1, 2, 5, 8, 13, 24):
        errs = sum(
            stats.multinomial.pmf((wins, ties, draws - wins - ties), draws, ((1 - tie) / 2, tie, (1 - tie) / 2))
            for wins, ties in product(range(draws + 1), range(draws + 1 if tie else 1))
            if wins + ties <= draws and better(confidence)(outcomes(wins, ties, draws - wins - ties)).passed
        )
        assert errs <= 1.0 - confidence + 1e-12
        greatest = max(greatest, errs)
    assert greatest > 0.3 * (1.0 - confidence), "a verdict that never errs says too little"


def test_equal_laws_of_any_distribution_in_many_seeded_studies() -> None:
    """Figures are skewed, rounded, and without an end or a run now and then; both laws share what the draw gives."""
    generator = np.random.default_rng(15)
    called = 0
    for _ in range(600):
        shared = generator.exponential(size=(20, 1))
        figures = np.round(shared + generator.lognormal(0.0, 2.0, (20, 2)), 1)
        figures[generator.random((20, 2)) < 0.05] = math.inf
        figures[generator.random((20, 2)) < 0.05] = math.nan
        called += better(0.95)(rows([(float(one), float(other)) for one, other in figures])).passed
    assert 0 < called <= 600 * 0.05


@pytest.mark.parametrize("by", ["less", "more"])
def test_laws_that_differ_are_told_apart(by: str) -> None:
    """One is better by half of what the laws scatter: in three draws of four, or so."""
    generator = np.random.default_rng(4)
    sign = 1.0 if by == "less" else -1.0
    found = dict.fromkeys((sign, -sign), 0)
    for _ in range(100):
        figures = 5.0 + generator.normal(size=(60, 1)) + generator.normal(size=(60, 2)) / math.sqrt(2.0)
        for better_one in found:
            moved = figures - [0.6745 * better_one, 0.0]
            found[better_one] += better(0.95, by)(rows([(float(one), float(other)) for one, other in moved])).passed
    assert found[sign] >= 95
    assert found[-sign] == 0


def test_a_better_law_is_found_as_often_as_the_exact_test_can() -> None:
    """By enumeration: the power of 30 draws, of which the better law wins 80 % on average."""
    judge = better(0.95)
    chances = stats.binom.pmf(np.arange(31), 30, 0.8)
    power = sum(chance for wins, chance in enumerate(chances) if judge(outcomes(wins, 0, 30 - wins)).passed)
    assert power == pytest.approx(stats.binom.sf(19, 30, 0.8))  # 20 wins: by chance in 4.9 %
    assert power > 0.97


@pytest.mark.parametrize("below", [True, False])
@pytest.mark.parametrize("at", [0.5, 0.75])
@pytest.mark.parametrize("shares", [(0.5, 0.25, 0.25), (0.2, 0.3, 0.5), (0.75, 0.2, 0.05)])
def test_the_verdict_on_a_quantile_errs_no_more_often_than_it_says(
    below: bool, at: float, shares: tuple[float, ...]
) -> None:
    """By enumeration of all outcomes of a measure that has three values."""
    figures, up_to = (1.0, 2.0, 3.0), np.cumsum(shares)
    place = np.flatnonzero(up_to >= at - 1e-12 if below else up_to > at + 1e-12)[0]
    name, bound = ("below", figures[place] - 1e-6) if below else ("above", figures[place] + 1e-6)  # it does not hold
    judge = judge_of(f'<quantile of="last" at="{at}" {name}="{bound!r} mm" confidence="0.9"/>')
    errs = 0.0
    for one, other in product(range(15), repeat=2):
        if (third := 14 - one - other) >= 0:
            made = np.repeat(figures, (one, other, third)).tolist()
            runs = [Row("", k, k, ("one", ""), PASSED, (figure,), (), "") for k, figure in enumerate(made, 1)]
            errs += stats.multinomial.pmf((one, other, third), 14, shares) * judge(runs).passed
    assert errs <= 0.1 + 1e-12


def test_draws_are_paired_whatever_a_case_alone_has(tmp_path: Path) -> None:
    text = '<better of="last" vary="law" case="one" than="other" confidence="0.9"/>'
    gain = """<vary name="gain" case="one" select="//gain[@name='K_p']/@value"><uniform from="1" to="9"/></vary>"""
    (judged,) = requirements_of(small_study(tmp_path, LAWS + gain, rest=LAST + text))
    runs = [
        Row("", 2 * draw + place, draw, (law, gain), PASSED, (float(place),), (), "")
        for draw in range(9)
        for place, (law, gain) in enumerate((("one", "2"), ("other", None)))
    ]
    assert judged.judge(runs).detail == "in 9 of 9 pairs"
