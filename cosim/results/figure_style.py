"""How a figure tells followers apart: a colour each, which the colour-blind can tell up to eight."""

from __future__ import annotations

from typing import TypeAlias

import matplotlib as mpl
import numpy as np
from matplotlib.colors import to_hex

Colour: TypeAlias = str

LEADER = "black"
GOOD, BAD = "#1a7f37", "#c4232c"
"""Where values belong, and where not."""
_FEW = ("#4477AA", "#EE6677", "#228833", "#B8860B", "#2AA7C9", "#AA3377", "#E07B39", "#7A68C4")
"""As on the page of a run."""


def colours_of(number: int) -> list[Colour]:
    """Return the colours of some followers, in their order; of more than eight along a scale from dark to light."""
    if number <= len(_FEW):
        return list(_FEW[:number])
    return [to_hex(colour) for colour in mpl.colormaps["viridis"](np.linspace(0, 0.92, number))]
