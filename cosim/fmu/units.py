"""The unit of an FMU's variable: as the FMU defines it, by its name, or as a binding states it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache

from cosim.errors import Picklable
from cosim.fmu.model_description import BaseUnit, ModelDescription, Variable
from cosim.quantity import split
from plants import UnitError, units

_ROUNDED = 5e-4
"""Relative difference of two factors that are the same number, one of them rounded to four digits or more."""
_EXACT = 1e-9
"""Relative difference of two factors that are the same to all digits that anybody writes."""
_ANGLE = units.BASE_UNITS.index("rad")


class UndecidedUnit(Picklable, UnitError):
    """What an FMU says of a variable's unit leaves a choice, which a binding makes.

    Attributes
    ----------
    unit : plants.units.Unit
        The unit as it probably is, without an offset.
    question, choice : str
        What is to be decided, and the attributes of a binding that decide it.
    """

    unit: units.Unit
    question: str
    choice: str


class UnitContradiction(UndecidedUnit):
    """A unit's name contradicts its definition in the FMU.

    Parameters
    ----------
    variable
        The name of the variable that has the unit.
    name
        That of the unit.
    by_name, by_definition
        The unit by each.
    """

    def __init__(self, variable: str, name: str, by_name: units.Unit, by_definition: units.Unit) -> None:
        contradiction = (
            f"{name!r}, whose name contradicts its definition: by the name, 1 {name} is {by_name.factor:.6g} "
            f"{by_name}, by the definition {by_definition.factor:.6g} {by_name}"
        )
        self.unit = by_name
        self.question = f"{variable!r} is in {contradiction}"
        self.choice = f'unit="{name}" or {_with_factor(by_name, by_definition)}'
        super().__init__(f"has {variable!r} in {contradiction}. A binding decides: {self.choice}")


class UnitWithOffset(UndecidedUnit):
    """A unit counts from elsewhere than its base unit, as degC does.

    Parameters
    ----------
    variable
        The name of the variable that has the unit.
    name
        That of the unit.
    unit
        The unit without its offset.
    offset
        The offset, in base units.
    """

    def __init__(self, variable: str, name: str, unit: units.Unit, offset: float) -> None:
        self.unit, counted = unit, units.Unit(unit.exponents)
        is_known = units.is_unit(name) and units.parse(name) == unit
        stated = f'unit="{name}"' if is_known else _with_factor(counted, unit)
        of = f"an offset of {offset:.6g} {counted}"
        self.question = f"{variable!r} is in {name}, with {of}"
        self.choice = f'{stated} offset="{offset!r} {counted}"'
        super().__init__(f"has {variable!r} in {name}, with {of}: a binding states both, {self.choice}")


def _with_factor(base: units.Unit, unit: units.Unit) -> str:
    """Return the attributes of a binding that state a unit by that of its base units and a factor."""
    return f'unit="{base}"' + ("" if unit.factor == 1 else f' factor="{unit.factor!r}"')


def unit_name(variable: Variable) -> str:
    """Return the name of the unit that a variable has, of its own or by its type; empty if it has none."""
    return str(variable.unit or getattr(variable.declaredType, "unit", None) or "")


def unit_of(description: ModelDescription, variable: Variable) -> units.Unit:
    """Return the unit of a variable: as the FMU defines it, or by its name where it is not defined.

    A factor that is rounded in the definition counts as the exact one of the name.

    Raises
    ------
    UnitContradiction
        The unit has the name of a known unit of the same quantity, but another factor.
    UnitWithOffset
        It has an offset.
    plants.UnitError
        The variable has no unit, or an unknown one.
    """
    name = unit_name(variable)
    if not name:
        raise UnitError(f'has {variable.name!r} without a unit: a binding states it, unit="..."')
    for definition in description.unitDefinitions:
        if definition.name == name and definition.baseUnit is not None:
            return _defined(variable.name, name, definition.baseUnit)
    try:
        return units.parse(name)
    except UnitError:
        raise UnitError(
            f"has {variable.name!r} in {name!r}, which it does not define: a binding states the unit, "
            f'unit="{units.guess(name) or "..."}"'
        ) from None


def unit_of_values(description: ModelDescription, variable: Variable, values: Iterable[str]) -> units.Unit:
    """Return the unit in which a scenario gives values to a variable; a pure number if the variable has no unit.

    Where the unit contradicts itself or has an offset, bare numbers are taken as the FMU counts.

    Raises
    ------
    plants.UnitError
        The unit is not known, or contradicts itself or has an offset while the values have units.
    """
    try:
        return unit_of(description, variable) if unit_name(variable) else units.parse("1")
    except UndecidedUnit as error:
        if all(split(value)[1] == "1" for value in values):
            return units.parse("1")
        raise UnitError(f"{error.question}: give the bare number, as the FMU counts") from None


def _defined(variable: str, name: str, base: BaseUnit) -> units.Unit:
    """Return the unit that has a definition; "rad" and "deg" are angles, even if they are defined as numbers."""
    if not 0.0 < base.factor < math.inf or not math.isfinite(base.offset):
        raise UnitError(
            f"has {variable!r} in {name}, with a factor that is not positive or an offset that is no number"
        )
    unit = own = _by_definition(base)
    if units.is_unit(name) and _measures(own, named := units.parse(name)):
        if not math.isclose(own.factor, named.factor, rel_tol=_ROUNDED):
            raise UnitContradiction(variable, name, named, own)
        unit = named
    if base.offset != 0:
        raise UnitWithOffset(variable, name, unit, base.offset)
    return unit  # else the name is the FMU's own, such as "g" for an acceleration


@lru_cache(maxsize=1000)
def _by_definition(base: BaseUnit) -> units.Unit:
    return units.Unit(tuple(getattr(base, symbol) for symbol in units.BASE_UNITS), base.factor)


def stated(description: ModelDescription, variable: Variable, text: str, has_offset: bool) -> units.Unit:
    """Return the unit of a variable for which a binding states one, with or without an offset.

    The binding decides where the FMU states no unit, an unknown one, or one that contradicts itself; of one with an
    offset, where it states an offset, too.

    Raises
    ------
    plants.UnitError
        The FMU clearly states another unit, or one with an offset while the binding states none.
    """
    unit = units.parse(text)
    try:
        own = unit_of(description, variable)
    except UnitError as error:
        if isinstance(error, UnitWithOffset) and not has_offset:
            raise
        return unit
    if not _measures(own, unit) or not math.isclose(own.factor, unit.factor, rel_tol=_ROUNDED):
        raise UnitError(f"has {variable.name!r} in {unit_name(variable)}, not in {text} as the binding states")
    exact = math.isclose(own.factor, unit.factor, rel_tol=_EXACT)
    return units.Unit(unit.exponents, own.factor) if exact else unit


def _measures(own: units.Unit, other: units.Unit) -> bool:
    """Return whether two units measure the same quantity; angles may be pure numbers."""
    exponents = other.exponents
    if own.exponents[_ANGLE] == 0:
        exponents = (*exponents[:_ANGLE], 0, *exponents[_ANGLE + 1 :])
    return own.exponents == exponents
