"""What a scenario says of a plant's parameters, understood by what the FMU says of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from cosim.contract import unit_of
from cosim.errors import InputError, Location, nearest
from cosim.fmu import Fmu
from cosim.quantity import quantity
from cosim.scenario import Setting
from plants import UnitError


@dataclass(frozen=True)
class ParameterValue:
    """A parameter of an FMU and the value that it gets, in the FMU's own unit."""

    variable: Any
    value: float | int | bool | str
    where: Location


def understand(fmu: Fmu, settings: Iterable[Setting]) -> tuple[ParameterValue, ...]:
    """Return the values of the parameters that a scenario sets.

    Raises
    ------
    InputError
        The FMU has no such parameter, or the value does not fit: unit, bounds, item of an enumeration.
    """
    parameters = {v.name: v for v in fmu.description.modelVariables if v.causality == "parameter"}
    values = []
    for setting in settings:
        if setting.name not in parameters:
            known = nearest(setting.name, list(parameters))
            raise InputError(f"the FMU {fmu.path.name} has no parameter {setting.name!r}: {known}", setting.where)
        variable = parameters[setting.name]
        try:
            value = _value(fmu, variable, setting.value)
        except (ValueError, UnitError) as error:
            raise InputError(f"parameter {setting.name} of {fmu.path.name}: {error}", setting.where) from None
        values.append(ParameterValue(variable, value, setting.where))
    return tuple(values)


def geometry(fmu: Fmu, parameters: Iterable[ParameterValue], where: Location) -> dict[str, Any]:
    """Return the fields of the controllers' vehicle description, as the parameters of an FMU are set.

    Raises
    ------
    InputError
        A parameter of the geometry is neither set nor has a start value.
    """
    values = {parameter.variable.name: parameter.value for parameter in parameters}
    found: dict[str, Any] = {}
    for field, role in fmu.binding.contract.geometry.items():
        bound = fmu.binding.bound[role.name]
        variable = bound.variable
        value = values.get(variable.name, variable.start)
        if value is None:
            raise InputError(f"the parameter {variable.name!r} of {fmu.path.name} has no value: set it", where)
        found[field] = items(variable).get(int(value)) if variable.type == "Enumeration" else float(value) * bound.scale
    return found


def items(variable: Any) -> dict[int, str]:
    """Return the items of an enumeration by their values."""
    return {int(item.value): str(item.name) for item in variable.declaredType.items}


def _value(fmu: Fmu, variable: Any, text: str) -> float | int | bool | str:
    if variable.type == "Real":
        has_unit = variable.unit or (variable.declaredType and variable.declaredType.unit)
        value = quantity(text, unit_of(fmu.description, variable) if has_unit else "1")
        _check_bounds(variable, value, text)
        return value
    if variable.type == "Integer":
        if not text.lstrip("+-").isdecimal() or len(text) > 10:
            raise ValueError(f"{text!r} is not a whole number")
        _check_bounds(variable, int(text), text)
        return int(text)
    if variable.type == "Enumeration":
        values = {name: value for value, name in items(variable).items()}
        if text not in values:
            raise ValueError(f"{text!r} is none of its items: {nearest(text, list(values))}")
        return values[text]
    if variable.type == "Boolean":
        if text not in ("true", "false"):
            raise ValueError(f"{text!r} is neither true nor false")
        return text == "true"
    return text


def _check_bounds(variable: Any, value: float, text: str) -> None:
    for name, word, sign in (("min", "at least", 1), ("max", "at most", -1)):
        bound = getattr(variable, name) or getattr(variable.declaredType, name, None)
        if bound is not None and sign * value < sign * float(bound):
            raise ValueError(f"{text} is out of bounds; it must be {word} {bound} {variable.unit or ''}".rstrip())
