"""Linear interpolation with the same bits on every machine; that of NumPy is compiled with fused products on some."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def interpolated(times: Floats, known: Floats, values: Floats) -> Floats:
    """Return values (n,) at some times, from those (m,) at known times that rise; beyond the ends, the outer ones."""
    after = np.clip(np.searchsorted(known, times, side="right"), 1, len(known) - 1) if len(known) > 1 else 0
    before = np.maximum(after - 1, 0)
    with np.errstate(all="ignore"):  # two times may be so close that a slope is infinite
        slopes = (values[after] - values[before]) / (known[after] - known[before])
        between = slopes * (times - known[before]) + values[before]
    between = np.where(times <= known[before], values[before], between)
    found: Floats = np.where(times >= known[after], values[after], between)
    return found
