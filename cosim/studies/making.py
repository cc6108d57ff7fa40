"""Rows of runs: those that the store holds are taken over, the others are made on workers."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from statistics import median
from typing import TypeAlias

from cosim.studies.crew import Crew
from cosim.studies.engine import Pending, Workers
from cosim.studies.keys import RunKeys
from cosim.studies.measuring import with_sums
from cosim.studies.plan import Run
from cosim.studies.row import Row
from cosim.studies.store import Store
from cosim.studies.study import Study
from cosim.studies.task import rows_of

Ask: TypeAlias = Callable[[int], Sequence[Run]]
"""Returns runs to begin next, at most as many; none if there is none until more rows have come."""
Take: TypeAlias = Callable[[Sequence[Row]], bool]
"""Gets rows as they come, in any order; returns whether the study goes on."""


def in_order(runs: Iterable[Run]) -> Ask:
    """Return what asks for runs in their order."""
    left = iter(runs)
    return lambda most: tuple(islice(left, most))


class Maker:
    """Gives the rows of runs, whether they are kept or have to be made.

    Parameters
    ----------
    study
        The study.
    keys
        Those of its runs.
    store
        Where rows are kept, and added.
    crew
        Who makes runs.

    Attributes
    ----------
    made : int
        How many runs were made; the others were kept.
    """

    def __init__(self, study: Study, keys: RunKeys, store: Store, crew: Crew) -> None:
        self._keys = keys
        self._bases = study.bases
        self._measures = study.measures
        self._store = store
        self._workers = Workers(study, crew, keys.code)
        self.made = 0

    @property
    def pace(self) -> float | None:
        """The time [s] that a run took, mostly: without what the first ones prepare; None if too few were made."""
        return median(self._workers.paces) if self._workers.paces else None

    def make(self, ask: Ask, take: Take) -> None:
        """Give the rows of all runs that are asked for.

        It ends when nothing is asked for and every row has come, or when `take` ends the study. A search asks for its
        next runs when `take` has got the rows that it depends on.

        Parameters
        ----------
        ask
            Says which runs are next.
        take
            Gets their rows.

        Raises
        ------
        OutputError
            The rows cannot be written.
        """
        goes_on = True

        def give(rows: Sequence[Row]) -> bool:
            return take([with_sums(self._measures, row) for row in rows])

        def missing(most: int) -> Iterator[Pending]:
            nonlocal goes_on
            while goes_on and most > 0 and (asked := ask(most)):
                kept = []
                for run in asked:
                    key = self._keys.of(run)
                    if (row := self._store.rows.get(key)) is None:
                        most -= 1
                        yield run, key
                    else:
                        row = row.placed(self._bases[run.cases].places)
                        kept.append(replace(row, number=run.number, draw=run.draw, values=run.values))
                if kept:
                    goes_on = give(kept)

        def keep(rows: Sequence[Row]) -> bool:
            nonlocal goes_on
            kept = self._store.append(rows)
            self.made += len(kept)
            goes_on = give(kept)
            return goes_on

        if not self._workers.usual and (first := next(missing(1), None)) is not None:
            # the first one here, so that what has to be compiled is compiled once, for all workers
            began = time.perf_counter()
            rows = list(rows_of(self._workers.task([first], alone=True)))
            self._workers.usual = time.perf_counter() - began
            keep(rows)
        if goes_on:
            self._workers.run(lambda most: list(missing(most)), keep)
