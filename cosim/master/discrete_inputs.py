"""Inputs over time that are no real numbers: they change at communication points, and hold between."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.clock import ROUNDING, Clock
from cosim.errors import InputError
from cosim.fmu.discrete_values import Discrete, check_whole, discrete_value, items, start_of_discrete
from cosim.fmu.model_description import Variable
from cosim.plant.spec import WHOLE
from cosim.scenario.csv_table import Table
from cosim.scenario.grammar import children_of
from cosim.scenario.scenario import InputSource
from cosim.signals.waves import WAVES, Wave, understood
from cosim.storage import blocks
from plants import units

_Which: TypeAlias = Callable[[NDArray[np.float64]], NDArray[np.int64]]
"""Returns the index of a value at each of some times."""


MAX_SAMPLES = 1_000_000_000
"""Signals of an input times communication points: some ten seconds."""
MAX_CHANGES = 2_000_000
"""Changes of an input, times the robots: some hundred megabytes."""


def input_course(source: InputSource, variable: Variable, clock: Clock, most: int = MAX_CHANGES) -> dict[int, Discrete]:
    """Return the value of an input at the first tick, and at each tick at which it changes.

    Whole numbers of signals that act at the same time add up, as real numbers do. Of others the signal that is written
    last counts; where none acts, the FMU's start value.

    Parameters
    ----------
    source
        The input and its signals.
    variable
        The FMU's variable.
    clock
        The communication points.
    most
        How many changes there may be.

    Raises
    ------
    InputError
        A signal makes no sense for the type of the input, a value does not fit, or there are too many.
    """
    signals, samples = len(source.waves), clock.ticks + 1
    if signals * samples > MAX_SAMPLES:
        raise InputError(
            f"the input {source.name!r} has {signals} signals at {samples} communication points; at most "
            f"{MAX_SAMPLES:.0e} values are computed for an input that is no real number: write them as one <table>, or "
            "shorten the run",
            source.where,
        )
    courses = [_course(understood(wave), source, variable) for wave in source.waves]
    last = np.full((signals, 1), -2)  # unlike all
    course: dict[int, Discrete] = {}
    before: Discrete | None = None
    for block in blocks(samples, signals):
        times = clock.times_in(block)
        index = np.stack([which(times) for _, which in courses])
        changing = np.flatnonzero((index != np.hstack([last, index[:, :-1]])).any(axis=0))
        last = index[:, -1:].copy()
        for k in changing.tolist():
            tick = block.start + k
            acting_now = [values[i] for (values, _), i in zip(courses, index[:, k].tolist(), strict=True) if i >= 0]
            try:
                value = _together(variable, acting_now)
                if value == before:
                    continue
                check_whole(variable, value, str(value))
            except ValueError as error:
                raise InputError(
                    f"the input {source.name!r} at {tick * clock.step:.12g} s: {error}", source.where
                ) from None
            course[tick] = before = value
        if len(course) > most:
            raise InputError(
                f"the input {source.name!r} has changed more than {most} times at {times[-1]:.12g} s; at most "
                f"{MAX_CHANGES:.0e} changes of inputs that are no real numbers are possible, of all robots together",
                source.where,
            )
    return course


def _together(variable: Variable, acting_now: Sequence[Discrete]) -> Discrete:
    if variable.type in WHOLE:
        return sum(int(value) for value in acting_now)
    return acting_now[-1] if acting_now else start_of_discrete(variable)


def _course(wave: Wave, source: InputSource, variable: Variable) -> tuple[list[Discrete], _Which]:
    """Return the values of a signal, and the index of its value at each time; -1 where it does not act."""
    if variable.type != "String" and (tabled := wave.table()) is not None:
        return _tabled(*tabled, wave, variable)
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
    return [value], lambda times: np.where(wave.acting(times), 0, -1)


def _tabled(table: Table, column: str, wave: Wave, variable: Variable) -> tuple[list[Discrete], _Which]:
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
                f"the column {column!r} of {table.path} has {number:g} at {time:.12g} s; expected {wanted}", where
            )
        values.append(bool(number) if variable.type == "Boolean" else int(number))

    def which(times: NDArray[np.float64]) -> NDArray[np.int64]:
        return np.maximum(np.searchsorted(table.time, times * (1 + 1e-12) + ROUNDING, side="right") - 1, 0)

    return values, which


def _kind(variable: Variable) -> str:
    """Return the kind of value of a variable, in words."""
    if variable.type in WHOLE:
        return "a whole number"
    return {"Boolean": "true or false", "Enumeration": "an item of an enumeration"}.get(variable.type, "a text")
