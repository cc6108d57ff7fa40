"""Commands that change no faster than a limit, and start from zero."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cosim.compiled import compiled
from cosim.signals.effects.effect import Floats, Limit, Plan, Rows
from cosim.signals.effects.schedule import Schedule, clipped


@compiled
def follow(tick: int, values: Floats, amount: Floats, memory: Floats) -> None:
    """Follow the values by no more than the amounts, where these are finite."""
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            before, most = memory[0, i, j], amount[i, j]
            if math.isfinite(most):
                values[i, j] = before + clipped(values[i, j] - before, most)
            memory[0, i, j] = values[i, j]


class Rate(Limit):
    """``<rate>``."""

    element = "rate"
    order = 1
    of_rate = True
    act = staticmethod(follow)
    remembers = 1

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self._limit = Schedule(self.element, rows, math.inf, np.minimum)

    def amounts(self, first: int, out: Floats) -> None:
        """Write the largest changes in a tick."""
        self._limit.fill(first, out)
        out *= self.rows.step

    def plan(self) -> Plan:
        """Return the largest changes in a tick as levels."""
        limits = self._limit.plan()
        return replace(limits, levels=limits.levels * self.rows.step)
