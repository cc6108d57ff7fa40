"""The largest magnitude of a signal is below a bound."""

from __future__ import annotations

from cosim.results.expectations.bounded import Bounded
from cosim.results.metrics import MEASURES


class Peak(Bounded):
    """``<peak>``."""

    element = "peak"
    measure = MEASURES["peak"]
