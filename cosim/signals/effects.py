"""Effects of sensors and actuators over a run, as values of every channel that change at a few ticks."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError, nearest
from cosim.scenario.scenario import Effect


def tick_at(time: float, step: float) -> int:
    """Return the first tick at or after a time [s]; a time beyond all ticks gives the largest integer."""
    return math.ceil(time / step - 1e-9) if math.isfinite(time) else 2**62


def check_channels(effects: Sequence[Effect], channels: Sequence[str], what: str) -> None:
    """Check that effects name channels that a robot has.

    Raises
    ------
    InputError
        With the place in the scenario; `what` says whose channels they are.
    """
    for effect in effects:
        for channel in effect.channels:
            if channel not in channels:
                raise InputError(f"{what} has no channel {channel!r}: {nearest(channel, list(channels))}", effect.where)


class Schedule:
    """The amount of one kind of effect on every channel of every robot, tick by tick.

    Parameters
    ----------
    kind
        The kind of effect.
    effects, channels
        Those of each robot, in the order of the rows.
    step
        Communication step [s].
    idle
        The amount where there is no effect.
    combine
        How amounts that act at the same time add up, as a NumPy function of two arguments.

    Attributes
    ----------
    used : bool
        Whether there is any such effect.
    amount : ndarray
        (robots, channels), at the tick last asked for.
    """

    def __init__(
        self,
        kind: str,
        effects: Sequence[Sequence[Effect]],
        channels: Sequence[Sequence[str]],
        step: float,
        idle: float,
        combine: np.ufunc,
    ) -> None:
        self.amount = np.full((len(effects), len(channels[0]) if channels else 0), idle)
        self._idle = idle
        self._combine = combine
        self._spans = [
            (
                tick_at(e.start, step),
                tick_at(e.stop, step),
                row,
                [names.index(c) for c in e.channels or names],
                e.amount,
            )
            for row, (own, names) in enumerate(zip(effects, channels, strict=True))
            for e in own
            if e.kind == kind
        ]
        self._switches = {0} | {tick for start, stop, *_ in self._spans for tick in (start, stop)}
        self.used = bool(self._spans)

    def at(self, tick: int) -> NDArray[np.float64]:
        """Return the amounts at a tick; ticks come one after the other from 0."""
        if tick in self._switches:
            self.amount[:] = self._idle
            for start, stop, row, columns, amount in self._spans:
                if start <= tick < stop:
                    self.amount[row, columns] = self._combine(self.amount[row, columns], amount)
        return self.amount


class Delay:
    """Values as they were some ticks ago, a number of ticks for each channel of every robot.

    Parameters
    ----------
    effects, channels, step
        As for `Schedule`.
    """

    def __init__(self, effects: Sequence[Sequence[Effect]], channels: Sequence[Sequence[str]], step: float) -> None:
        delay = Schedule("delay", effects, channels, step, 0.0, np.add)
        self.used = delay.used
        self._ticks = np.round(delay.at(0) / step).astype(int)
        self._memory = np.zeros((int(self._ticks.max(initial=0)) + 1, *self._ticks.shape))
        self._index = np.indices(self._ticks.shape)

    def __call__(
        self, tick: int, values: NDArray[np.float64], before: NDArray[np.float64] | float
    ) -> NDArray[np.float64]:
        """Return the delayed values (robots, channels); `before` holds the values before the first tick."""
        size = len(self._memory)
        if tick == 0:
            self._memory[:] = before
        self._memory[tick % size] = values
        delayed: NDArray[np.float64] = self._memory[(tick - self._ticks) % size, *self._index]
        return delayed
