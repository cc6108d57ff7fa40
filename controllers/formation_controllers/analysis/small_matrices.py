"""Linear algebra of small matrices, one operation after the other: the bits of a library's depend on the processor."""

from __future__ import annotations

import math
from functools import reduce

import numpy as np

from formation_controllers.interface import Floats

DOUBLINGS = 1100
"""Most steps of `riccati`, each of which stands for as many periods as all before it: prices of 1e-308 take 520."""
SETTLED = 1e-15
"""Relative change of each diagonal entry below which its solution no longer changes."""


def product(*factors: Floats) -> Floats:
    """Return the product of matrices, of which the last may be a vector."""
    return reduce(_product, factors)


def _product(a: Floats, b: Floats) -> Floats:
    total = np.zeros((len(a), *b.shape[1:]))
    for k, row in enumerate(b):
        total += np.multiply.outer(a[:, k], row)
    return total


def solve(a: Floats, b: Floats) -> Floats:
    """Return x with a x = b, both arrays of as many rows: elimination, the largest pivot of each column first.

    Raises
    ------
    numpy.linalg.LinAlgError
        The matrix is singular.
    """
    rows, sides = np.array(a, dtype=float), np.array(b, dtype=float)
    size = len(rows)
    for i in range(size):
        pivot = i + int(np.argmax(np.abs(rows[i:, i])))
        if rows[pivot, i] == 0.0 or not math.isfinite(rows[pivot, i]):
            raise np.linalg.LinAlgError("Singular matrix")
        rows[[i, pivot]], sides[[i, pivot]] = rows[[pivot, i]], sides[[pivot, i]]
        for k in range(i + 1, size):
            factor = rows[k, i] / rows[i, i]
            rows[k] -= factor * rows[i]
            sides[k] -= factor * sides[i]
    for i in reversed(range(size)):
        for k in range(i + 1, size):
            sides[i] -= rows[i, k] * sides[k]
        sides[i] /= rows[i, i]
    return sides


def inverse(a: Floats) -> Floats:
    """Return the inverse of a matrix."""
    return solve(a, np.eye(len(a)))


def exponential(a: Floats) -> Floats:
    """Return e to the power of a matrix: Taylor's series of a part of it, squared again and again."""
    halvings = max(0, math.frexp(float(np.abs(a).sum(axis=1).max()))[1] + 3)
    part = a * math.ldexp(1.0, -halvings)
    total = term = np.eye(len(a))
    for k in range(1, 16):
        term = product(term, part) / k
        total = total + term
    for _ in range(halvings):
        total = product(total, total)
    return total


def held(a: Floats, b: Floats, period: float) -> tuple[Floats, Floats]:
    """Return Phi and Gamma of x(t + period) = Phi x + Gamma u for der(x) = a x + b u, with u held over the period."""
    states, inputs = b.shape
    both = np.zeros((states + inputs, states + inputs))
    both[:states, :states], both[:states, states:] = a, b
    power = exponential(both * period)
    return power[:states, :states], power[:states, states:]


def riccati(a: Floats, b: Floats, q: Floats, r: Floats) -> Floats:
    """Return the stabilising X = a' X a - a' X b (r + b' X b)^-1 b' X a + q of linear-quadratic control.

    E. K.-W. Chu, H.-Y. Fan, W.-W. Lin, C.-S. Wang: Structure-preserving algorithms for periodic discrete-time algebraic
    Riccati equations. International Journal of Control 77 (2004), 767-788.

    Raises
    ------
    numpy.linalg.LinAlgError
        There is none.
    """
    g, h, one = product(b, solve(r, b.T)), q, np.eye(len(a))
    with np.errstate(all="ignore"):
        for _ in range(DOUBLINGS):
            inner = solve(one + product(g, h), np.hstack([a, g]))
            step, spread = inner[:, : len(a)], inner[:, len(a) :]
            more = product(a.T, h, step)
            g = g + product(a, spread, a.T)
            a = product(a, step)
            h = h + (more + more.T) / 2
            # Each entry for itself, as a slow mode may be the smallest. Both are positive semidefinite, so that the
            # diagonal bounds the rest: |more_ij| <= sqrt(more_ii more_jj).
            if not np.isfinite(h).all():
                break
            if (np.diag(more) <= SETTLED * np.diag(h)).all():
                return h
    raise np.linalg.LinAlgError("no stabilising solution of the Riccati equation was found")
