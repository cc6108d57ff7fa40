"""Short forms: equal to the long ones, and short."""

import numpy as np
import pytest
import sympy
from sympy import cos, sin, tan

from plants.trigonometry import shorten

a, b, k, m = sympy.symbols("a b k m", real=True)
choice = sympy.Symbol("choice", integer=True)


@pytest.mark.parametrize(
    ("expression", "short"),
    [
        (sin(a) ** 2 + cos(a) ** 2, 1),
        (k * cos(a) ** 2 + k * sin(a) ** 2 + m, k + m),
        (k * cos(a) ** 2 + m * sin(a) ** 2, k * cos(a) ** 2 + m * sin(a) ** 2),
        (cos(a) * cos(a + b) + sin(a) * sin(a + b), cos(b)),
        (cos(a) * cos(a + b) + sin(a) * sin(a + b) + tan(b) * sin(b), 1 / cos(b)),
        (tan(a) ** 2 + 1, 1 / cos(a) ** 2),
        (k * sin(a) / cos(a), k * tan(a)),
        (k / m + k * tan(a) ** 2 / m, k / (m * cos(a) ** 2)),
        (sin(a) * cos(b) - sin(b) * cos(a) - sin(a - b), 0),
        (sympy.Integer(0), 0),
        (sympy.exp(k) * (sin(a) ** 2 + cos(a) ** 2), sympy.exp(k)),
        (
            cos(a) * sympy.Piecewise((cos(a), sympy.Eq(choice, 1)), (0, True)) + sin(a) ** 2,
            sympy.Piecewise((1, sympy.Eq(choice, 1)), (sin(a) ** 2, True)),
        ),
    ],
)
def test_known_forms(expression: sympy.Expr, short: sympy.Expr) -> None:
    assert shorten(expression) == short


def test_value_is_kept() -> None:
    """Random sums of products of trigonometric functions, at random points."""
    rng = np.random.default_rng(1)
    factors = [sin(a), cos(a), tan(a), sin(a - b), cos(a + b), tan(b), 1 / cos(b), k, m, 1 / m]
    for _ in range(30):
        terms = [
            int(rng.integers(-3, 4)) * sympy.Mul(*(factors[i] for i in rng.integers(len(factors), size=4)))
            for _ in range(4)
        ]
        expression = sympy.Add(*terms)
        point = dict(zip((a, b, k, m), rng.uniform(0.2, 1.2, 4), strict=True))
        short = shorten(expression)
        assert float(short.subs(point)) == pytest.approx(float(expression.subs(point)), rel=1e-9, abs=1e-9)
