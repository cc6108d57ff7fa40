"""The integral of a signal's magnitude over time is below a bound."""

from __future__ import annotations

from cosim.results.expectations.bounded import Bounded
from cosim.results.metrics import MEASURES


class Effort(Bounded):
    """``<effort>``."""

    element = "effort"
    measure = MEASURES["effort"]
