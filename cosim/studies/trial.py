"""One choice of the values that are tuned, how it went on the draws that it was run on, and its score."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from scipy import stats

from cosim.studies.measuring import total
from cosim.studies.row import BROKEN, PASSED, Row
from cosim.studies.seeking import Point
from cosim.studies.study import Tune


@dataclass
class Trial:
    """A trial.

    Attributes
    ----------
    number : int
        From 1, over all cases and restarts.
    case, restart : int
        The index of the combination of cases; the number of the search, from 1.
    point : array or None
        In the unit cube; None of the scenario's own values.
    values : dict
        The tuned values by their index, as the scenario has them; None for its own.
    rows : dict
        The rows by the number of the draw.
    pruned : bool
        Whether it ended before its last draw.
    score : float
        See `score`; NaN until its runs have come.
    """

    number: int
    case: int
    restart: int
    point: Point | None
    values: Mapping[int, str | None]
    rows: dict[int, Row] = field(default_factory=dict)
    pruned: bool = False
    score: float = math.nan


def cost_of(tune: Tune, row: Row) -> float:
    """Return the cost of a run; infinite if a part of it has no figure."""
    if row.status == BROKEN:
        return math.inf
    return total(tune.costs, row.measures)


def mean_cost(tune: Tune, rows: Iterable[Row]) -> float:
    """Return the mean cost of runs."""
    costs = [cost_of(tune, row) for row in rows]
    return math.fsum(costs) / len(costs) if costs else math.nan


def score(tune: Tune, rows: Sequence[Row]) -> float:
    """Return a number that is the smaller the better the runs of a trial are, and finite.

    Runs that all pass are ordered by their mean cost, between -1 and 1; before any trial in which one fails, by how far
    expectations are from holding, up to 2; and before any in which one breaks.
    """
    broken = sum(row.status == BROKEN for row in rows)
    if broken:
        return 2.0 + broken / len(rows)
    lacks = [_lack(tune, row) for row in rows]
    if any(lacks):
        return 1.0 + math.fsum(lacks) / len(rows)
    cost = mean_cost(tune, rows)
    return cost / (1.0 + abs(cost))


def passes(rows: Iterable[Row]) -> bool:
    """Return whether all runs pass."""
    return all(row.status == PASSED for row in rows)


def _lack(tune: Tune, row: Row) -> float:
    """Return how far the expectations of a run are from holding: above 0 if one fails, at most 1."""
    if math.isinf(cost_of(tune, row)) or row.least == -math.inf:
        return 1.0
    short = max(-row.least, 0.0)
    return max(short / (1.0 + short), 0.0 if row.status == PASSED else math.ulp(0.0))


def is_worse(tune: Tune, trial: Trial, best: Trial, error: float) -> bool:
    """Return whether a trial is worse than the best one on the draws that both have, by Wilcoxon's signed-rank test.

    Parameters
    ----------
    error
        The probability with which it may err.
    """
    shared = [draw for draw in trial.rows if draw in best.rows]
    differences = [score(tune, [trial.rows[draw]]) - score(tune, [best.rows[draw]]) for draw in shared]
    differing = list(filter(None, differences))  # equal pairs do not count, and would make the test an approximate one
    if not differing:
        return False
    return float(stats.wilcoxon(differing, alternative="greater", method="exact").pvalue) <= error
