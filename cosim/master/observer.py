"""Observers of a run: they are told that it starts, of each tick and that it ends, and change nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cosim.clock import Clock
from cosim.errors import Failure
from cosim.master.records import Records


@dataclass(frozen=True)
class Watched:
    """A run as observers see it; the arrays are read-only views, which show the tick that is told of.

    Attributes
    ----------
    clock : Clock
        The communication points.
    tick : int
        The first tick of which the observer is told.
    robots : tuple of str
        The leader and the followers, in the order of the arrays' rows.
    state, measured, torque : ndarray
        True pose and pseudo-velocities, measured pose and torque that acts from the tick on, of every robot.
    stopping : callable
        Returns whether somebody wants the run to end, so that it is no use to wait.
    held : callable
        Returns how long observers have held the run on purpose [s], which is no delay.
    records : Records
        What is recorded.
    """

    clock: Clock
    tick: int
    robots: tuple[str, ...]
    state: NDArray[np.float64]
    measured: NDArray[np.float64]
    torque: NDArray[np.float64]
    stopping: Callable[[], bool]
    held: Callable[[], float]
    records: Records


class Observer(Protocol):
    """Watches a run.

    Legal call order: `started`, `ticked` for tick after tick, `ended`. An exception of an observer ends the run.

    An observer whose attribute ``every_tick`` is False is told of the last tick of each segment only, some of them a
    second, and may find the plants moved on. A run that has none but such observers is faster. The attribute may
    change. One that holds the run on purpose says in its attribute ``held`` for how long [s].
    """

    def started(self, run: Watched) -> None:
        """Take note of the run, before its first tick."""

    def ticked(self, tick: int) -> None:
        """Look at a tick: it is sensed, controlled and actuated, and the plants have not moved on."""

    def ended(self, failure: Failure | None) -> None:
        """Take note that there are no more ticks, and why if the horizon is not reached."""


class Progress:
    """Calls a function with the last tick of each segment.

    Parameters
    ----------
    tell
        The function.
    """

    every_tick = False

    def __init__(self, tell: Callable[[int], None]) -> None:
        self._tell = tell

    def started(self, run: Watched) -> None:
        """Do nothing."""

    def ticked(self, tick: int) -> None:
        """Tell the tick."""
        self._tell(tick)

    def ended(self, failure: Failure | None) -> None:
        """Do nothing."""


def read_only(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a view of an array that cannot be written."""
    view = values.view()
    view.flags.writeable = False
    return view
