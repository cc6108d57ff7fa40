"""White Gaussian noise that is added to pose entries, with a stream of random numbers for each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import compiled
from cosim.signals.effects.bias import add
from cosim.signals.effects.effect import Floats, OfEntries, Rows
from cosim.signals.effects.schedule import Schedule
from cosim.signals.random import random_stream
from plants import arrays

_APART = 8
"""Numbers between the streams: a window is a power of two, and they would take turns at one place of the cache."""


@compiled
def scale(out: Floats, columns: NDArray[np.int64], drawn: Floats) -> None:
    """Multiply columns (ticks, columns) by the numbers (streams, ticks) of a stream each."""
    for tick in range(len(out)):
        for stream in range(len(columns)):
            out[tick, columns[stream]] *= drawn[stream, tick]


class Noise(OfEntries):
    """``<noise>``."""

    element = "noise"
    order = 2
    act = staticmethod(add)

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self._deviation = Schedule(self.element, rows, 0.0, arrays.hypot)
        found = [
            (row, column, robot, name)
            for row, (robot, names) in enumerate(zip(rows.robots, rows.channels, strict=True))
            for column, name in enumerate(names)
            if any(effect.kind == self.element and name in (effect.channels or names) for effect in rows.effects[row])
        ]
        self._names = [(robot, f"pose.{name}") for *_, robot, name in found]
        self._columns = np.array([row * rows.width + column for row, column, *_ in found], dtype=np.int64)
        self.restart(rows)

    def restart(self, rows: Rows) -> None:
        """Begin all streams anew."""
        super().restart(rows)
        self._streams = [random_stream(rows.seed, *names) for names in self._names]

    def amounts(self, first: int, out: Floats) -> None:
        """Write random numbers with the standard deviations."""
        self._deviation.fill(first, out)
        drawn = np.empty((len(self._streams), len(out) + _APART))[:, : len(out)]
        for stream, own in zip(self._streams, drawn, strict=True):
            stream.standard_normal(out=own)
        scale(out.reshape(len(out), -1), self._columns, drawn)
