"""A constant error that is added to pose entries."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.signals.effects.effect import OfEntries, Rows
from cosim.signals.effects.schedule import Schedule


class Bias(OfEntries):
    """``<bias>``."""

    element = "bias"
    order = 1
    signed = True

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self._bias = Schedule(self.element, rows, 0.0, np.add)

    def apply(self, tick: int, values: NDArray[np.float64]) -> None:
        """Add the bias."""
        values += self._bias.at(tick)
