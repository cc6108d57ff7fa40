"""Numbers with units, as scenario files and tables write them."""

from __future__ import annotations

import math
import re

from plants import UnitError, units

_QUANTITY = re.compile(r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?) ?(.*)")


def split(text: str) -> tuple[float, str]:
    """Return the number of a quantity and its unit as it is written, "1" if there is none.

    Raises
    ------
    ValueError
        The text is no quantity.
    """
    match = _QUANTITY.fullmatch(text.strip())
    if not match:
        raise ValueError(f"{text!r} is not a number with a unit")
    return float(match[1]), match[2] or "1"


def quantity(text: str, unit: str | units.Unit) -> float:
    """Return the value of a text such as ``"45 deg"`` in the given unit.

    A bare number is taken only where the unit is a pure number.

    Raises
    ------
    ValueError
        The text is no quantity, its unit does not fit, or the number is not finite.
    """
    wanted = units.parse(unit) if isinstance(unit, str) else unit
    match = _QUANTITY.fullmatch(text.strip())
    if not match:
        raise ValueError(f"{text!r} is not a number with a unit, such as '1 {unit}'")
    number, name = match.groups()
    try:
        given = units.parse(name or "1")
    except UnitError as error:
        raise ValueError(str(error)) from None
    if given.exponents != wanted.exponents:
        problem = f"{given} does not fit" if name else "the unit is missing"
        raise ValueError(f"{text!r}: {problem}; expected is a quantity such as '{number} {unit}'")
    value = float(number) * given.factor / wanted.factor if given.factor != wanted.factor else float(number)
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not a finite number")
    return value
