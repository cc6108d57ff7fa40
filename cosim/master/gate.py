"""A gate in a run's way: closed, it holds the run after a tick, until it is opened or lets one tick through."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import DTypeLike, NDArray

from cosim.errors import Failure
from cosim.master.observer import Watched

_LOOK = 0.01
"""Time [s] between two looks at a closed gate."""
_CLOSED, _STEPS, _TICK = range(3)


class Gate:
    """An observer that holds a run after a tick while it is closed, and changes none of its numbers.

    Parameters
    ----------
    take
        Returns zeros of a shape and a type: in memory that processes share, the gate holds a run in another process.

    Attributes
    ----------
    held : float
        How long it has held the run [s], as the process of the run sees it.
    """

    def __init__(self, take: Callable[[tuple[int, ...], DTypeLike], NDArray[np.int64]] = np.zeros) -> None:
        self._shared = take((3,), np.int64)
        self._shared[_TICK] = -1
        self._taken = 0
        self._run: Watched | None = None
        self.held = 0.0

    # Whoever watches: one thread ----------------------------------------------------------------------------

    @property
    def is_closed(self) -> bool:
        """Whether the run is held, after the tick that it is at."""
        return bool(self._shared[_CLOSED])

    @property
    def tick(self) -> int:
        """The last tick that the run has shown to the gate; -1 before the first one."""
        return int(self._shared[_TICK])

    def close(self) -> None:
        """Hold the run after the tick that it is at."""
        self._shared[_CLOSED] = 1

    def open(self) -> None:
        """Let the run go on."""
        self._shared[_CLOSED] = 0

    def step(self) -> None:
        """Let the run through to the next tick, and hold it there."""
        self._shared[_STEPS] += 1

    # The run ------------------------------------------------------------------------------------------------

    @property
    def every_tick(self) -> bool:
        """Whether it wants to be told of every tick: while it is closed, so that a step is one tick."""
        return self.is_closed

    def started(self, run: Watched) -> None:
        """Take note of the run."""
        self._run = run
        self._shared[_TICK] = run.tick - 1

    def ticked(self, tick: int) -> None:
        """Hold the run while the gate is closed, unless somebody wants the run to end, or this is its last tick."""
        run = self._run
        assert run is not None, "the run has started"
        self._shared[_TICK] = tick
        if not self.is_closed:
            self._taken = int(self._shared[_STEPS])
            return
        began = time.perf_counter()
        while self.is_closed and tick < run.clock.ticks and not run.stopping():
            if self._shared[_STEPS] > self._taken:
                self._taken += 1
                break
            time.sleep(_LOOK)
        self.held += time.perf_counter() - began

    def ended(self, failure: Failure | None) -> None:
        """Do nothing."""
