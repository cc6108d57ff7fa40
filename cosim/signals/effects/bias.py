"""A constant error that is added to pose entries."""

from __future__ import annotations

import numpy as np

from cosim.compiled import borrowing
from cosim.signals.effects.effect import Floats, OfEntries, Plan, Rows
from cosim.signals.effects.schedule import Schedule


@borrowing
def add(tick: int, values: Floats, amount: Floats, memory: Floats) -> None:
    """Add the amounts."""
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            values[i, j] += amount[i, j]


class Bias(OfEntries):
    """``<bias>``."""

    element = "bias"
    order = 1
    signed = True
    act = staticmethod(add)

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self._bias = Schedule(self.element, rows, 0.0, np.add)

    def amounts(self, first: int, out: Floats) -> None:
        """Write the biases."""
        self._bias.fill(first, out)

    def plan(self) -> Plan:
        """Return the amounts as levels."""
        return self._bias.plan()
