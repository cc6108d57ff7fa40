"""The magnitude of a signal at the end of a window is below a bound."""

from __future__ import annotations

from cosim.results.expectations.bounded import Bounded
from cosim.results.metrics import MEASURES


class Final(Bounded):
    """``<final>``, whose window may be an instant."""

    element = "final"
    measure = MEASURES["final"]
    lasts = False
