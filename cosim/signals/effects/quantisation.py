"""Rounding to whole numbers of steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.signals.effects.effect import OfEntries, Rows
from cosim.signals.effects.schedule import Schedule


class Quantisation(OfEntries):
    """``<quantisation>``."""

    element = "quantisation"
    order = 3

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self._quantum = Schedule(self.element, rows, 0.0, np.maximum)

    def apply(self, tick: int, values: NDArray[np.float64]) -> None:
        """Round."""
        quantum = self._quantum.at(tick)
        coarse = quantum > 0
        values[coarse] = np.round(values[coarse] / quantum[coarse]) * quantum[coarse]
