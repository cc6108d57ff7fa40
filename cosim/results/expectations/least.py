"""The smallest value of a signal is above a bound."""

from __future__ import annotations

import math

from cosim.results.expectations.bounded import Bounded
from cosim.results.metrics import MEASURES


class Least(Bounded):
    """``<least>``."""

    element = "least"
    measure = MEASURES["least"]
    attribute = "above"

    def limits(self, bound: float) -> tuple[float, float]:
        """Return the lower limit."""
        return bound, math.inf
