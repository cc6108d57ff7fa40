"""Confidence bounds that hold for every distribution: of a probability, of a quantile; and of a mean, for many values.

Each is one-sided and may err with a probability of at most 1 - confidence.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy import special, stats


def probability_at_least(successes: int, trials: int, confidence: float) -> float:
    """Return the lower bound of a probability (Clopper and Pearson 1934): exact, by the binomial distribution."""
    if successes == 0:
        return 0.0
    return float(special.betaincinv(successes, trials - successes + 1, 1.0 - confidence))


def probability_at_most(successes: int, trials: int, confidence: float) -> float:
    """Return the upper bound of a probability; see `probability_at_least`."""
    return 1.0 - probability_at_least(trials - successes, trials, confidence)


def trials_for(probability: float, confidence: float) -> int:
    """Return how many successes without a failure show that a probability is greater."""
    return math.floor(math.log(1.0 - confidence) / math.log(probability)) + 1


def quantile_at_most(values: ArrayLike, at: float, confidence: float) -> float:
    """Return the upper bound of a quantile, by order statistics (David and Nagaraja 2003, section 7.1).

    Infinite if there are too few values for the confidence.
    """
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    # the number of values below the quantile is binomial: value number j, from 1, is below it if that is j or more
    place = int(stats.binom.ppf(confidence, len(ordered), at)) + 1
    return float(ordered[place - 1]) if place <= len(ordered) else math.inf


def quantile_at_least(values: ArrayLike, at: float, confidence: float) -> float:
    """Return the lower bound of a quantile; see `quantile_at_most`."""
    return -quantile_at_most(-np.asarray(values, dtype=np.float64), 1.0 - at, confidence)


def mean_at_most(values: ArrayLike, confidence: float) -> float:
    """Return the upper bound of a mean, by Student's distribution: exact for normal values, near for many others."""
    numbers = np.asarray(values, dtype=np.float64)
    if len(numbers) < 2 or not np.isfinite(numbers).all():
        return math.inf
    error = float(np.std(numbers, ddof=1)) / math.sqrt(len(numbers))
    return float(np.mean(numbers)) + float(special.stdtrit(len(numbers) - 1, confidence)) * error


def mean_at_least(values: ArrayLike, confidence: float) -> float:
    """Return the lower bound of a mean; see `mean_at_most`."""
    return -mean_at_most(-np.asarray(values, dtype=np.float64), confidence)


def sign_test(pairs: Sequence[tuple[float, float]], confidence: float, what: str = "pairs") -> tuple[float, str]:
    """Return the lower bound of the probability that the first of a pair is less, and in how many pairs it is.

    Pairs of equal numbers do not count: the exact sign test.
    """
    wins = sum(one < other for one, other in pairs)
    ties = sum(one == other for one, other in pairs)
    decided = len(pairs) - ties
    least = probability_at_least(wins, decided, confidence) if decided else 0.0
    return least, f"in {wins} of {len(pairs)} {what}" + (f", {ties} of them equal" if ties else "")


class Sequential:
    """A test of whether a probability is above a bound, which may be looked at after every outcome.

    It errs with a probability of at most 1 - confidence on either side: the likelihood ratio, averaged over all
    probabilities on the other side of the bound, is a supermartingale, which by Ville's inequality exceeds
    1 / (1 - confidence) as rarely (Robbins 1970).

    Attributes
    ----------
    above : bool or None
        Whether the probability is above the bound; None while that is open.
    """

    def __init__(self, bound: float, confidence: float) -> None:
        self._bound = bound
        self._threshold = -math.log1p(-confidence)
        self._successes = self._failures = 0
        self.above: bool | None = None

    @property
    def trials(self) -> int:
        """How many outcomes count."""
        return self._successes + self._failures

    def add(self, outcome: bool) -> None:
        """Take one more outcome; after the decision, none counts any more."""
        if self.above is not None:
            return
        self._successes, self._failures = self._successes + outcome, self._failures + (not outcome)
        above, below = _log_ratios(self._successes, self._failures, self._bound)
        if max(above, below) >= self._threshold:
            self.above = above > below


def _log_ratios(successes: int, failures: int, bound: float) -> tuple[float, float]:
    """Return the logarithms of the mean likelihoods above and below a bound, each over the likelihood at the bound."""
    whole = special.betaln(successes + 1, failures + 1)
    at_bound = special.xlogy(successes, bound) + special.xlog1py(failures, -bound)
    shares = special.betaincc(successes + 1, failures + 1, bound), special.betainc(successes + 1, failures + 1, bound)
    widths = 1.0 - bound, bound
    above, below = (
        whole + math.log(share) - math.log(width) - at_bound if share > 0.0 and width > 0.0 else -math.inf
        for share, width in zip(shares, widths, strict=True)
    )
    return float(above), float(below)
