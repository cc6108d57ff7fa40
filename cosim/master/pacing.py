"""Soft real time: a run that keeps pace with a clock, for people to watch or devices to listen to.

The operating system gives no guarantee, so late ticks are counted and reported, and a run that falls behind catches up.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from cosim.errors import Failure
from cosim.master.observer import Watched

_LONGEST_SLEEP = 0.2
"""Longest wait [s] between two checks whether to go on waiting."""


@dataclass(frozen=True)
class PaceReport:
    """Report on the pace of a run.

    Attributes
    ----------
    factor : float
        Simulated time over real time.
    ticks : int
        Number of ticks that were paced.
    overruns : int
        Number of ticks that were due before the tick before had ended.
    worst, worst_time : float
        Largest delay [s] of such a tick, and its simulated time [s]; zero without overruns.
    jitter : float
        Largest delay [s] of a tick that had to wait for its time.
    """

    factor: float
    ticks: int
    overruns: int
    worst: float
    worst_time: float
    jitter: float

    def __str__(self) -> str:
        """Return the report as a sentence."""
        text = f"paced at {self.factor:g} times real time: {self.overruns} of {self.ticks} ticks overran"
        if self.overruns:
            text += f", the worst by {self.worst * 1e3:.3g} ms at t = {self.worst_time:.12g} s"
        return f"{text}; the others began at most {self.jitter * 1e3:.3g} ms late"


class Pacer:
    """An observer that holds a run back after each tick until the next one is due.

    Parameters
    ----------
    step
        Simulated time from one tick to the next [s].
    factor
        Simulated time over real time: 1 for real time, 2 for twice as fast.
    clock, sleep
        Functions that return the real time [s], and that wait for a time [s].

    Raises
    ------
    ValueError
        The factor is not a positive number.
    """

    def __init__(
        self,
        step: float,
        factor: float = 1.0,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if not 0 < factor < float("inf"):
            raise ValueError(f"the pace is {factor:g}; it must be a positive number")
        self._step = step
        self._factor = factor
        self._clock = clock
        self._sleep = sleep
        self._run: Watched | None = None
        self._start: float | None = None
        self._first = 0
        self._ticks = self._overruns = 0
        self._worst = self._worst_time = self._jitter = 0.0

    @property
    def factor(self) -> float:
        """Simulated time over real time."""
        return self._factor

    def take(self, report: PaceReport) -> None:
        """Take over the report of a pacer that has held the run back in its place."""
        self._ticks, self._overruns, self._jitter = report.ticks, report.overruns, report.jitter
        self._worst, self._worst_time = report.worst, report.worst_time

    def wait(self, tick: int, given_up: Callable[[], bool] = lambda: False) -> None:
        """Return when a tick is due, or waiting is given up; the first that is waited for is due at once."""
        now = self._clock()
        if self._start is None:
            self._start, self._first = now, tick
        held = 0.0 if self._run is None else self._run.held()
        due = self._start + held + (tick - self._first) * self._step / self._factor
        self._ticks += 1
        if now > due:
            self._overruns += 1
            if now - due > self._worst:
                self._worst, self._worst_time = now - due, tick * self._step
            return
        if now == due:
            return
        while now < due and not given_up():
            self._sleep(min(due - now, _LONGEST_SLEEP))
            now = self._clock()
        self._jitter = max(self._jitter, now - due)

    def started(self, run: Watched) -> None:
        """Begin to measure with the first tick, which is due at once."""
        self._run = run
        self.wait(run.tick)

    def ticked(self, tick: int) -> None:
        """Wait until the next tick is due, if there is one."""
        assert self._run is not None, "the run has started"
        if tick < self._run.clock.ticks:
            self.wait(tick + 1, self._run.stopping)

    def ended(self, failure: Failure | None) -> None:
        """Do nothing: the report stays."""

    @property
    def report(self) -> PaceReport:
        """The report so far."""
        return PaceReport(self._factor, self._ticks, self._overruns, self._worst, self._worst_time, self._jitter)
