"""An actuator that delivers only a part of the commanded torque."""

from __future__ import annotations

import numpy as np

from cosim.compiled import compiled
from cosim.signals.effects.effect import Floats, Part, Plan, Rows
from cosim.signals.effects.schedule import Schedule


@compiled
def keep_part(tick: int, values: Floats, amount: Floats, memory: Floats) -> None:
    """Multiply by the factors."""
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            values[i, j] *= amount[i, j]


class Effectiveness(Part):
    """``<effectiveness>``."""

    element = "effectiveness"
    order = 3
    attribute = "factor"
    act = staticmethod(keep_part)

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self._factor = Schedule(self.element, rows, 1.0, np.multiply)

    def amounts(self, first: int, out: Floats) -> None:
        """Write the factors."""
        self._factor.fill(first, out)

    def plan(self) -> Plan:
        """Return the amounts as levels."""
        return self._factor.plan()
