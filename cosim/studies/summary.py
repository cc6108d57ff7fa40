"""The summary of a study: how many runs passed, the spread of each measure, and the verdicts."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cosim.quantity import quantity
from cosim.results.json_numbers import without_nan
from cosim.scenario.edits import as_setting
from cosim.studies.conduct import StudyOutcome
from cosim.studies.row import BROKEN
from cosim.studies.searching import Worst
from cosim.studies.study import Study
from cosim.studies.tuned_files import as_data


@dataclass(frozen=True)
class Spread:
    """The spread of a measure over the runs that reached their end.

    Attributes
    ----------
    least, quarter, median, three_quarters, greatest : float
        Quantiles of the runs, without a confidence; infinite where a run has no figure.
    worst_run : int
        The number of the run with the worst figure.
    """

    measure: str
    unit: str
    least: float
    quarter: float
    median: float
    three_quarters: float
    greatest: float
    worst_run: int


def counts(outcome: StudyOutcome) -> dict[str, int]:
    """Return how many runs there are of each status."""
    found = Counter(row.status for row in outcome.rows)
    return {status: found[status] for status in ("passed", "failed", "broken")}


def spreads(outcome: StudyOutcome) -> list[Spread]:
    """Return the spread of each measure; none if no run has reached its end."""
    rows = [row for row in outcome.shown if row.status != BROKEN]
    found = []
    for index, measured in enumerate(outcome.study.measures if rows else ()):
        values = np.array([row.measures[index] for row in rows])
        worst = int(values.argmax() if measured.greatest_is_worst else values.argmin())
        least, quarter, median, three_quarters, greatest = np.quantile(
            values, [0.0, 0.25, 0.5, 0.75, 1.0], method="inverted_cdf"
        ).tolist()
        worst_run = rows[worst].number
        found.append(Spread(measured.name, measured.unit, least, quarter, median, three_quarters, greatest, worst_run))
    return found


def as_json(outcome: StudyOutcome) -> str:
    """Return the summary as JSON; numbers that are not finite are null."""
    data = {
        "study": outcome.study.name,
        "mark": outcome.mark,
        "title": outcome.study.title,
        "scenario": str(next(iter(outcome.study.bases.values())).path),
        "changes": [*map(as_setting, outcome.study.changes)],
        "planned": outcome.planned,
        "runs": len(outcome.rows),
        "ended_early": outcome.early,
        **counts(outcome),
        "measures": [asdict(spread) for spread in spreads(outcome)],
        "bounds": [*_bounds(outcome.study)],
        **({"tuned": as_data(outcome.study, tune, outcome.tuned)} if (tune := outcome.study.tune) else {}),
        **({"sensitivity": [one.as_data() for one in found]} if (found := outcome.sensitivities) else {}),
        **({"worst": _worst_data(outcome.study, outcome.worst)} if outcome.worst else {}),
        "holds": outcome.passed if outcome.verdicts else None,
        "verdicts": [asdict(verdict) for verdict in outcome.verdicts],
    }
    return json.dumps(without_nan(data), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _bounds(study: Study) -> Iterator[dict[str, Any]]:
    """Return the bounds of what must hold of each run's figure, in the measure's unit."""
    units = {measured.name: measured.unit for measured in study.measures}
    for one in study.requirements:
        side = "below" if "below" in one.attributes else "above"
        if one.kind in ("quantile", "worst", "mean") and (of := one.attributes["of"]) in units:
            bound = quantity(one.attributes[side], units[of] or "1")
            given = {"given": one.given_in_words} if one.given else {}
            yield {"measure": of, "kind": one.kind, side: bound, **given}


def _worst_data(study: Study, worst: Worst) -> dict[str, Any]:
    row = worst.row
    return {
        "run": row.number,
        "status": row.status,
        "least_margin_over_bound": row.least,
        "values": {vary.name: value for vary, value in zip(study.vary, row.values, strict=True)},
        "margins": list(row.margins),
        "message": row.message,
        "failing": [failing.number for failing in worst.failing],
    }


def remarkable(outcome: StudyOutcome, most: int = 10) -> list[int]:
    """Return the numbers of runs to look at: the first broken and failed ones, and the worst of each measure.

    Of a search, they are those with the least margins.
    """
    numbers: list[int] = []
    rows = outcome.shown
    if outcome.worst is not None:
        rows = outcome.worst.failing
        numbers.append(outcome.worst.row.number)
    for status in ("broken", "failed"):
        numbers += [row.number for row in rows if row.status == status][:most]
    numbers += [spread.worst_run for spread in spreads(outcome)]
    return sorted(set(numbers))
