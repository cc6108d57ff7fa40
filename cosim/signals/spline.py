"""A quintic spline through points in plain arithmetic, whose bits, unlike those of LAPACK, no machine changes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

DEGREE = 5


@dataclass(frozen=True, eq=False)
class Spline:
    """A sum of B-splines.

    Attributes
    ----------
    knots : ndarray
        Knots, those at both ends `DEGREE` + 1 times.
    coefficients : ndarray (n, columns)
        One row a B-spline.
    """

    knots: Floats
    coefficients: Floats

    def __call__(self, times: Floats, order: int = 0) -> Floats:
        """Return the values (T, columns) of a derivative, of order 0 the values of the spline itself."""
        knots, coefficients, degree = self.knots, self.coefficients, DEGREE
        for _ in range(order):
            spans = (knots[degree + 1 : -1] - knots[1 : -degree - 1])[:, np.newaxis]
            coefficients = degree * np.diff(coefficients, axis=0) / spans
            knots, degree = knots[1:-1], degree - 1
        first, weights = _b_splines(knots, degree, times)
        total = np.zeros((len(times), coefficients.shape[1]))
        for j, weight in enumerate(weights):
            total += weight[:, np.newaxis] * coefficients[first + j]
        return total


def through(times: Floats, points: Floats) -> Spline:
    """Return the spline through points (n, columns), n > `DEGREE`; the first three and the last three are one piece.

    Raises
    ------
    ValueError
        The times do not increase.
    """
    if any(not before < after for before, after in pairwise(times.tolist())):
        raise ValueError("the times do not increase")
    ends = [np.full(DEGREE + 1, time) for time in (times[0], times[-1])]
    knots = np.concatenate([ends[0], times[3:-3], ends[1]])
    first, weights = _b_splines(knots, DEGREE, times)
    # The rows of a matrix, each from DEGREE places before its diagonal to as many behind
    rows = np.zeros((len(times), 2 * DEGREE + 1))
    for j, weight in enumerate(weights):
        rows[np.arange(len(times)), first + j - np.arange(len(times)) + DEGREE] = weight
    return Spline(knots, _solved(rows.tolist(), points.tolist()))


def _b_splines(knots: Floats, degree: int, times: Floats) -> tuple[NDArray[np.intp], list[Floats]]:
    """Return the index of the first of `degree` + 1 B-splines that are not zero at a time, and their values.

    C. de Boor: On calculating with B-splines. Journal of Approximation Theory 6 (1972), 50-62.
    """
    span = np.clip(np.searchsorted(knots, times, side="right") - 1, degree, len(knots) - degree - 2)
    values = [np.ones(len(times))]
    for j in range(1, degree + 1):
        carried, following = np.zeros(len(times)), []
        for r, value in enumerate(values):
            right, left = knots[span + r + 1], knots[span + 1 - j + r]
            part = value / (right - left)
            following.append(carried + (right - times) * part)
            carried = (times - left) * part
        values = [*following, carried]
    return span - degree, values


def _solved(rows: list[list[float]], sides: list[list[float]]) -> Floats:
    """Solve equations, each of which has but the unknowns near its own, by elimination without exchange of rows.

    None is needed, as a matrix of B-splines is totally positive.
    """
    size = len(rows)
    for i, row in enumerate(rows):
        for k in range(i + 1, min(i + DEGREE + 1, size)):
            factor = rows[k][i - k + DEGREE] / row[DEGREE]
            if factor:
                for m in range(1, DEGREE + 1):
                    rows[k][i - k + DEGREE + m] -= factor * row[DEGREE + m]
                sides[k] = [a - factor * b for a, b in zip(sides[k], sides[i], strict=True)]
    for i in reversed(range(size)):
        for m in range(1, min(DEGREE, size - 1 - i) + 1):
            sides[i] = [a - rows[i][DEGREE + m] * b for a, b in zip(sides[i], sides[i + m], strict=True)]
        sides[i] = [a / rows[i][DEGREE] for a in sides[i]]
    return np.array(sides)
