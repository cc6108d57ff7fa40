"""A value between two times, zero otherwise."""

from __future__ import annotations

from cosim.signals.waves.wave import Kept


class Pulse(Kept):
    """``<pulse>``."""

    element = "pulse"
