"""A study that searches for the worst case: the values with which the margins of the expectations are least."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cosim.errors import InputError
from cosim.quantity import split
from cosim.results.verdict import Verdict
from cosim.studies.descents import Descents
from cosim.studies.plan import Run, run_of
from cosim.studies.row import PASSED, Row
from cosim.studies.seeking import Point
from cosim.studies.sizes import MOST_RUNS, too_many
from cosim.studies.study import Search, Study
from cosim.studies.values import Count, Finite


@dataclass(frozen=True)
class Worst:
    """What has come of a search.

    Attributes
    ----------
    row : Row
        The run with the least margin.
    failing : tuple of Row
        The runs that do not pass, those with the least margin first.
    """

    row: Row
    failing: tuple[Row, ...]


def check_search(study: Study, search: Search) -> None:
    """Refuse a search that finds nothing; raises InputError with its place."""
    measures = {measured.where for measured in study.measures}
    for scenario in study.bases.values():
        if all(one.where in measures for one in scenario.expectations):
            raise InputError(
                "the scenario expects nothing, so that no run can fail: add an expectation to it", search.where
            )
    if search.runs > MOST_RUNS:
        raise InputError(f"the search has {search.runs:,} runs, {too_many(search.runs)}", search.where)


class Searching:
    """The runs of a search, which are asked for and taken; see `cosim.studies.making`.

    Parameters
    ----------
    study
        A study that searches.
    most
        How many runs are made, at most.

    Attributes
    ----------
    rows : dict
        The rows of all runs so far, by their number.
    """

    def __init__(self, study: Study, search: Search, most: int) -> None:
        self._study, self._search, self._most = study, search, most
        self._searched = [index for index, vary in enumerate(study.vary) if not isinstance(vary.values, Count)]
        self._descents = Descents(len(self._searched), search.runs, search.seed)
        self._waiting: deque[Run] = deque()
        self._batch: range = range(1, 1)
        self.rows: dict[int, Row] = {}
        self._begin()

    def ask(self, most: int) -> list[Run]:
        """Return runs to begin next."""
        return [self._waiting.popleft() for _ in range(min(most, len(self._waiting)))]

    def take(self, rows: Sequence[Row]) -> bool:
        """Take rows; return whether the study goes on."""
        self.rows.update((row.number, row) for row in rows)
        while self._batch and all(number in self.rows for number in self._batch):
            batch = [self.rows[number] for number in self._batch]
            self._descents.tell([_score(row) for row in batch])
            if self._search.early and any(row.status != PASSED for row in batch):
                return False
            self._begin()
        return True

    def worst(self) -> Worst | None:
        """Return the worst case so far; None before any run."""
        ordered = sorted(self.rows.values(), key=lambda row: (row.least, row.number))
        if not ordered:
            return None
        return Worst(ordered[0], tuple(row for row in ordered if row.status != PASSED))

    def _begin(self) -> None:
        """Begin the next batch, if there is one."""
        first = self._batch.stop
        self._batch = range(first, min(first + self._search.batch, self._most + 1))
        if self._batch:
            points = self._descents.ask(len(self._batch))
            self._batch = range(first, first + len(points))
            self._waiting.extend(self._run(*one) for one in zip(self._batch, points, strict=True))

    def _run(self, number: int, point: Point) -> Run:
        fractions = dict(zip(self._searched, np.clip(point, 1e-15, 1.0 - 1e-15).tolist(), strict=True))
        values: list[str | None] = []
        for index, vary in enumerate(self._study.vary):
            if isinstance(vary.values, Count):
                values.append(vary.values.at(number - 1))
            elif isinstance(vary.values, Finite):
                values.append(vary.values.texts[vary.values.at(fractions[index])])
            else:
                values.append(vary.values.at(fractions[index]))
        return run_of(self._study, number, number, values)


def _score(row: Row) -> float:
    """Return the margin as a number from -1, where there is none, to 1."""
    return math.copysign(1.0, row.least) if math.isinf(row.least) else row.least / (1.0 + abs(row.least))


def _short(value: str) -> str:
    """Return a value as people read it; the run's scenario has all of its digits."""
    try:
        number, unit = split(value)
    except ValueError:
        return value
    if number.is_integer():
        return value
    return f"{number:.4g}" + (f" {unit}" if unit != "1" else "")


def search_verdict(study: Study, search: Search, worst: Worst, runs: int) -> Verdict:
    """Return the verdict on a search: it holds if no run fails."""
    row = worst.row
    values = ", ".join(
        f"{vary.name} {_short(value)}" for vary, value in zip(study.vary, row.values, strict=True) if value is not None
    )
    found = f"{len(worst.failing)} of {runs} runs do not pass" if worst.failing else f"none fails of {runs} runs"
    return Verdict(
        expectation="no counterexample: the least margin found, of its bound",
        robot="",
        figure=100.0 * row.least if math.isfinite(row.least) else math.nan,
        bound=0.0,
        unit="%",
        margin=math.nan,  # the figure is one
        passed=not worst.failing,
        known_failure=search.fails,
        detail="; ".join(text for text in (f"run {row.number}: {values}", found, row.message) if text),
        where=search.where,
    )
