"""Values of an SSP as a plant has them: numbers in the unit of the FMU, and the text that a scenario states."""

from __future__ import annotations

from cosim.errors import InputError
from cosim.fmu.discrete_values import items
from cosim.fmu.model_description import ModelDescription, Variable
from cosim.fmu.units import unit_name, unit_of
from cosim.plant.spec import FLOAT_TYPES
from cosim.ssp.structure import PURE_NUMBER, Parameter, Units
from plants import UnitError, units


def number_of(
    parameter: Parameter, variable: Variable, description: ModelDescription, known: Units, bound: units.Unit | None
) -> float:
    """Return the value of a parameter as a number in the unit that its variable has.

    Parameters
    ----------
    parameter, known
        The parameter, and the units of the SSP.
    variable, description
        The variable, and the description of its FMU.
    bound
        The unit that the variable has by a binding; None if it plays no role.

    Raises
    ------
    InputError
        It is no number, or has a unit while that of the variable is not known or of another quantity.
    """
    name = unit_name(variable)
    try:
        own = bound or unit_of(description, variable)
    except UnitError as error:
        if parameter.unit in ("", name) or (not name and known[parameter.unit] == PURE_NUMBER):
            return parameter.number
        said = f"<Parameter>: {parameter.name!r} is in {parameter.unit!r}, and the unit that the FMU has is not known"
        raise InputError(f"{said}: {error}", parameter.where) from None
    return parameter.in_unit(name or str(own), own.exponents, own.factor, known)


def with_unit(number: float, variable: Variable, description: ModelDescription) -> str:
    """Return a number in the unit that a variable has as a scenario states it; bare if the unit is not known."""
    try:
        unit = unit_of(description, variable)
    except UnitError:
        return repr(number)
    name = unit_name(variable)
    if not units.is_unit(name) or units.parse(name) != unit:  # it is the FMU's own
        number, name = number * unit.factor, str(unit)
    return f"{number!r} {name}" if name != "1" else repr(number)


def written(
    parameter: Parameter,
    variable: Variable,
    description: ModelDescription,
    known: Units,
    bound: units.Unit | None = None,
) -> str:
    """Return the value of a parameter as a scenario states it for a variable: in the FMU's unit, or an item's name.

    Raises
    ------
    InputError
        As `number_of`; or it is no item of the enumeration, or has a unit where there is none.
    """
    if variable.type in FLOAT_TYPES:
        return with_unit(number_of(parameter, variable, description, known, bound), variable, description)
    if parameter.unit and known[parameter.unit] != PURE_NUMBER:
        raise InputError(
            f"<Parameter>: {parameter.name!r} is in {parameter.unit!r}, and the FMU has it as {variable.type}, which "
            "has no unit",
            parameter.where,
        )
    return _item(parameter, variable) if variable.type == "Enumeration" else parameter.text


def _item(parameter: Parameter, variable: Variable) -> str:
    """Return the name of an item; other tools state its number, as Formation does."""
    known = items(variable)
    if parameter.type == "Integer" and isinstance(parameter.value, int) and parameter.value in known:
        return known[parameter.value]
    if parameter.text not in known.values():
        named = ", ".join(f"{name} ({number})" for number, name in known.items())
        raise InputError(
            f"<Parameter>: {parameter.name!r} is {parameter.text!r}, which is none of its items: {named}",
            parameter.where,
        )
    return parameter.text
