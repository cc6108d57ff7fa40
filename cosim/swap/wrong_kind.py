"""Whether an FMU is clearly no vehicle of a kind: by positive evidence, never by names without meaning."""

from __future__ import annotations

from collections.abc import Collection

from cosim.fmu.model_description import ModelDescription
from cosim.fmu.units import unit_name, unit_of
from cosim.swap.candidates import Number, Numbers
from cosim.swap.naming import words_of
from cosim.vehicle.evidence import Evidence
from cosim.vehicle.kind import Kind
from plants import UnitError, units

_NO_DRIVE = frozenset(
    ("d", "dist", "disturbance", "wind", "load", "friction", "resistance", "slip", "brake", "braking", "light")
)
"""Words of inputs that neither drive nor steer."""


def no_vehicle(kind: Kind, description: ModelDescription, numbers: Numbers) -> str:
    """Return why an FMU is no vehicle of a kind: it lacks inputs that could be commands; empty if it may be one."""
    fitting = [units.parse(unit).exponents for unit in _command_units(kind)]
    found = [repr(number.name) for number in numbers.of("input") if _may_command(description, number, fitting)]
    needed = len(kind.command)
    if len(found) >= needed:
        return ""
    known = ", ".join(unit for unit in _command_units(kind) if unit != "1")
    return (
        f"it has {f'only {found[0]}' if found else 'no input'} that could be a {kind.command_word}, in {known}, a pure "
        f"number or without a unit; {_NUMBERS.get(needed, needed)} {'are' if needed > 1 else 'is'} needed"
    )


_NUMBERS = {1: "one", 2: "two", 3: "three", 4: "four"}


def other_kind(kind: Kind, numbers: Numbers, missing: Collection[str], said: str) -> str:
    """Return why an FMU is clearly another kind of vehicle than a given one; empty if it is not.

    Parameters
    ----------
    kind
        The kind of vehicle.
    numbers
        The FMU's numbers.
    missing
        The roles for which there is nothing.
    said
        The FMU's name and description.
    """
    inputs = {number.name: tuple(number.words) for number in numbers.of("input") if not _NO_DRIVE & set(number.words)}
    return kind.recognised.refusal(Evidence(inputs, words_of(said), missing, lambda words: bool(numbers.having(words))))


def _command_units(kind: Kind) -> tuple[str, ...]:
    """Return the units that an input may have which is a command: a torque may also be given as a force."""
    own = dict.fromkeys(role.unit for role in kind.command)
    return (*own, *(("N",) if "N.m" in own else ()), "1")


def _may_command(description: ModelDescription, number: Number, fitting: Collection[tuple[int, ...]]) -> bool:
    """Return whether a number has one of some units, or none that is known."""
    if not unit_name(number.variable):
        return not number.hint or units.parse(number.hint).exponents in fitting
    try:
        return unit_of(description, number.variable).exponents in fitting
    except UnitError:
        return True
