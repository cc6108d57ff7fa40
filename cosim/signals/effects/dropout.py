"""Measurements that are lost, all channels at once; the one before is then held."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.clock import tick_at
from cosim.signals.effects.effect import Effect, Part, Rows
from cosim.signals.random import random_stream

BLOCK = 512
"""Ticks whose random numbers are drawn at once."""


class Dropout(Part):
    """``<dropout>``."""

    element = "dropout"
    order = 4
    attribute = "probability"

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        own = [[effect for effect in effects if effect.kind == self.element] for effects in rows.effects]
        self._losses = [_Losses(rows, row, effects) for row, effects in enumerate(own) if effects]
        self._last = np.zeros((len(rows.robots), rows.width))

    def apply(self, tick: int, values: NDArray[np.float64]) -> None:
        """Put the last values in the place of those that are lost."""
        for losses in self._losses:
            losses.hold(tick, values, self._last)
        self._last[:] = values


class _Losses:
    """The dropouts of one robot; each draws one number a tick for all of its channels."""

    def __init__(self, rows: Rows, row: int, effects: Sequence[Effect]) -> None:
        channels = rows.channels[row]
        self._row = row
        self._parts = [
            (
                random_stream(rows.seed, rows.robots[row], f"pose.dropout.{index}"),
                effect.amount,
                [channels.index(channel) for channel in effect.channels or channels],
                tick_at(effect.start, rows.step),
                tick_at(effect.stop, rows.step),
            )
            for index, effect in enumerate(effects)
        ]
        self._drawn = np.ones((len(effects), BLOCK))

    def hold(self, tick: int, values: NDArray[np.float64], last: NDArray[np.float64]) -> None:
        """Hold the last values of lost measurements; the first measurement is never lost."""
        if tick % BLOCK == 0:
            for (stream, *_), drawn in zip(self._parts, self._drawn, strict=True):
                drawn[:] = stream.random(BLOCK)
        for (_, probability, columns, start, stop), drawn in zip(self._parts, self._drawn, strict=True):
            if tick > 0 and start <= tick < stop and drawn[tick % BLOCK] < probability:
                values[self._row, columns] = last[self._row, columns]
