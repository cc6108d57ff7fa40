"""Numbers over time for a page: thinned where there are too many, rounded, packed and compressed.

A column is one number over time. The page gets all columns of a run as one text. Each number is a float32 whose last
eight bits are zero: it has 16 significant bits, which is finer than any screen, and halves the text. Numbers that are
nearer to one another than to zero, such as coordinates in a national grid, are counted from the first of them.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.storage import blocks

Floats: TypeAlias = NDArray[np.float64]
Reference: TypeAlias = float | list[float] | None
"""A column as the page finds it: its offset and length among all numbers, and what is added to these, if anything; of a
constant one the number itself, which is None if it is no number."""

MOST_NUMBERS = 5_000_000
"""Numbers of the signals of a run; about 3 bytes of the page each."""
FEWEST_BUCKETS = 50
_LEVEL = 4
"""Of compression: more takes twice the time and saves 2 %."""


class Columns:
    """The columns of one run, which grow."""

    def __init__(self) -> None:
        self._parts: list[NDArray[np.uint32]] = []
        self._length = 0

    def add(self, values: Floats) -> Reference:
        """Add a column (T,), and return how the page finds it."""
        if len(values) and (np.isnan(values).all() or (values == values[0]).all()):
            first = float(values[0])
            return first if np.isfinite(first) else None
        offset, base = self._length, _base(values)
        with np.errstate(over="ignore"):
            bits = (values - base).astype(np.float32).view(np.uint32)
        self._parts.append((bits + np.uint32(0x80)) >> np.uint32(8))
        self._length += len(values)
        return [offset, len(values), *[base] * (base != 0.0)]

    def packed(self) -> str:
        """Return all numbers as a text: their first bytes, their second and their third ones, deflated, in base 64."""
        bits = np.concatenate(self._parts) if self._parts else np.zeros(0, np.uint32)
        planes = b"".join((bits >> shift).astype(np.uint8).tobytes() for shift in (16, 8, 0))
        return base64.b64encode(zlib.compress(planes, _LEVEL)).decode("ascii")


class Rows:
    """The columns of some samples of a run as they are, for a page that gets more of them; each has a number."""

    def __init__(self) -> None:
        self._columns: list[Floats] = []

    def add(self, values: Floats) -> Reference:
        """Add a column (T,), and return its number in a list."""
        self._columns.append(values)
        return [len(self._columns) - 1]

    def numbers(self) -> Floats:
        """Return all numbers (T, columns)."""
        return np.stack(self._columns, axis=1)


def _base(values: Floats) -> float:
    """Return the number that others are counted from: the first one, if all are nearer to one another than to zero."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return 0.0
    low, high = float(finite.min()), float(finite.max())
    return float(finite[0]) if high - low < max(low, -high) else 0.0


def samples_in_bucket(samples: int, columns: int, most: int = MOST_NUMBERS) -> int:
    """Return how many samples share a bucket, of which only the extremes are kept; 1: all are kept."""
    if samples * columns <= most:
        return 1
    buckets = max(most // (2 * columns), FEWEST_BUCKETS)
    return -(-samples // buckets)


def extremes(part: Callable[[slice], Floats], samples: int, size: int) -> Floats:
    """Return the extremes of each bucket of samples, of several courses.

    Parameters
    ----------
    part
        Returns some samples of the courses, (samples, courses): one block after the other, never all at once.
    samples
        How many there are.
    size
        Samples in a bucket; 1: the courses are returned as they are.

    Returns
    -------
    ndarray
        For each bucket (2, courses): the least and the greatest value of each course, the one that comes first at
        first; NaN if it has no number.
    """
    if size == 1:
        return part(slice(0, samples))
    width = part(slice(0, 0)).shape[1]
    found = np.empty((2 * -(-samples // size), width))
    for block in blocks(samples, width, size):
        start = 2 * (block.start // size)
        own = _extremes(part(block), size)
        found[start : start + len(own)] = own
    return found


def _extremes(values: Floats, size: int) -> Floats:
    rows = -(-len(values) // size)
    padded = np.full((values.shape[1], rows * size), np.nan)
    padded[:, : len(values)] = values.T
    table = padded.reshape(-1, rows, size)
    missing = np.isnan(table)
    least = np.where(missing, np.inf, table).argmin(axis=2)
    greatest = np.where(missing, -np.inf, table).argmax(axis=2)
    both = np.sort(np.stack([least, greatest], axis=2), axis=2)
    return np.take_along_axis(table, both, axis=2).reshape(len(table), -1).T
