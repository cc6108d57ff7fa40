"""Values of an FMU's variables that are no real numbers: true or false, whole numbers, items and texts."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.clock import ROUNDING
from cosim.errors import InputError, nearest
from cosim.fmu.model_description import Variable
from cosim.plant.exchange import whole_range
from cosim.plant.spec import WHOLE
from cosim.scenario.csv_table import Table
from cosim.scenario.grammar import children_of
from cosim.scenario.scenario import InputSource
from cosim.signals.waves import WAVES, Wave, understood
from plants import units

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


# Inputs over time -------------------------------------------------------------------------------------------


def input_course(source: InputSource, variable: Variable, times: NDArray[np.float64]) -> dict[int, Discrete]:
    """Return the value of an input at the first tick, and at each tick at which it changes.

    Whole numbers of signals that act at the same time add up, as real numbers do. Of others the signal that is written
    last counts; where none acts, the FMU's start value.

    Parameters
    ----------
    source
        The input and its signals.
    variable
        The FMU's variable.
    times
        The communication points (T,) [s].

    Raises
    ------
    InputError
        A signal makes no sense for the type of the input, or a value does not fit.
    """
    courses = [_course(understood(wave), source, variable, times) for wave in source.waves]
    index = np.stack([which for _, which in courses])
    ticks = [0, *(np.flatnonzero((index[:, 1:] != index[:, :-1]).any(axis=0)) + 1).tolist()]
    course: dict[int, Discrete] = {}
    before: Discrete | None = None
    for tick in ticks:
        acting_now = [values[k] for (values, _), k in zip(courses, index[:, tick], strict=True) if k >= 0]
        try:
            value = _together(variable, acting_now)
            if value == before:
                continue
            check_whole(variable, value, str(value))
        except ValueError as error:
            raise InputError(f"the input {source.name!r} at {times[tick]:g} s: {error}", source.where) from None
        course[tick] = before = value
    return course


def _together(variable: Variable, acting_now: Sequence[Discrete]) -> Discrete:
    if variable.type in WHOLE:
        return sum(int(value) for value in acting_now)
    return acting_now[-1] if acting_now else start_of_discrete(variable)


def _course(
    wave: Wave, source: InputSource, variable: Variable, times: NDArray[np.float64]
) -> tuple[list[Discrete], NDArray[np.int64]]:
    """Return the values of a signal, and the index of its value at each tick; -1 where it does not act."""
    if variable.type != "String" and (tabled := wave.table()) is not None:
        return _tabled(*tabled, wave, variable, times)
    if not wave.keeps_a_value:
        usable = ", ".join(f"<{name}>" for name in children_of("input") if WAVES[name].keeps_a_value)
        raise wave.written.error(
            f"the input {source.name!r} is {_kind(variable)} and takes no <{wave.element}>; it takes {usable}"
            f"{' and <table>' if variable.type != 'String' else ''}"
        )
    try:
        value = discrete_value(variable, wave.value)
    except ValueError as error:
        raise wave.written.error(f'value="{wave.value}" of <{wave.element}>: {error}') from None
    return [value], np.where(wave.acting(times), 0, -1)


def _tabled(
    table: Table, column: str, wave: Wave, variable: Variable, times: NDArray[np.float64]
) -> tuple[list[Discrete], NDArray[np.int64]]:
    """Return the rows of a table; each holds from its time on, the first one before its time too."""
    where = wave.written.where
    known = (
        items(variable) if variable.type == "Enumeration" else {0: "", 1: ""} if variable.type == "Boolean" else None
    )
    values: list[Discrete] = []
    for time, number in zip(table.time, table.column(column, units.parse("1"), where), strict=True):
        if number != round(number) or (known is not None and int(number) not in known):
            wanted = "a whole number" if known is None else f"one of {', '.join(map(str, known))}"
            raise InputError(
                f"the column {column!r} of {table.path} has {number:g} at {time:g} s; expected {wanted}", where
            )
        values.append(bool(number) if variable.type == "Boolean" else int(number))
    which = np.searchsorted(table.time, times * (1 + 1e-12) + ROUNDING, side="right") - 1
    return values, np.maximum(which, 0)


def _kind(variable: Variable) -> str:
    """Return the kind of value of a variable, in words."""
    if variable.type in WHOLE:
        return "a whole number"
    return {"Boolean": "true or false", "Enumeration": "an item of an enumeration"}.get(variable.type, "a text")
