"""Outputs that are one communication step late: one of two plants shows the other's motion a step later."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

SMALL = 0.01
"""Difference that may remain when one plant is taken a step later, relative to the unshifted difference."""


def one_step_late(a: NDArray[np.float64], b: NDArray[np.float64], apart: float, angles: Sequence[bool]) -> str:
    """Return the plant that is one communication step behind the other; empty if neither is.

    Parameters
    ----------
    a, b
        The states (T + 1, n) of the plants A and B; NaN where there is none.
    apart
        A difference that does not matter, in the units of the states.
    angles
        Mask of the states that are angles [rad].

    Returns
    -------
    {"A", "B", ""}
    """
    now = _largest(a[1:], b[1:], angles)
    for late, later in (("B", _largest(a[:-1], b[1:], angles)), ("A", _largest(a[1:], b[:-1], angles))):
        if now.any() and (now > apart).any() and (later <= np.maximum(SMALL * now, apart)).all():
            return late
    return ""


def _largest(a: NDArray[np.float64], b: NDArray[np.float64], angles: Sequence[bool]) -> NDArray[np.float64]:
    """Return the largest difference of each state; 0 where there are none."""
    difference = np.nan_to_num(b - a, posinf=0.0, neginf=0.0)
    difference = np.where(angles, np.remainder(difference + np.pi, 2 * np.pi) - np.pi, difference)
    largest: NDArray[np.float64] = np.abs(difference).max(axis=0, initial=0.0)
    return largest
