"""Commands that are clipped to plus or minus a limit."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cosim.signals.effects.effect import Limit, Rows
from cosim.signals.effects.schedule import Schedule, clip


class Saturation(Limit):
    """``<saturation>``."""

    element = "saturation"
    order = 2

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self._limit = Schedule(self.element, rows, math.inf, np.minimum)

    def apply(self, tick: int, values: NDArray[np.float64]) -> None:
        """Clip."""
        clip(values, self._limit.at(tick))
