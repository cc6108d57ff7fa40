"""An actuator that delivers only a part of the commanded torque."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.signals.effects.effect import Part, Rows
from cosim.signals.effects.schedule import Schedule


class Effectiveness(Part):
    """``<effectiveness>``."""

    element = "effectiveness"
    order = 3
    attribute = "factor"

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self._factor = Schedule(self.element, rows, 1.0, np.multiply)

    def apply(self, tick: int, values: NDArray[np.float64]) -> None:
        """Keep the part."""
        values *= self._factor.at(tick)
