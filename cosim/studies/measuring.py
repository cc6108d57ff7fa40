"""The figures of a run: of each measure that a run gives, over its followers; and sums of these.

Sums are made of the rows and not kept with them, so that other weights need no other runs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

from cosim.results.verdict import Verdict
from cosim.studies.row import BROKEN, Row
from cosim.studies.study import Cost, Measured


def made_by_runs(measures: Iterable[Measured]) -> tuple[Measured, ...]:
    """Return the measures that a run gives: all but sums."""
    return tuple(measured for measured in measures if not measured.parts)


def figure_over(measured: Measured, verdicts: Iterable[Verdict]) -> float:
    """Return the figure of a measure over the robots; one without a figure is the worst there is."""
    worst = math.inf if measured.greatest_is_worst else -math.inf
    figures = [worst if math.isnan(verdict.figure) else verdict.figure for verdict in verdicts]
    if not figures:
        return worst
    if measured.over == "count":
        return float(sum(map(math.isfinite, figures)))
    if measured.over == "mean":
        return math.fsum(figures) / len(figures)
    return max(figures) if measured.greatest_is_worst else min(figures)


def total(costs: Iterable[Cost], figures: Sequence[float]) -> float:
    """Return a sum of measures, each over its quantity; infinite if one has no figure."""
    parts = [figures[cost.of] / cost.per for cost in costs]
    return math.fsum(parts) if all(map(math.isfinite, parts)) else math.inf


def with_sums(measures: Sequence[Measured], row: Row) -> Row:
    """Return the row of a run with all measures, sums as well."""
    if not any(measured.parts for measured in measures):
        return row
    made, figures = iter(row.measures), []
    for measured in measures:
        if not measured.parts:
            figures.append(next(made))
        else:
            figures.append(math.nan if row.status == BROKEN else total(measured.parts, figures))
    return replace(row, measures=tuple(figures))
