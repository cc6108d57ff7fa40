"""Confidence bounds of studies have their coverage: by enumeration of all outcomes, not by sampling."""

import math

import numpy as np
import pytest
from scipy import stats

from cosim.studies import bounds
from cosim.studies.bounds import Sequential

SIZES = (1, 2, 7, 30, 100)
SHARES = (0.001, 0.05, 0.31, 0.5, 0.77, 0.95, 0.999)


@pytest.mark.parametrize("confidence", [0.8, 0.95, 0.999])
def test_the_bound_of_a_probability_covers_it(confidence: float) -> None:
    nearest = 1.0
    for n in SIZES:
        least = np.array([bounds.probability_at_least(good, n, confidence) for good in range(n + 1)])
        most = np.array([bounds.probability_at_most(good, n, confidence) for good in range(n + 1)])
        for share in (*SHARES, *least[1:].tolist()):  # at its bounds the coverage is least
            chances = stats.binom.pmf(np.arange(n + 1), n, share)
            covered = chances[least <= share * (1 + 1e-12)].sum()
            assert covered >= confidence - 1e-9
            assert chances[most >= share * (1 - 1e-12)].sum() >= confidence - 1e-9
            nearest = min(nearest, covered)
    assert nearest < confidence + 0.02, "a bound that covers too much says too little"


def test_the_bound_of_a_probability_has_known_values() -> None:
    assert bounds.probability_at_least(299, 299, 0.95) == pytest.approx(0.05 ** (1 / 299))  # the rule of three
    assert bounds.probability_at_least(0, 10, 0.95) == 0.0
    assert bounds.probability_at_most(10, 10, 0.95) == 1.0
    assert bounds.trials_for(0.99, 0.95) == 299


@pytest.mark.parametrize("at", [0.1, 0.5, 0.9, 0.99])
@pytest.mark.parametrize("confidence", [0.8, 0.95])
def test_the_bound_of_a_quantile_covers_it(at: float, confidence: float) -> None:
    for n in SIZES:
        place = bounds.quantile_at_most(np.arange(1.0, n + 1), at, confidence)
        if math.isinf(place):
            assert 1.0 - at**n < confidence  # not even the greatest value would do
            continue
        # value number j is at least the quantile unless j values or more are below it
        assert stats.binom.cdf(place - 1, n, at) >= confidence
        assert place == 1 or stats.binom.cdf(place - 2, n, at) < confidence, "the next lower one would do"


def test_the_lower_bound_of_a_quantile_mirrors_the_upper_one() -> None:
    values = np.random.default_rng(1).normal(size=80)
    assert bounds.quantile_at_least(values, 0.1, 0.9) == -bounds.quantile_at_most(-values, 0.9, 0.9)
    assert bounds.quantile_at_most([math.inf] * 5 + [1.0] * 95, 0.9, 0.9) == 1.0


def test_the_bound_of_a_mean_is_student_s() -> None:
    values = [1.0, 2.0, 4.0, 8.0]
    expected = stats.ttest_1samp(values, 0.0, alternative="less").confidence_interval(0.95).high
    assert bounds.mean_at_most(values, 0.95) == pytest.approx(expected)
    assert bounds.mean_at_least(values, 0.95) < np.mean(values) < bounds.mean_at_most(values, 0.95)
    assert bounds.mean_at_most([1.0], 0.95) == math.inf
    assert bounds.mean_at_most([1.0, math.inf, 2.0], 0.95) == math.inf


@pytest.mark.parametrize(("bound", "confidence"), [(0.9, 0.9), (0.5, 0.8), (0.99, 0.95)])
@pytest.mark.parametrize("share", [-0.05, 0.0, 0.005])
def test_a_sequential_test_errs_no_more_often_than_it_says(bound: float, confidence: float, share: float) -> None:
    """By the exact distribution of the successes that have led to no decision, after each outcome."""
    true = bound + share
    undecided = np.array([1.0])
    wrongly_above = wrongly_below = 0.0
    for n in range(1, 150):
        undecided = np.append(undecided, 0.0) * (1 - true) + np.insert(undecided, 0, 0.0) * true
        for good in range(n + 1):
            if undecided[good] == 0.0:
                continue
            test = _after(good, n - good, bound, confidence)
            if test is True:
                wrongly_above += undecided[good]
            elif test is False:
                wrongly_below += undecided[good]
            else:
                continue
            undecided[good] = 0.0
    assert wrongly_above <= 1 - confidence or true > bound, "then it is no error"
    assert wrongly_below <= 1 - confidence or true < bound
    assert share or min(wrongly_above, wrongly_below) > 0.0 or bound > 0.98


def _after(good: int, bad: int, bound: float, confidence: float) -> bool | None:
    test = Sequential(bound, confidence)
    test._successes, test._failures = max(good - 1, 0), bad if good else bad - 1
    test.add(good > 0)
    return test.above


def test_a_sequential_test_decides_and_then_takes_nothing_more() -> None:
    test = Sequential(0.9, 0.95)
    for _ in range(1000):
        test.add(True)
    assert test.above is True
    assert test.trials < 60
    failing = Sequential(0.9, 0.95)
    for _ in range(1000):
        failing.add(False)
    assert (failing.above, failing.trials < 5) == (False, True)
