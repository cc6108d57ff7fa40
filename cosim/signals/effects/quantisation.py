"""Rounding to whole numbers of steps."""

from __future__ import annotations

import numpy as np

from cosim.compiled import compiled
from cosim.signals.effects.effect import Floats, OfEntries, Plan, Rows
from cosim.signals.effects.schedule import Schedule


@compiled
def to_steps(tick: int, values: Floats, amount: Floats, memory: Floats) -> None:
    """Round to whole numbers of the amounts, where these are not zero."""
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            if amount[i, j] > 0.0:
                values[i, j] = np.rint(values[i, j] / amount[i, j]) * amount[i, j]


class Quantisation(OfEntries):
    """``<quantisation>``."""

    element = "quantisation"
    order = 3
    act = staticmethod(to_steps)

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self._quantum = Schedule(self.element, rows, 0.0, np.maximum)

    def amounts(self, first: int, out: Floats) -> None:
        """Write the steps."""
        self._quantum.fill(first, out)

    def plan(self) -> Plan:
        """Return the amounts as levels."""
        return self._quantum.plan()
