"""The root mean square of a signal is below a bound."""

from __future__ import annotations

from cosim.results.expectations.bounded import Bounded
from cosim.results.metrics import MEASURES


class Rms(Bounded):
    """``<rms>``."""

    element = "rms"
    measure = MEASURES["rms"]
