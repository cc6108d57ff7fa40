"""White Gaussian noise that is added to pose entries, with a stream of random numbers for each."""

from __future__ import annotations

import numpy as np

from cosim.signals.effects.bias import add
from cosim.signals.effects.effect import Floats, OfEntries, Rows
from cosim.signals.effects.schedule import Schedule
from cosim.signals.random import random_stream
from plants import arrays

_AHEAD, _STREAMS = 4, 64
"""Windows of ticks that are drawn at once, and how many streams draw so far ahead in one window each."""


def _as_index(columns: list[int]) -> slice | list[int]:
    """Return columns as an index: a slice, which NumPy takes in a fifth of the time, where they are neighbours."""
    first = columns[0] if columns else 0
    neighbours = slice(first, first + len(columns))
    return neighbours if columns == list(range(first, first + len(columns))) else columns


class Noise(OfEntries):
    """``<noise>``."""

    element = "noise"
    order = 2
    act = staticmethod(add)

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self._deviation = Schedule(self.element, rows, 0.0, arrays.hypot)
        found = [
            (row, column, random_stream(rows.seed, robot, f"pose.{name}"))
            for row, (robot, names) in enumerate(zip(rows.robots, rows.channels, strict=True))
            for column, name in enumerate(names)
            if any(effect.kind == self.element and name in (effect.channels or names) for effect in rows.effects[row])
        ]
        self._streams = [stream for *_, stream in found]
        self._columns = _as_index([row * rows.width + column for row, column, _ in found])
        self._drawn = np.empty((0, 0))
        self._used = 0

    def amounts(self, first: int, out: Floats) -> None:
        """Write random numbers with the standard deviations."""
        self._deviation.fill(first, out)
        if self._used + len(out) > self._drawn.shape[1]:
            self._draw(len(out))
        drawn = self._drawn[:, self._used : self._used + len(out)]
        self._used += len(out)
        out.reshape(len(out), -1)[:, self._columns] *= drawn.T

    def _draw(self, ticks: int) -> None:
        """Draw the numbers of some ticks, or of a few times as many where there are few streams: a call takes long."""
        ahead = max(1, min(_AHEAD, _STREAMS // max(len(self._streams), 1)))
        if self._drawn.shape[1] != ahead * ticks:
            self._drawn = np.empty((len(self._streams), ahead * ticks))
        for stream, drawn in zip(self._streams, self._drawn, strict=True):
            stream.standard_normal(out=drawn)
        self._used = 0
