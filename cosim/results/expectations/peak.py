"""The largest magnitude of a signal is below a bound."""

from __future__ import annotations

from cosim.results.expectations.bounded import Bounded
from cosim.results.metrics import MEASURES


class Peak(Bounded):
    """``<peak>``."""

    element = "peak"
    measure = MEASURES["peak"]

    def limits(self, bound: float) -> tuple[float, float]:
        """Return the limits of the magnitude."""
        return -bound, bound
