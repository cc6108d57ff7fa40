"""The same value all the time."""

from __future__ import annotations

from cosim.signals.waves.wave import Kept


class Constant(Kept):
    """``<constant>``."""

    element = "constant"
