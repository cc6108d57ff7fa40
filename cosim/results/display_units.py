"""The units in which people are shown what is kept in others."""

from __future__ import annotations

import math
from collections.abc import Mapping

DISPLAYED: Mapping[str, tuple[str, float]] = {
    "rad": ("deg", 180 / math.pi),
    "rad/s": ("deg/s", 180 / math.pi),
}
"""Internal unit -> (unit shown, factor)."""


def displayed(unit: str) -> tuple[str, float]:
    """Return the unit in which a quantity is shown, and the factor from its own."""
    return DISPLAYED.get(unit, (unit, 1.0))
