"""The change of a signal from sample to sample, as a root mean square, is below a bound."""

from __future__ import annotations

from cosim.results.expectations.bounded import Bounded
from cosim.results.metrics import MEASURES


class Chatter(Bounded):
    """``<chatter>``."""

    element = "chatter"
    measure = MEASURES["chatter"]
