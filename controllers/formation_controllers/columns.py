"""Followers side by side: one number of several robots is a column, which vector instructions work on at once.

A law takes a block of followers at a time. Its columns are the fields of one record, so that a compiler sees that no
two of them overlap. A loop over robots that has nothing but columns and formulas without a call is vectorised by it;
every number is rounded as it would be alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from formation_controllers.compiled import part
from formation_controllers.elementary import FAR, near_sin_cos, near_sin_cos_tan, sin_cos, sin_cos_tan
from formation_controllers.interface import Floats

BLOCK: Final = 16
"""Robots in a block: enough for the widest vectors, few enough for the columns to stay in the fastest cache."""


def columns(shapes: Mapping[str, tuple[int, ...]]) -> NDArray[np.void]:
    """Return an array of one record that has a field of columns, one a robot of a block, for each name."""
    return np.zeros(1, np.dtype([(name, float, (*shape, BLOCK)) for name, shape in shapes.items()]))


@part
def sin_cos_of(angle: Floats, sine: Floats, cosine: Floats, count: int) -> None:
    """Fill in sine and cosine of the first angles [rad] of a column."""
    for r in range(count):
        sine[r], cosine[r] = near_sin_cos(angle[r] if abs(angle[r]) <= FAR else 0.0)
    for r in range(count):
        if not abs(angle[r]) <= FAR:
            sine[r], cosine[r] = sin_cos(angle[r])


@part
def sin_cos_tan_of(angle: Floats, sine: Floats, cosine: Floats, tangent: Floats, count: int) -> None:
    """Fill in sine, cosine and tangent of the first angles [rad] of a column."""
    for r in range(count):
        sine[r], cosine[r], tangent[r] = near_sin_cos_tan(angle[r] if abs(angle[r]) <= FAR else 0.0)
    for r in range(count):
        if not abs(angle[r]) <= FAR:
            sine[r], cosine[r], tangent[r] = sin_cos_tan(angle[r])
