"""Arrays in memory that this process shares with the processes that are forked from it."""

from __future__ import annotations

import math
import mmap
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray


def shared(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Return zeros in shared memory."""
    of = np.dtype(dtype)
    size = math.prod(shape)
    return np.frombuffer(mmap.mmap(-1, max(size * of.itemsize, 1)), of, size).reshape(shape)
