"""Rows of runs: those that the store holds are taken over, the others are made on workers."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import replace
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Self

from cosim.studies.engine import Pending, Workers
from cosim.studies.keys import key_of_run
from cosim.studies.plan import Run
from cosim.studies.row import Row
from cosim.studies.store import Store
from cosim.studies.study import Study
from cosim.studies.task import Job, row_of

Ask = Callable[[int], Sequence[Run]]
"""Returns runs to begin next, at most as many; none if there is none until more rows have come."""
Take = Callable[[Sequence[Row]], bool]
"""Gets rows as they come, in any order; returns whether the study goes on."""


def in_order(runs: Iterable[Run]) -> Ask:
    """Return what asks for runs in their order."""
    left = iter(runs)
    return lambda most: tuple(islice(left, most))


class Maker:
    """Gives the rows of runs, whether they are kept or have to be made; its workers live as long as it is open.

    Parameters
    ----------
    study
        The study.
    keys
        Of each scenario; see `cosim.studies.keys.key_of_scenario`.
    store
        Where rows are kept, and added.
    workers
        How many processes.
    executor
        An executor of `concurrent.futures`, in place of processes of this machine.

    Attributes
    ----------
    made : int
        How many runs were made; the others were kept.
    """

    def __init__(
        self,
        study: Study,
        keys: Mapping[tuple[int, ...], str],
        store: Store,
        workers: int,
        executor: Executor | None = None,
    ) -> None:
        self._job = Job(study.bases, study.measures, 0.0)
        self._keys = keys
        self._store = store
        self._count, self._executor = workers, executor
        self._workers: Workers | None = None
        self._closing = ExitStack()
        self.made = 0

    def __enter__(self) -> Self:
        """Return it; its workers are ended at the end of the block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._closing.close()

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

        def missing(most: int) -> Iterator[Pending]:
            nonlocal goes_on
            while goes_on and most > 0 and (asked := ask(most)):
                kept = []
                for run in asked:
                    key = key_of_run(self._keys[run.cases], run.changes)
                    if (row := self._store.rows.get(key)) is None:
                        most -= 1
                        yield run, key
                    else:
                        kept.append(replace(row, number=run.number, draw=run.draw, values=run.values))
                if kept:
                    goes_on = take(kept)

        def keep(rows: Sequence[Row]) -> bool:
            nonlocal goes_on
            self._store.append(rows)
            self.made += len(rows)
            goes_on = take(rows)
            return goes_on

        if self._workers is None:
            first = next(missing(1), None)
            if first is None:
                return
            # the first one here, so that what has to be compiled is compiled once, for all workers
            began = time.perf_counter()
            rows = [row_of(self._job, *first)]
            self._workers = self._started(time.perf_counter() - began)
            if not keep(rows):
                return
        self._workers.run(lambda most: list(missing(most)), keep)

    def _started(self, usual: float) -> Workers:
        scratch = self._closing.enter_context(tempfile.TemporaryDirectory(prefix="formation-study-"))
        workers = Workers(replace(self._job, usual=usual), self._count, Path(scratch), self._executor)
        self._closing.callback(workers.close, at_once=True)
        return workers
