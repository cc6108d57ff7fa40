"""White Gaussian noise that is added to pose entries, with a stream of random numbers for each."""

from __future__ import annotations

from cosim.signals.effects.bias import add
from cosim.signals.effects.effect import Floats, OfEntries, Rows
from cosim.signals.effects.schedule import Schedule
from cosim.signals.random import random_stream
from plants import arrays


class Noise(OfEntries):
    """``<noise>``."""

    element = "noise"
    order = 2
    act = staticmethod(add)

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self._deviation = Schedule(self.element, rows, 0.0, arrays.hypot)
        self._streams = [
            (row, column, random_stream(rows.seed, robot, f"pose.{name}"))
            for row, (robot, names) in enumerate(zip(rows.robots, rows.channels, strict=True))
            for column, name in enumerate(names)
            if any(effect.kind == self.element and name in (effect.channels or names) for effect in rows.effects[row])
        ]

    def amounts(self, first: int, out: Floats) -> None:
        """Write random numbers with the standard deviations."""
        self._deviation.fill(first, out)
        for row, column, stream in self._streams:
            out[:, row, column] *= stream.standard_normal(len(out))
