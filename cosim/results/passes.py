"""Figures of long courses, block by block, with the bits that NumPy gives for the whole.

A course may lie in a file that is larger than the memory; no temporary array here is as long as it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
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


def extremes_of_each(courses: Floats, chosen: Sequence[int]) -> list[tuple[int, int]]:
    """Return, for each that is chosen of courses (T, courses), the first samples of its smallest and largest number.

    Both are the first one that is not a number, if there is such.
    """
    found = [(0, 0)] * len(chosen)
    for block in blocks(len(courses), len(chosen)):
        part, start = np.array(courses[block].T[chosen], order="C"), int(block.start)
        for place, (least, most) in enumerate(
            zip(part.argmin(axis=1).tolist(), part.argmax(axis=1).tolist(), strict=True)
        ):
            low, high = found[place]
            before, own = courses[:, chosen[place]], part[place]
            if start and math.isnan(before[low]):
                continue
            found[place] = (
                low if start and own[least] >= before[low] else start + least,
                high if start and own[most] <= before[high] else start + most,
            )
    return found


def largest_magnitude(course: Floats) -> int:
    """Return the first sample at which a course (T,) is largest in magnitude, or not a number."""
    return smallest(course, lambda part: -np.abs(part))


def missing(courses: Floats) -> list[bool]:
    """Return of which courses (T, courses, ...) no entry is a number."""
    first = np.isnan(courses[:1])
    if not first.any():  # as of most
        return [not len(courses)] * courses.shape[1]

    def is_missing(course: Floats) -> bool:
        return all(np.isnan(course[block]).all() for block in blocks(len(course), max(course[:1].size, 1)))

    return [bool(first[:, one].all()) and is_missing(courses[:, one]) for one in range(courses.shape[1])]


def last_outside(count: int, courses: int, within: Callable[[slice], NDArray[np.bool_]]) -> list[int]:
    """Return, for each of several courses, the last sample of so many that is not within something; -1 if all are.

    The function gets part after part, and returns (samples, courses).
    """
    last = [-1] * courses
    for block in blocks(count, courses):
        outside = ~within(block)
        for course in range(courses):
            back = outside[::-1, course]
            if back[first := int(back.argmax())]:
                last[course] = int(block.start) + len(back) - 1 - first
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
