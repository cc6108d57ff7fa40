"""Zero before a time, a value from then on."""

from __future__ import annotations

from cosim.signals.waves.wave import Kept


class Step(Kept):
    """``<step>``."""

    element = "step"
