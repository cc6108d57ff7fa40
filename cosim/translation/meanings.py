"""What Python's operators and functions are in C, with the same bits."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from cosim.translation import values
from cosim.translation.kinds import BOOL, FLOAT, INT, Scalar

ARITHMETIC: Final[Mapping[type[ast.operator], tuple[str, int]]] = MappingProxyType(
    {
        ast.Add: ("+", values.ADD),
        ast.Sub: ("-", values.ADD),
        ast.Mult: ("*", values.MULTIPLY),
        ast.Div: ("/", values.MULTIPLY),
    }
)
BITWISE: Final[Mapping[type[ast.operator], tuple[str, int]]] = MappingProxyType(
    {
        ast.BitAnd: ("&", values.BIT_AND),
        ast.BitOr: ("|", values.BIT_OR),
        ast.BitXor: ("^", values.BIT_XOR),
        ast.RShift: (">>", values.SHIFT),
    }
)
COMPARISONS: Final[Mapping[type[ast.cmpop], tuple[str, int]]] = MappingProxyType(
    {
        ast.Lt: ("<", values.LESS),
        ast.LtE: ("<=", values.LESS),
        ast.Gt: (">", values.LESS),
        ast.GtE: (">=", values.LESS),
        ast.Eq: ("==", values.EQUAL),
        ast.NotEq: ("!=", values.EQUAL),
    }
)

FLOAT_FUNCTIONS: Final[Mapping[Any, tuple[str, int]]] = MappingProxyType(
    {
        math.sqrt: ("sqrt", 1),
        math.fabs: ("fabs", 1),
        math.copysign: ("copysign", 2),
        np.sqrt: ("sqrt", 1),
        np.floor: ("floor", 1),
        np.ceil: ("ceil", 1),
        np.trunc: ("trunc", 1),
        np.rint: ("rint", 1),
        np.copysign: ("copysign", 2),
        np.fabs: ("fabs", 1),
    }
)
"""Functions of floats that IEEE 754 defines to the last bit, with how many arguments they take."""

FLOAT_TESTS: Final[Mapping[Any, str]] = MappingProxyType(
    {
        math.isnan: "isnan",
        math.isinf: "isinf",
        math.isfinite: "isfinite",
        np.isnan: "isnan",
        np.isinf: "isinf",
        np.isfinite: "isfinite",
    }
)
INTEGER_FUNCTIONS: Final[Mapping[Any, str]] = MappingProxyType(
    {math.floor: "floor", math.ceil: "ceil", math.trunc: "trunc"}
)
"""Functions of floats whose results are whole numbers."""

EXTREMES: Final[Mapping[tuple[Any, Scalar], str]] = MappingProxyType(
    {
        (min, FLOAT): "minimum",
        (max, FLOAT): "maximum",
        (min, INT): "minimum_integer",
        (max, INT): "maximum_integer",
    }
)

PRIMITIVES: Final[Mapping[str, tuple[str, tuple[Scalar, ...], Scalar]]] = MappingProxyType(
    {
        "to_bits": ("to_bits", (FLOAT,), INT),
        "from_bits": ("from_bits", (INT,), FLOAT),
        "as_float": ("(double)", (INT,), FLOAT),
        "sqrt": ("sqrt", (FLOAT,), FLOAT),
        "floor": ("floor", (FLOAT,), FLOAT),
        "copysign": ("copysign", (FLOAT, FLOAT), FLOAT),
    }
)
"""Functions that a package may declare as primitives, by their names: name in C, arguments and result. Besides these
there is ``select(condition, a, b)``."""

_TWO = "static inline {kind} {name}({kind} a, {kind} b)\n{{\n    return {result};\n}}"
HELPERS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "to_bits": "/* The bits of a double as a whole number. */\n"
        "static inline int64_t to_bits(double x)\n{\n    int64_t bits;\n    memcpy(&bits, &x, sizeof bits);\n"
        "    return bits;\n}",
        "from_bits": "/* The double that has these bits. */\n"
        "static inline double from_bits(int64_t bits)\n{\n    double x;\n    memcpy(&x, &bits, sizeof x);\n"
        "    return x;\n}",
        "minimum": "/* The smaller number; the first if one is NaN. */\n"
        + _TWO.format(kind="double", name="minimum", result="b < a ? b : a"),
        "maximum": "/* The larger number; the first if one is NaN. */\n"
        + _TWO.format(kind="double", name="maximum", result="b > a ? b : a"),
        "minimum_integer": _TWO.format(kind="int64_t", name="minimum_integer", result="b < a ? b : a"),
        "maximum_integer": _TWO.format(kind="int64_t", name="maximum_integer", result="b > a ? b : a"),
        "quotient": "/* The quotient rounded down; zero for a divisor of zero. */\n"
        "static inline int64_t quotient(int64_t a, int64_t b)\n{\n    if (b == 0) return 0;\n"
        "    if (b == -1) return (int64_t)(0 - (uint64_t)a);\n"
        "    return a / b - (a % b != 0 && (a < 0) != (b < 0));\n}",
        "modulo": "/* The rest of it, with the sign of the divisor; zero for a divisor of zero. */\n"
        "static inline int64_t modulo(int64_t a, int64_t b)\n{\n    if (b == 0 || b == -1) return 0;\n"
        "    const int64_t rest = a % b;\n    return rest != 0 && (rest < 0) != (b < 0) ? rest + b : rest;\n}",
        "place": "/* A place among so many; a negative one counts from the end. */\n"
        "static inline int64_t place(int64_t index, int64_t size)\n{\n"
        "    return index < 0 ? index + size : index;\n}",
        "slice_size": "/* How many places there are from a start to a stop among so many; none by steps below 1. */\n"
        "static inline int64_t slice_size(int64_t start, int64_t stop, int64_t step, int64_t size)\n{\n"
        "    if (stop < 0) stop += size;\n    if (stop > size) stop = size;\n"
        "    return step > 0 && stop > start ? (stop - start - 1) / step + 1 : 0;\n}",
        "magnitude": "static inline int64_t magnitude(int64_t i)\n{\n    return i < 0 ? -i : i;\n}",
    }
)
"""Functions of which C has none, by name: they are written where they are used."""


def is_known(function: Callable[..., Any]) -> bool:
    """Tell whether a function has a meaning in C by itself."""
    try:
        return (
            function in FLOAT_FUNCTIONS
            or function in FLOAT_TESTS
            or function in INTEGER_FUNCTIONS
            or function in (min, max, abs, len, int, float, np.empty, np.zeros)
        )
    except TypeError:  # not hashable
        return False


__all__ = [
    "ARITHMETIC",
    "BITWISE",
    "BOOL",
    "COMPARISONS",
    "EXTREMES",
    "FLOAT_FUNCTIONS",
    "FLOAT_TESTS",
    "HELPERS",
    "INTEGER_FUNCTIONS",
    "PRIMITIVES",
    "is_known",
]
