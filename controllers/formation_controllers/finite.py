"""Whether all numbers of a tick's arrays are finite: compiled, as NumPy's own test costs more than a law."""

from __future__ import annotations

import math

from formation_controllers.compiled import compiled
from formation_controllers.interface import Floats


@compiled
def finite(array: Floats) -> bool:
    """Tell whether every number of a C-contiguous array is finite."""
    for number in array.ravel():  # noqa: SIM110 (compiled code)
        if not math.isfinite(number):
            return False
    return True


@compiled
def all_finite(a: Floats, b: Floats, c: Floats, d: Floats, e: Floats, f: Floats) -> bool:
    """Tell whether every number of six C-contiguous arrays is finite."""
    return finite(a) and finite(b) and finite(c) and finite(d) and finite(e) and finite(f)
