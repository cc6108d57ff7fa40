"""The signals, limits and moment of a run by which a reader can see why an expectation holds or fails."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Band:
    """A signal that an expectation is about, over a window, with the limits that its values have there.

    Attributes
    ----------
    signal, component : str
        The signal, and its component if it has any.
    start, stop : float
        The window [s].
    lower, upper : float
        The limits in the signal's unit; infinite where there is none, as for a signal of which a sum is judged.
    inside : bool
        Whether values belong between the limits; otherwise they belong outside.
    """

    signal: str
    component: str
    start: float
    stop: float
    lower: float = -math.inf
    upper: float = math.inf
    inside: bool = True
