"""Unit expressions as FMI and Modelica write them: ``kg.m2``, ``N.m.s/rad``, ``1/s``, ``km/h``.

Grammar (Modelica 3.6, section 19.1): factors joined by ``.``, or ``1`` in place of those above, and at most one ``/``;
a denominator of several factors stands in parentheses; an exponent follows its symbol directly (``m2``, ``s-2``).
Radians are kept apart from pure numbers, so that ``rad/s`` and ``Hz`` are not taken for one another. Units with an
offset (``degC``) are not known.
"""

import math
import re
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, overload

from plants.errors import UnitError
from plants.spelling import respelled

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
"""The base units, in the order of the exponents in `Unit.exponents` and of FMI's element BaseUnit."""


@dataclass(frozen=True)
class Unit:
    """A unit in terms of the base units: 1 unit = ``factor`` * product of ``BASE_UNITS ** exponents``."""

    exponents: tuple[int, ...] = (0,) * len(BASE_UNITS)
    factor: float = 1.0

    def __mul__(self, other: "Unit") -> "Unit":
        exponents = tuple(i + j for i, j in zip(self.exponents, other.exponents, strict=True))
        return Unit(exponents, self.factor * other.factor)

    def __truediv__(self, other: "Unit") -> "Unit":
        exponents = tuple(i - j for i, j in zip(self.exponents, other.exponents, strict=True))
        return Unit(exponents, self.factor / other.factor)

    def __pow__(self, exponent: int) -> "Unit":
        return Unit(tuple(i * exponent for i in self.exponents), self.factor**exponent)

    def __str__(self) -> str:
        """Write the dimension as a unit expression in base units, or as N or N.m where it is one of these."""
        if self.exponents in _FORCES:
            return _FORCES[self.exponents]
        factors = list(zip(BASE_UNITS, self.exponents, strict=True))
        above = [name + (str(n) if n > 1 else "") for name, n in factors if n > 0]
        below = [name + (str(-n) if n < -1 else "") for name, n in factors if n < 0]
        text = ".".join(above) or "1"
        if not below:
            return text
        return f"{text}/{below[0]}" if len(below) == 1 else f"{text}/({'.'.join(below)})"


def _unit(factor: float = 1.0, **exponents: int) -> Unit:
    return Unit(tuple(exponents.get(name, 0) for name in BASE_UNITS), factor)


# Units that take a prefix. The gram is here for the sake of kg, a base unit with a prefix.
_PREFIXED = {
    "g": _unit(1e-3, kg=1),
    "m": _unit(m=1),
    "s": _unit(s=1),
    "A": _unit(A=1),
    "K": _unit(K=1),
    "mol": _unit(mol=1),
    "cd": _unit(cd=1),
    "rad": _unit(rad=1),
    "Hz": _unit(s=-1),
    "N": _unit(kg=1, m=1, s=-2),
    "Pa": _unit(kg=1, m=-1, s=-2),
    "J": _unit(kg=1, m=2, s=-2),
    "W": _unit(kg=1, m=2, s=-3),
    "C": _unit(A=1, s=1),
    "V": _unit(kg=1, m=2, s=-3, A=-1),
    "Ohm": _unit(kg=1, m=2, s=-3, A=-2),
}
_PLAIN = {
    "%": _unit(0.01),
    "deg": _unit(math.pi / 180, rad=1),
    "gon": _unit(math.pi / 200, rad=1),
    "rev": _unit(2 * math.pi, rad=1),
    "min": _unit(60.0, s=1),
    "h": _unit(3600.0, s=1),
    "d": _unit(86400.0, s=1),
    "t": _unit(1000.0, kg=1),
}
_PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "d": 1e-1, "h": 1e2, "k": 1e3, "M": 1e6, "G": 1e9}
_WORDS = {"Grad": "deg"}  # words of other languages that would read as a prefix and a symbol, here as a billion radians
_FORCES = {_PREFIXED["N"].exponents: "N", _PREFIXED["J"].exponents: "N.m"}
_LONGEST_GUESSED = 100
"""Characters; no unit is as long, and a guess takes the square of them."""
_FACTOR = re.compile(r"([A-Za-z%]+)([+-]?[1-9])?")


def parse(text: str) -> Unit:
    """Return the unit that an expression such as ``N.m.s/rad`` stands for.

    Raises
    ------
    UnitError
        The text is not a unit expression, or a symbol in it is not known. The error may propose one.
    """
    try:
        return _parsed(text)
    except UnitError:
        if meant := guess(text):
            raise UnitError(f"unit {text!r}: write {meant!r}") from None
        raise


def guess(text: str) -> str:
    """Return the unit expression that a wrong text probably means; empty if none comes to mind."""
    if len(text) > _LONGEST_GUESSED:
        return ""
    meant = respelled(text)
    return meant if is_unit(meant) else ""


def is_unit(text: str) -> bool:
    """Return whether a text is a unit expression."""
    try:
        _parsed(text)
    except UnitError:
        return False
    return True


@lru_cache(maxsize=256)  # a scenario writes the same few again and again
def _parsed(text: str) -> Unit:
    numerator, slash, denominator = text.partition("/")
    if slash and denominator.startswith("(") and denominator.endswith(")"):
        denominator = denominator[1:-1]
    elif "." in denominator:
        raise UnitError(f"unit {text!r}: write a denominator of several factors in parentheses, as in 'kg/(m.s2)'")
    unit = Unit() if numerator == "1" else _product(numerator, text)
    if slash:
        unit = _checked(unit / _product(denominator, text), text)
    return unit


def _product(factors: str, text: str) -> Unit:
    product = Unit()
    for factor in factors.split("."):
        match = _FACTOR.fullmatch(factor)
        if match is None:
            raise UnitError(
                f"unit {text!r}: {factor!r} is not a symbol with an exponent; write units as 'N.m/rad' or 'm/s2'"
            )
        symbol, exponent = match.groups()
        product *= _symbol(symbol, text) ** int(exponent or 1)
    return _checked(product, text)


def _checked(unit: Unit, text: str) -> Unit:
    if not 0.0 < unit.factor < math.inf:
        raise UnitError(f"unit {text!r}: its factor to the base units is not a number that can be computed with")
    return unit


def _symbol(symbol: str, text: str) -> Unit:
    if symbol in _WORDS:
        raise UnitError(f"unit {text!r}: {symbol!r} is not known: write {_WORDS[symbol]!r}")
    unit = _PLAIN.get(symbol) or _PREFIXED.get(symbol)
    if unit is None and symbol[0] in _PREFIXES and symbol[1:] in _PREFIXED:
        unit = Unit(factor=_PREFIXES[symbol[0]]) * _PREFIXED[symbol[1:]]
    if unit is None:
        known = ", ".join([*_PREFIXED, "1", *_PLAIN])
        raise UnitError(
            f"unit {text!r}: {symbol!r} is not known; known are {known}, the first {len(_PREFIXED)} with prefix"
        )
    return unit


def per_second(text: str) -> str:
    """Return the unit expression of the time derivative of a quantity in a given unit."""
    numerator, _, denominator = text.partition("/")
    if not denominator:
        return f"{numerator}/s"
    return f"{numerator}/s2" if denominator == "s" else f"{numerator}/({denominator.strip('()')}.s)"


@overload
def convert(value: float, source: str, target: str) -> float: ...


@overload
def convert(value: "npt.NDArray[np.float64]", source: str, target: str) -> "npt.NDArray[np.float64]": ...


def convert(value: "float | npt.NDArray[np.float64]", source: str, target: str) -> "float | npt.NDArray[np.float64]":
    """Convert a number or an array from one unit to another.

    Parameters
    ----------
    value
        A number or an array of any shape, in the unit `source`.
    source, target
        Unit expressions.

    Returns
    -------
    float or array
        The value in the unit `target`; unchanged, bit for bit, if both have the same factor.

    Raises
    ------
    UnitError
        One of the units is not known, or they measure different quantities.
    """
    a, b = parse(source), parse(target)
    if a.exponents != b.exponents:
        raise UnitError(f"cannot convert {source!r} to {target!r}: {a} is not {b} in base units")
    if a.factor == b.factor:
        return value
    return value * (a.factor / b.factor)
