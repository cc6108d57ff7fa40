"""White Gaussian noise that is added to pose entries, with a stream of random numbers for each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.signals.effects.effect import OfEntries, Rows
from cosim.signals.effects.schedule import Schedule
from cosim.signals.random import random_stream

BLOCK = 512
"""Ticks whose random numbers are drawn at once."""


class Noise(OfEntries):
    """``<noise>``."""

    element = "noise"
    order = 2

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self._deviation = Schedule(self.element, rows, 0.0, np.hypot)
        self._streams = [
            [random_stream(rows.seed, robot, f"pose.{name}") for name in names]
            for robot, names in zip(rows.robots, rows.channels, strict=True)
        ]
        self._drawn = np.zeros((BLOCK, len(rows.robots), rows.width))

    def apply(self, tick: int, values: NDArray[np.float64]) -> None:
        """Add the noise."""
        row = tick % BLOCK
        if row == 0:
            for index, streams in enumerate(self._streams):
                for component, stream in enumerate(streams):
                    self._drawn[:, index, component] = stream.standard_normal(BLOCK)
        values += self._drawn[row] * self._deviation.at(tick)
