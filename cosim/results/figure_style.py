"""How a figure tells followers apart: a colour each, which the colour-blind can tell up to eight."""

from __future__ import annotations

from typing import TypeAlias

import matplotlib as mpl
import numpy as np
from matplotlib.colors import to_hex

from cosim.results.colours import COLOURS

Colour: TypeAlias = str

LEADER = "black"


def colours_of(number: int) -> list[Colour]:
    """Return the colours of some followers, in their order; of more than eight along a scale from dark to light."""
    if number <= len(COLOURS):
        return list(COLOURS[:number])
    return [to_hex(colour) for colour in mpl.colormaps["viridis"](np.linspace(0, 0.92, number))]
