"""A law is called better no more often than the confidence allows if it is not, and often enough if it is.

Figures are made up, and go through the study's own verdict.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import cache
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from scipy import stats

from cosim.errors import InputError
from cosim.results.verdict import Verdict
from cosim.studies.plan import Plan
from cosim.studies.requirements import requirements_of
from cosim.studies.row import BROKEN, FAILED, PASSED, Row
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


# Runs that share a draw ------------------------------------------------------------------------------------------

LOADS = '<vary name="load" cross="yes"><case name="light"/><case name="heavy"/></vary>'


def shared(figures: Mapping[tuple[str, str], Sequence[float]], fails: float = math.inf) -> list[Row]:
    """Return runs of two laws with two loads on the same draws; a run whose figure is too great fails."""
    return [
        Row("", 0, draw, (law, load, str(draw)), PASSED if figure < fails else FAILED, (figure,), (), "")
        for draw in range(1, 1 + len(next(iter(figures.values()))))
        for (law, load), own in figures.items()
        for figure in [own[draw - 1]]
    ]


def judge_shared(text: str) -> Judge:
    with TemporaryDirectory() as folder:
        (judged,) = requirements_of(small_study(Path(folder), LAWS + LOADS + SEEDS, rest=LAST + text))
    return judged.judge


EVERY = [(law, load) for law in ("one", "other") for load in ("light", "heavy")]


@pytest.mark.parametrize(
    "text",
    [
        '<probability of="passed" above="0.5" confidence="0.9"/>',
        '<probability of="passed" above="0.5" confidence="0.9" stop="early"/>',
        '<quantile of="last" at="0.5" below="0.5 mm" confidence="0.9"/>',
        '<mean of="last" below="0.45 mm" confidence="0.9"/>',
    ],
)
def test_runs_of_a_draw_that_are_all_alike_count_once(text: str) -> None:
    """If half of the draws fail, whatever the law and the load, a verdict errs in one study of ten, not in four."""
    judge, generator, said = judge_shared(text), np.random.default_rng(7), 0
    for _ in range(200):
        draws = generator.integers(0, 2, 20) + 0.01 * generator.random(20)
        draws = draws if "mean" not in text else draws - 0.05  # of which the mean is what must not be shown
        said += judge(shared(dict.fromkeys(EVERY, draws.tolist()), fails=0.5)).passed
    assert said <= 200 * 0.1 + 12


def test_a_draw_is_won_by_most_of_its_pairs() -> None:
    judge = judge_shared('<better of="last" vary="law" case="one" than="other" confidence="0.9"/>')
    alike = {("one", "light"): [1.0] * 3, ("one", "heavy"): [2.0] * 3, ("other", "light"): [2.0] * 3}
    found = judge(shared(alike | {("other", "heavy"): [3.0] * 3}))
    assert (found.passed, found.detail) == (False, "in 3 of 3 draws, each by most of its 2 pairs")
    split = judge(shared(alike | {("other", "heavy"): [1.0] * 3}))
    assert split.detail == "in 0 of 3 draws, each by most of its 2 pairs, 3 of them equal"


def test_one_condition_may_be_given() -> None:
    given = '<given vary="load" is="light"/>'
    better = f'<better of="last" vary="law" case="one" than="other" confidence="0.9">{given}</better>'
    figures = {("one", "light"): [1.0] * 9, ("one", "heavy"): [9.0] * 9, ("other", "light"): [2.0] * 9}
    runs = shared(figures | {("other", "heavy"): [3.0] * 9}, fails=5.0)
    found = judge_shared(better)(runs)
    assert (found.passed, found.detail) == (True, "in 9 of 9 pairs")
    assert found.expectation == "one better than other in last given load light, with confidence 0.9"
    whole = '<probability of="passed" above="0.7" confidence="0.9"/>'
    assert judge_shared(whole)(runs).detail == "0 of 9 draws of 4 runs"
    light = judge_shared(whole.replace("/>", f">{given}</probability>"))(runs)
    assert (light.passed, light.detail) == (True, "9 of 9 draws of 2 runs")
    one = whole.replace("/>", f'>{given}<given vary="law" is="one"/></probability>')
    assert judge_shared(one)(runs).detail == "9 of 9 runs"


def test_each_run_counts_if_nothing_is_drawn() -> None:
    seeds = '<vary name="seed" select="simulation/@seed" cross="yes"><range from="1" to="9"/></vary>'
    better = '<better of="last" vary="law" case="one" than="other" confidence="0.9"/>'
    with TemporaryDirectory() as folder:
        (judged,) = requirements_of(
            small_study(Path(folder), LAWS + seeds, '<sample method="grid"/>', rest=LAST + better)
        )
    runs = [
        Row(f"run {number}", number, 1, (law, str(seed)), PASSED, (float(place),), (), "")
        for number, (seed, (place, law)) in enumerate(product(range(1, 10), enumerate(("one", "other"))), 1)
    ]
    assert judged.judge(runs).detail == "in 9 of 9 pairs"


SEED = '<vary name="seed" select="simulation/@seed"><range from="1" to="9"/></vary>'
LOAD = '<vary name="load" select="follower[@id=\'follower_1\']/pose/@y"><grid from="1 m" to="5 m" points="5"/></vary>'
ONE_END = '<vary name="end" select="simulation/@horizon"><list values="0.2 s"/></vary>'
CONFIDENT = (
    '<probability of="passed" above="0.5" confidence="0.9" stop="early"/>',
    '<quantile of="last" at="0.5" below="1 m" confidence="0.9"/>',
    '<mean of="last" below="1 m" confidence="0.9"/>',
)
BETTER = '<better of="last" vary="law" case="one" than="other" confidence="0.9"/>'


def crossed(vary: str) -> str:
    return vary.replace(" select", ' cross="yes" select')


@pytest.mark.parametrize("method", ["grid", "one_at_a_time"])
@pytest.mark.parametrize("text", [*CONFIDENT, BETTER])
def test_values_that_are_not_drawn_are_refused_a_confidence(tmp_path: Path, text: str, method: str) -> None:
    for vary in (LAWS + LOAD, LAWS + LOAD + SEED, LAWS + crossed(LOAD), LAWS + crossed(LOAD) + crossed(SEED)):
        study = small_study(tmp_path, vary, f'<sample method="{method}"/>', LAST + text)
        with pytest.raises(InputError, match=r"the values of '(law|load)' are not drawn by chance") as caught:
            requirements_of(study)
        assert caught.value.where == study.requirements[0].where
    same = small_study(tmp_path, LAWS, '<sample method="random" runs="9"/>', LAST + text)
    with pytest.raises(InputError, match='all draws are the same: give method="grid"'):
        requirements_of(same)


@pytest.mark.parametrize("text", CONFIDENT)
def test_runs_that_differ_by_nothing_drawn_are_refused_a_confidence(tmp_path: Path, text: str) -> None:
    """Of 9 equal runs all pass or none."""
    one = '<vary name="law" select="//controller/@name"><list values="neural-adaptive-pid"/></vary>'
    random = '<sample method="random" runs="9"/>'
    for vary in (one, one + crossed(LOAD)):
        with pytest.raises(InputError, match="nothing is drawn by which runs differ"):
            requirements_of(small_study(tmp_path, vary, random, LAST + text))
    assert len(requirements_of(small_study(tmp_path, one + SEED, random, LAST + text))) == 1


OF_ONE = '<vary name="mass" case="{}" select="plant/parameter[@name=\'m_c\']/@value">{}</vary>'
UNIFORM = '<uniform from="25 kg" to="40 kg"/>'


@pytest.mark.parametrize("text", CONFIDENT)
def test_values_that_do_not_reach_the_runs_that_count_are_no_draws(tmp_path: Path, text: str) -> None:
    """Of 9 equal runs of a case all pass or none, however the other case's differ."""
    tag = text[1:].partition(" ")[0]
    random = '<sample method="random" runs="9"/>'
    for law, said in (("one", ""), ("other", "nothing is drawn by which runs differ")):
        given = text.replace("/>", f'><given vary="law" is="{law}"/></{tag}>')
        for laws in (LAWS, LAWS.replace(' cross="yes"', "")):
            study = small_study(tmp_path, laws + OF_ONE.format("one", UNIFORM), random, LAST + given)
            with pytest.raises(InputError, match=said) if said else nullcontext():
                requirements_of(study)


def test_laws_are_compared_on_values_of_their_own(tmp_path: Path) -> None:
    laws = LAWS.replace("</vary>", '<case name="third"/></vary>')
    random = '<sample method="random" runs="9"/>'
    for case in ("one", "other"):
        study = small_study(tmp_path, laws + OF_ONE.format(case, UNIFORM), random, LAST + BETTER)
        assert len(requirements_of(study)) == 1
    with pytest.raises(InputError, match="nothing is drawn by which runs differ"):
        requirements_of(small_study(tmp_path, laws + OF_ONE.format("third", UNIFORM), random, LAST + BETTER))


@pytest.mark.parametrize("text", CONFIDENT)
@pytest.mark.parametrize(
    "values",
    [
        '<uniform from="30 kg" to="30 kg"/>',
        '<log_uniform from="30 kg" to="30 kg"/>',
        '<uniform from="30 kg" to="30.0000000001 kg"/>',
        '<grid from="30 kg" to="30 kg" points="4"/>',
    ],
)
def test_values_without_spread_are_no_draws(tmp_path: Path, text: str, values: str) -> None:
    vary = OF_ONE.format("", values).replace(' case=""', "")
    with pytest.raises(InputError, match="nothing is drawn by which runs differ"):
        requirements_of(small_study(tmp_path, vary, '<sample method="random" runs="9"/>', LAST + text))


GIVEN_OTHER = '<given vary="law" is="other"/>'
SEED_OF_ONE = '<vary name="own" case="one" select="simulation/@seed"><range from="1" to="9"/></vary>'
SEED_OF_OTHER = SEED_OF_ONE.replace('"own" case="one"', '"others" case="other"')


@pytest.mark.parametrize(
    ("vary", "method", "detail"),
    [
        (LAWS + SEED_OF_ONE, "grid", "1 of 1 runs"),
        (LAWS + crossed(SEED_OF_ONE), "grid", "1 of 1 runs"),
        (LAWS + SEED_OF_ONE + SEED_OF_OTHER, "grid", "9 of 9 runs"),
        (LAWS + crossed(SEED_OF_ONE) + crossed(SEED_OF_OTHER), "grid", "9 of 9 runs"),
        (LAWS + SEED_OF_ONE + SEED_OF_OTHER, "one_at_a_time", "9 of 9 runs"),
    ],
)
@pytest.mark.parametrize("early", ["", ' stop="early"'])
def test_runs_that_are_the_same_count_once(tmp_path: Path, vary: str, method: str, detail: str, early: str) -> None:
    """The scenario's own seed is 1, as is the first one of each range."""
    ask = f'<probability of="passed" above="0.9" confidence="0.999"{early}>{GIVEN_OTHER}</probability>'
    study = small_study(tmp_path, vary, f'<sample method="{method}"/>', LAST + ask)
    (judged,) = requirements_of(study)
    own = next(index for index, one in enumerate(study.vary) if one.cases)
    rows = [
        Row("|".join((run.values[own] or "", *run.changes)), run.number, run.draw, run.values, PASSED, (1.0,), (), "")
        for run in Plan(study)
    ]
    assert detail.partition(" of ")[2] in judged.judge(rows).detail


def test_seeds_that_do_not_vary_together_are_refused_a_confidence(tmp_path: Path) -> None:
    """Each run shares a seed with others: 81 runs tell as much as 9, if the other seed has no effect."""
    for vary in (LAWS + SEED_OF_ONE + SEED_OF_OTHER, LAWS + crossed(SEED_OF_ONE) + crossed(SEED_OF_OTHER)):
        with pytest.raises(InputError, match="the seeds 'own' and 'others' do not vary together") as caught:
            requirements_of(small_study(tmp_path, vary, '<sample method="grid"/>', LAST + BETTER))
        assert caught.value.where is not None


@pytest.mark.parametrize("text", [*CONFIDENT, BETTER])
def test_seeds_are_draws_of_a_grid_and_so_are_runs_with_a_given_value(tmp_path: Path, text: str) -> None:
    grid = '<sample method="grid"/>'
    assert len(requirements_of(small_study(tmp_path, LAWS + crossed(LOAD) + SEED + ONE_END, grid, LAST + text))) == 1
    tag = text[1:].partition(" ")[0]
    given = text.replace("/>", f'><given vary="load" is="2 m"/></{tag}>')
    assert len(requirements_of(small_study(tmp_path, LAWS + LOAD + SEED, grid, LAST + given))) == 1
    random = '<sample method="random" runs="9"/>'
    assert len(requirements_of(small_study(tmp_path, LAWS + LOAD + SEED, random, LAST + text))) == 1
    assert len(requirements_of(small_study(tmp_path, LAWS + LOAD, grid, LAST + '<worst of="last" below="1 m"/>'))) == 1


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ('vary="lod" is="light"', "nothing varies that is named 'lod': did you mean 'load'?"),
        ('vary="load" is="lihgt"', "'load' has no value 'lihgt': did you mean 'light'?"),
        ('vary="seed" is="7"', "'seed' has another value in each draw"),
        ('vary="law" is="one"', "'law' is compared"),
    ],
)
def test_what_is_given_exists(given: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        judge_shared(f'<better of="last" vary="law" case="one" than="other" confidence="0.9"><given {given}/></better>')
    assert caught.value.where is not None
