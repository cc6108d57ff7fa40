"""Commands that are clipped to plus or minus a limit."""

from __future__ import annotations

import math

import numpy as np

from cosim.compiled import borrowing
from cosim.signals.effects.effect import Floats, Limit, Plan, Rows
from cosim.signals.effects.schedule import Schedule, clipped


@borrowing
def clip(tick: int, values: Floats, amount: Floats, memory: Floats) -> None:
    """Clip to the limits."""
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            values[i, j] = clipped(values[i, j], amount[i, j])


class Saturation(Limit):
    """``<saturation>``."""

    element = "saturation"
    order = 2
    act = staticmethod(clip)

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self._limit = Schedule(self.element, rows, math.inf, np.minimum)

    def amounts(self, first: int, out: Floats) -> None:
        """Write the limits."""
        self._limit.fill(first, out)

    def plan(self) -> Plan:
        """Return the amounts as levels."""
        return self._limit.plan()
