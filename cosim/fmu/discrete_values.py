"""Values of an FMU's variables that are no real numbers: true or false, whole numbers, items and texts."""

from __future__ import annotations

import re
from typing import TypeAlias

from cosim.errors import nearest
from cosim.fmu.model_description import Variable
from cosim.plant.exchange import whole_range
from cosim.plant.spec import WHOLE

DISCRETE = (*WHOLE, "Boolean", "Enumeration", "String")
"""Types of variables that change at communication points only."""
Discrete: TypeAlias = int | bool | str
"""A value of such a variable; of an enumeration, the number of the item."""

_SWITCHES = {"true": True, "false": False, "1": True, "0": False}


def items(variable: Variable) -> dict[int, str]:
    """Return the items of an enumeration by their values."""
    declared = getattr(variable.declaredType, "items", None) or ()
    return {int(item.value): str(item.name) for item in declared}


def discrete_value(variable: Variable, text: str) -> Discrete:
    """Return the value that a text is for a variable; bounds are not looked at.

    Raises
    ------
    ValueError
        The text is no value of the variable's type.
    """
    if variable.type in WHOLE:
        if not re.fullmatch(r"[+-]?[0-9]{1,20}", text):
            raise ValueError(f"{text!r} is not a whole number")
        return int(text)
    if variable.type == "Enumeration":
        values = {name: value for value, name in items(variable).items()}
        if text not in values:
            raise ValueError(f"{text!r} is none of its items: {nearest(text, list(values))}")
        return values[text]
    if variable.type == "Boolean":
        if text not in _SWITCHES:
            raise ValueError(f"{text!r} is neither true nor false")
        return _SWITCHES[text]
    return text


def check_whole(variable: Variable, value: Discrete, text: str) -> None:
    """Refuse a whole number that its type or the FMU does not allow.

    Raises
    ------
    ValueError
        It is out of bounds; the text is how the scenario writes it.
    """
    kind = variable.type
    if kind not in WHOLE:
        return
    least, most = whole_range(kind)
    if not least <= int(value) <= most:
        raise ValueError(f"{text} is out of bounds; a {kind} is from {least} to {most}")
    check_bounds(variable, int(value), text)


def check_bounds(variable: Variable, value: float, text: str) -> None:
    """Refuse a number beyond the FMU's bounds.

    Raises
    ------
    ValueError
        It is out of bounds; the text is how the scenario writes it.
    """
    for name, word, sign in (("min", "at least", 1), ("max", "at most", -1)):
        bound = getattr(variable, name) or getattr(variable.declaredType, name, None)
        if bound is not None and sign * value < sign * float(bound):
            raise ValueError(f"{text} is out of bounds; it must be {word} {bound} {variable.unit or ''}".rstrip())


def start_of_discrete(variable: Variable) -> Discrete:
    """Return the start value of a variable; false, the first item or an empty text where the FMU states none.

    Whole numbers have none here: their signals add up from zero.

    Raises
    ------
    ValueError
        The FMU's start value is no value of the enumeration; the FMU is the subject of the text.
    """
    text = variable.start if isinstance(variable.start, str) else ""
    if variable.type == "Enumeration":
        try:
            return int(text) if text else min(items(variable), default=1)
        except ValueError:
            raise ValueError(f"has the start value {text[:40]!r} of {variable.name!r}, which is no number") from None
    return _SWITCHES.get(text, False) if variable.type == "Boolean" else text
