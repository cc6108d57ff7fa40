"""The runs of a study on any executor of `concurrent.futures`, in chunks that are each a second or two long."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import TypeAlias

from cosim.studies.crew import Crew, Done, result
from cosim.studies.measuring import made_by_runs
from cosim.studies.plan import Run
from cosim.studies.row import Row
from cosim.studies.study import Study
from cosim.studies.task import Task

Pending: TypeAlias = tuple[Run, str]
"""A run, and its key."""
CHUNK = 1.5
"""Time [s] that a chunk shall take."""
_LARGEST = 500
"""Runs of a chunk, at most."""
_AHEAD = 2
"""Chunks for each run that is made at a time, so that nobody waits for the next one."""


class Workers:
    """The runs of one study, made by a crew.

    Parameters
    ----------
    study
        The study.
    crew
        Who makes them.
    code
        See `Task.code`; it may grow.

    Attributes
    ----------
    usual : float
        The time [s] that a run takes, about.
    paces : list of float
        Of each chunk that was made: the time [s] of a run.
    """

    def __init__(self, study: Study, crew: Crew, code: Mapping[str, str]) -> None:
        self.usual = 0.0
        self.paces: list[float] = []
        self._measures = made_by_runs(study.measures)
        self._envelopes = study.envelopes
        self._bases = {cases: pickle.dumps(scenario) for cases, scenario in study.bases.items()}
        self._mark = hashlib.sha256(pickle.dumps((self._bases, self._measures, self._envelopes))).hexdigest()
        self._crew, self._code = crew, code
        self._each = 1  # runs of a chunk

    def run(self, ask: Callable[[int], Sequence[Pending]], take: Callable[[Sequence[Row]], bool]) -> None:
        """Make all runs that are asked for.

        Parameters
        ----------
        ask
            Returns runs to begin next, at most as many; none if there is none until more rows have come.
        take
            Gets the rows of each chunk; returns whether the study goes on.
        """
        flying: set[Future[Done]] = set()
        goes_on = True
        try:
            while goes_on:
                most = _AHEAD * self._crew.size()
                while len(flying) < most and (chunk := ask(self._each)):
                    flying.add(self._crew.submit(self.task(chunk)))
                if not flying:
                    break
                done, flying = wait(flying, return_when=FIRST_COMPLETED)
                for future in done:
                    rows, seconds = result(future)
                    self.paces += [seconds / len(rows)] * bool(rows)
                    self._each = min(max(round(CHUNK * len(rows) / max(seconds, 1e-6)), 1), _LARGEST)
                    goes_on = take(rows) and goes_on
        finally:
            for future in flying:
                future.cancel()

    def task(self, chunk: Sequence[Pending], alone: bool = False) -> Task:
        """Return a chunk as a task."""
        runs, keys = zip(*chunk, strict=True)
        bases = {run.cases: self._bases[run.cases] for run in runs}
        code = dict(self._code)
        return Task(self._mark, bases, self._measures, self._envelopes, self.usual, runs, keys, code, alone)
