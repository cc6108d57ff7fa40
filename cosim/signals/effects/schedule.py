"""The amount of a kind of effect on every channel, which changes at a few ticks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.clock import tick_at
from cosim.signals.effects.effect import Rows


class Schedule:
    """The amount of one kind of effect on every channel of every robot, tick by tick.

    Parameters
    ----------
    kind
        The kind of effect.
    rows
        The robots.
    idle
        The amount where there is no effect.
    combine
        How amounts that act at the same time add up, as a NumPy function of two arguments.

    Attributes
    ----------
    amount : ndarray
        (robots, channels), at the tick last asked for.
    """

    def __init__(self, kind: str, rows: Rows, idle: float, combine: np.ufunc) -> None:
        self.amount = np.full((len(rows.effects), rows.width), idle)
        self._idle = idle
        self._combine = combine
        self._spans = [
            (
                tick_at(e.start, rows.step),
                tick_at(e.stop, rows.step),
                row,
                [names.index(c) for c in e.channels or names],
                e.amount,
            )
            for row, (own, names) in enumerate(zip(rows.effects, rows.channels, strict=True))
            for e in own
            if e.kind == kind
        ]
        self._switches = {0} | {tick for start, stop, *_ in self._spans for tick in (start, stop)}

    def at(self, tick: int) -> NDArray[np.float64]:
        """Return the amounts at a tick; ticks come one after the other from 0."""
        if tick in self._switches:
            self.amount[:] = self._idle
            for start, stop, row, columns, amount in self._spans:
                if start <= tick < stop:
                    self.amount[row, columns] = self._combine(self.amount[row, columns], amount)
        return self.amount


def clip(values: NDArray[np.float64], limit: NDArray[np.float64]) -> None:
    """Clip values in place to plus or minus a limit; NumPy's own function takes five times as long."""
    np.minimum(values, limit, out=values)
    np.maximum(values, -limit, out=values)
