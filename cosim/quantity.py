"""Numbers with units, as scenario files and tables write them."""

from __future__ import annotations

import math
import re
import unicodedata

from plants import UnitError, units

_QUANTITY = re.compile(r"((?>[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?))(?!,) ?(.*)")
_DECIMAL_COMMA = re.compile(r"([+-]?[0-9]+),([0-9]+)(?![0-9.,])")
_THOUSANDS = re.compile(r"[+-]?[0-9]{1,3}(?:[ '’_][0-9]{3})+(?![0-9])")
_OTHER_MINUS = re.compile("[−–—‒‐‑]")


def split(text: str) -> tuple[float, str]:
    """Return the number of a quantity and its unit as it is written, "1" if there is none.

    Raises
    ------
    ValueError
        The text is no quantity.
    """
    match = _QUANTITY.fullmatch(text.strip())
    if not match:
        raise ValueError(f"{text!r} is not a number with a unit{advice(text)}")
    return float(match[1]), match[2] or "1"


def spelled(number: float, unit: str = "1") -> str:
    """Return a quantity as a scenario holds it: with the fewest digits that give the same number again."""
    text = repr(float(number)).removesuffix(".0")
    return text if unit == "1" else f"{text} {unit}"


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
        example = f", such as '1 {unit}'"
        raise ValueError(f"{text!r} is not a number with a unit{advice(text) or example}")
    number, name = match.groups()
    try:
        given = units.parse(name or "1")
    except UnitError as error:
        advised = advice(text)
        raise ValueError(f"{text!r} is not a number with a unit{advised}" if advised else str(error)) from None
    if given.exponents != wanted.exponents:
        problem = f"{given} does not fit" if name else "the unit is missing"
        raise ValueError(f"{text!r}: {problem}; expected a quantity such as '{number} {unit}'")
    value = float(number) * given.factor / wanted.factor if given.factor != wanted.factor else float(number)
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not a finite number")
    return value


def meant(text: str) -> str:
    """Return the quantity that a faulty text probably means; empty if there is no likely one."""
    plain = _OTHER_MINUS.sub("-", unicodedata.normalize("NFKC", text.strip()))
    comma = _DECIMAL_COMMA.match(plain)
    if comma and len(comma[2]) != 3:  # three digits may be thousands
        plain = f"{comma[1]}.{comma[2]}{plain[comma.end() :]}"
    if thousands := _THOUSANDS.match(plain):
        plain = re.sub(r"[^0-9+-]", "", thousands[0]) + plain[thousands.end() :]
    match = _QUANTITY.fullmatch(plain)
    if not match:
        return ""
    number, name = match.groups()
    if not name:
        return number
    unit = name.strip() if units.is_unit(name.strip()) else units.guess(name)
    return f"{number} {unit}" if unit else ""


def advice(text: str) -> str:
    """Return the right spelling of a text that is no quantity, as the end of a sentence; empty if unclear."""
    better = meant(text)
    reason = ""
    if "," in text:
        reason = "decimals follow a point" + ("" if better else ", and nothing separates thousands")
    elif _OTHER_MINUS.search(text):
        reason = "a minus sign is a hyphen"
    if better in ("", text):
        return f": {reason}" if reason else ""
    return f": write {better!r}" + (f" ({reason})" if reason else "")


def whole_steps(steps: float, step: float, least: int) -> str:
    """Return the times next to a number of steps of a length [s] that are whole numbers of steps, at least some."""
    lower = max(math.floor(steps), least)
    return " or ".join(dict.fromkeys(f"{number * step:.12g} s" for number in (lower, lower + 1)))
