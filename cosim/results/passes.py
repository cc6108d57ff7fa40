"""Figures of long courses, block by block, with the bits that NumPy gives for the whole.

A course may lie in a file that is larger than the memory; no temporary array here is as long as it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.storage import blocks, forget

Floats: TypeAlias = NDArray[np.float64]

_SUMMED_AT_ONCE = 2**15
"""Numbers that NumPy is given to sum up: a multiple of the 128 that it adds one after the other."""


def total(terms: Callable[[slice], Floats], count: int, start: int = 0) -> float:
    """Return the sum of some terms as `numpy.sum` adds an array of them: pairwise, halves of multiples of eight.

    Parameters
    ----------
    terms
        Returns a part of the terms.
    count
        How many there are.
    start
        The first of them.
    """
    if count <= _SUMMED_AT_ONCE:
        part = float(np.add.reduce(terms(slice(start, start + count))))
        forget()
        return part
    half = count // 2
    half -= half % 8
    return total(terms, half, start) + total(terms, count - half, start + half)


def smallest(course: Floats, of: Callable[[Floats], Floats] = lambda part: part) -> int:
    """Return the first sample at which what a function makes of a course (T, ...) is smallest, or not a number.

    The function gets part after part, and returns a number a sample.
    """
    at, least = 0, math.inf
    for block in blocks(len(course), max(course[:1].size, 1)):
        part = of(course[block])
        here = int(part.argmin())
        if math.isnan(part[here]):
            return int(block.start) + here
        if block.start == 0 or part[here] < least:
            at, least = int(block.start) + here, float(part[here])
    return at


def largest_magnitude(course: Floats) -> int:
    """Return the first sample at which a course (T,) is largest in magnitude, or not a number."""
    return smallest(course, lambda part: -np.abs(part))


def is_missing(course: Floats) -> bool:
    """Return whether no entry of a course (T, ...) is a number."""
    if not np.isnan(course[:1]).all():  # as of most courses
        return False
    return all(np.isnan(course[block]).all() for block in blocks(len(course), max(course[:1].size, 1)))


def last_outside(count: int, within: Callable[[slice], NDArray[np.bool_]]) -> int:
    """Return the last sample of so many that is not within something; -1 if all are."""
    last = -1
    for block in blocks(count):
        outside = np.flatnonzero(~within(block))
        if len(outside):
            last = block.start + int(outside[-1])
    return last


def sign_changes(course: Floats) -> tuple[int, int]:
    """Return how many samples of a course (T, numbers) have another sign than the one before, and the first of them."""
    count, first = 0, -1
    for block in blocks(len(course), max(course[:1].size, 1)):
        part = np.signbit(course[max(block.start - 1, 0) : block.stop])
        changes = np.flatnonzero(np.diff(part, axis=0).any(axis=1))
        if len(changes) and not count:
            first = max(block.start - 1, 0) + int(changes[0]) + 1
        count += len(changes)
    return count, first
