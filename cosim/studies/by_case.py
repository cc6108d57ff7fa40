"""The cases of a study side by side: runs by status, and worst, mean and deviation of each measure."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from cosim.studies.conduct import StudyOutcome
from cosim.studies.row import BROKEN, FAILED, PASSED, Row


@dataclass(frozen=True)
class Figures:
    """A measure over the runs of a case that reached their end; NaN if none did.

    Attributes
    ----------
    worst, mean, deviation : float
        Deviation is the standard deviation from run to run; NaN for fewer than two runs.
    """

    worst: float
    mean: float
    deviation: float


@dataclass(frozen=True)
class CaseRow:
    """A case, or a combination of cases.

    Attributes
    ----------
    names : tuple of str
        Of each value that is compared: the case.
    passed, failed, broken : int
        Runs.
    figures : tuple of Figures
        Of each measure.
    """

    names: tuple[str, ...]
    passed: int
    failed: int
    broken: int
    figures: tuple[Figures, ...]


def compared(outcome: StudyOutcome) -> list[str]:
    """Return the names of the values that are compared: cases, and others that are crossed."""
    return [vary.name for vary in outcome.study.vary if vary.cases or vary.crossed]


def by_case(outcome: StudyOutcome) -> list[CaseRow]:
    """Return a row for each combination of cases, in the order of the runs; none if nothing is compared."""
    study = outcome.study
    places = [index for index, vary in enumerate(study.vary) if vary.cases or vary.crossed]
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in outcome.shown if places else ():
        groups.setdefault(tuple(row.values[place] or "as it is" for place in places), []).append(row)
    found = []
    for names, rows in groups.items():
        ends = Counter(row.status for row in rows)
        whole = [row for row in rows if row.status != BROKEN]
        figures = tuple(
            _figures([row.measures[index] for row in whole], measured.greatest_is_worst)
            for index, measured in enumerate(study.measures)
        )
        found.append(CaseRow(names, ends[PASSED], ends[FAILED], ends[BROKEN], figures))
    return found


def _figures(values: Sequence[float], greatest_is_worst: bool) -> Figures:
    if not values:
        return Figures(math.nan, math.nan, math.nan)
    worst = max(values) if greatest_is_worst else min(values)
    if not all(map(math.isfinite, values)):
        return Figures(worst, worst, math.nan)
    mean = math.fsum(values) / len(values)
    square = math.fsum((value - mean) ** 2 for value in values)
    return Figures(worst, mean, math.sqrt(square / (len(values) - 1)) if len(values) > 1 else math.nan)


def as_csv(outcome: StudyOutcome) -> str:
    """Return the table as CSV, with units in the header."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    heading = [*compared(outcome), "passed", "failed", "broken"]
    for measured in outcome.study.measures:
        unit = f" [{measured.unit}]" if measured.unit else ""
        heading += [f"{measured.name}, {what}{unit}" for what in ("worst", "mean", "deviation")]
    writer.writerow(heading)
    for row in by_case(outcome):
        numbers = [number for one in row.figures for number in (one.worst, one.mean, one.deviation)]
        writer.writerow([*row.names, row.passed, row.failed, row.broken, *numbers])
    return text.getvalue()
