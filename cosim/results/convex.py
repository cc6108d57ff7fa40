"""How far convex polygons are from each other: many pairs at once, exactly.

The corners of a polygon of each pair are (2, n, pairs): x and y, counter-clockwise. One with fewer corners than others
has its last one several times.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]


def gaps(one: Floats, other: Floats) -> Floats:
    """Return the widest gap along the normal of any edge, (pairs,).

    Where it is negative the polygons overlap. Otherwise it is their distance, or less where two corners are nearest.
    """
    return np.maximum(_gaps_beside(one, other), _gaps_beside(other, one))


def distances(one: Floats, other: Floats) -> Floats:
    """Return the distances of polygons that do not overlap, (pairs,)."""
    return np.sqrt(np.minimum(_squares_to_edges(one, other), _squares_to_edges(other, one)))


def _gaps_beside(one: Floats, other: Floats) -> Floats:
    """Return how far the whole of the other polygon is beside an edge of the first, at most."""
    widest = np.full(one.shape[-1], -np.inf)
    for x, y, along_x, along_y in _edges(one):
        outward = (along_y * (other[0] - x) - along_x * (other[1] - y)).min(axis=0)
        length = np.sqrt(along_x**2 + along_y**2)
        gap = np.divide(outward, length, out=np.full_like(widest, -np.inf), where=length > 0)
        np.maximum(widest, gap, out=widest)
    return widest


def _squares_to_edges(one: Floats, other: Floats) -> Floats:
    """Return the squared distance of the nearest corner of one polygon to an edge of the other."""
    nearest = np.full(one.shape[-1], np.inf)
    for x, y, along_x, along_y in _edges(other):
        off_x, off_y = one[0] - x, one[1] - y
        square = along_x**2 + along_y**2
        reached = off_x * along_x + off_y * along_y
        part = np.divide(reached, square, out=np.zeros_like(reached), where=square > 0).clip(0.0, 1.0)
        squares = (off_x - part * along_x) ** 2 + (off_y - part * along_y) ** 2
        np.minimum(nearest, squares.min(axis=0), out=nearest)
    return nearest


def _edges(corners: Floats) -> Iterator[tuple[Floats, Floats, Floats, Floats]]:
    """Yield start (x, y) and direction (x, y) of each edge."""
    for k in range(corners.shape[1]):
        (x, y), (to_x, to_y) = corners[:, k - 1], corners[:, k]
        yield x, y, to_x - x, to_y - y
