"""Distances of convex polygons, against cases that can be computed by hand and against a plain search in Python."""

import cmath
import math

import numpy as np
import pytest

from cosim.results.convex import distances, gaps

Polygon = list[complex]

SQUARE: Polygon = [0, 2, 2 + 2j, 2j]
SMALL: Polygon = [0.5 + 0.5j, 1.5 + 0.5j, 1 + 1.5j]
BAR: Polygon = [-1 + 0.9j, 3 + 0.9j, 3 + 1.1j, -1 + 1.1j]


def arrow(tip: complex) -> Polygon:
    """Return a triangle to the right of its tip."""
    return [tip, tip + 1 - 1j, tip + 1 + 1j]


def measured(one: list[Polygon], other: list[Polygon]) -> np.ndarray:
    """Return the distances of pairs of polygons."""
    a, b = columns(one), columns(other)
    return np.where(gaps(a, b) < 0, 0.0, distances(a, b))


def columns(polygons: list[Polygon], corners: int = 6) -> np.ndarray:
    """Return polygons as (2, corners, polygons), the last corner of each repeated."""
    padded = np.array([[*polygon, *[polygon[-1]] * (corners - len(polygon))] for polygon in polygons], dtype=complex).T
    return np.stack([padded.real, padded.imag])


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (arrow(3 + 1j), 1.0),  # a corner and an edge
        (arrow(3 + 6j), math.sqrt(13)),  # two corners
        (arrow(-4 + 1j), 3.0),  # two parallel edges
        (arrow(2 + 1j), 0.0),  # they touch
        (arrow(1.5 + 1j), 0.0),
        (SMALL, 0.0),  # one within the other
        (BAR, 0.0),  # they cross, and no corner is within the other
        (SQUARE, 0.0),
    ],
)
def test_distances_by_hand(other: Polygon, expected: float) -> None:
    assert measured([SQUARE, other], [other, SQUARE]) == pytest.approx(expected, abs=1e-15)


def test_the_gap_is_the_distance_but_for_two_corners() -> None:
    found = gaps(columns([SQUARE] * 3), columns([arrow(3 + 1j), arrow(3 + 6j), arrow(1.5 + 1j)]))
    assert found[0] == 1.0
    assert 0 < found[1] < math.sqrt(13)
    assert found[2] == -0.5


# A plain search --------------------------------------------------------------------------------------------------


def side(start: complex, stop: complex, point: complex) -> float:
    """Return on which side of a line a point is: left is positive."""
    return ((stop - start).conjugate() * (point - start)).imag


def to_segment(point: complex, start: complex, stop: complex) -> float:
    part = ((point - start) / (stop - start)).real
    return abs(point - (start + min(max(part, 0.0), 1.0) * (stop - start)))


def searched(one: Polygon, other: Polygon) -> float:
    edges, others = ([(p[k - 1], p[k]) for k in range(len(p))] for p in (one, other))
    if any(all(side(a, b, point) > 0 for a, b in edges) for point in other):
        return 0.0
    if any(all(side(a, b, point) > 0 for a, b in others) for point in one):
        return 0.0
    for a, b in edges:
        for c, d in others:
            if side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0:
                return 0.0
    return min(
        *(to_segment(point, a, b) for point in one for a, b in others),
        *(to_segment(point, a, b) for point in other for a, b in edges),
    )


def test_distances_of_random_polygons() -> None:
    rng = np.random.default_rng(7)

    def polygon(spread: float) -> Polygon:
        """Return a convex polygon: points of an ellipse in order, turned and moved."""
        angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 7)))
        turn, place = cmath.exp(1j * rng.uniform(0, 7)), complex(*rng.normal(size=2)) * spread
        return [complex(2 * math.cos(angle), math.sin(angle)) * turn + place for angle in angles]

    pairs = [(polygon(0.0), polygon(spread)) for spread in (0.3, 2.0, 5.0) for _ in range(500)]
    found = measured([one for one, _ in pairs], [other for _, other in pairs])
    expected = [searched(*pair) for pair in pairs]
    assert found == pytest.approx(expected, abs=1e-12)
    assert 300 < expected.count(0.0) < 1200
