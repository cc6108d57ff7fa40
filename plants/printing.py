"""How expressions, in C as in Python, call functions whose bits are the same on every machine."""

from typing import Any

import sympy
from sympy.printing.precedence import precedence

from plants import elementary, logarithms

OWN_FUNCTIONS = {
    **{name: name for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "hypot")},
    **{name: name for name in ("sinh", "cosh", "tanh", "asinh", "acosh", "atanh")},
    **{name: name for name in ("exp", "expm1", "log", "log1p", "log2", "log10")},
    "Cbrt": "cbrt",
    "Max": "larger",
    "Min": "smaller",
}
"""Functions of SymPy, and their names in `plants.elementary` and `plants.logarithms`. Others, such as erf, come
from a C library."""


class Powers:
    """A printer's way with powers: products where the exponent is a small whole number, else functions of our own."""

    own_prefix = ""

    def _print_Pow(self: Any, expression: sympy.Pow, **_: Any) -> str:
        base, exponent = expression.args
        if exponent.is_Integer and 2 <= exponent <= 4:
            return f"({'*'.join([self.parenthesize(base, precedence(expression))] * int(exponent))})"
        if exponent.is_Integer and -4 <= exponent <= -2:
            return f"1.0/{self._print(sympy.Pow(base, -exponent, evaluate=False))}"
        if exponent in (-1, sympy.S.Half):
            return str(super()._print_Pow(expression))  # type: ignore[misc]
        if exponent == sympy.Rational(1, 3):
            return f"{self.own_prefix}cbrt({self._print(base)})"
        return f"{self.own_prefix}pow({self._print(base)}, {self._print(exponent)})"


def scalar_functions() -> dict[str, Any]:
    """Return the functions by the names that a printer for Python gives them."""
    own = {**vars(elementary), **vars(logarithms)}
    return {name: own[name] for name in (*OWN_FUNCTIONS.values(), "cbrt", "pow")}
