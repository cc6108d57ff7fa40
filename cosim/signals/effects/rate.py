"""Commands that change no faster than a limit, and start from zero."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cosim.signals.effects.effect import Limit, Rows
from cosim.signals.effects.schedule import Schedule, clip


class Rate(Limit):
    """``<rate>``."""

    element = "rate"
    order = 1
    of_rate = True

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self._limit = Schedule(self.element, rows, math.inf, np.minimum)
        self._before = np.zeros((len(rows.robots), rows.width))

    def apply(self, tick: int, values: NDArray[np.float64]) -> None:
        """Follow the values no faster than the limit."""
        most = self._limit.at(tick) * self.rows.step
        change = values - self._before
        clip(change, most)
        np.copyto(values, self._before + change, where=np.isfinite(most))
        self._before[:] = values
