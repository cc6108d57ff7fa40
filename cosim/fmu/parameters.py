"""A plant's parameters: values of the scenario, checked against the FMU's description."""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

from cosim.errors import InputError, Location, nearest
from cosim.fmu.binding import BoundRole, BoundVariable, start_of
from cosim.fmu.discrete_values import DISCRETE, check_bounds, check_whole, discrete_value, items
from cosim.fmu.model_description import ModelDescription, Variable
from cosim.fmu.units import unit_of, unit_of_values
from cosim.fmu.vehicle import Fmu
from cosim.known import Known
from cosim.plant.spec import FLOAT_TYPES, Value
from cosim.quantity import quantity, split
from cosim.scenario.scenario import Setting
from cosim.vehicle.kind import Role
from plants import UnitError

_WHOLE_TOLERANCE = 1e-9
"""Relative tolerance within which a computed number counts as a whole one."""


@dataclass(frozen=True)
class ParameterValue:
    """A parameter or an input of an FMU and the value that it gets, in the FMU's own unit."""

    variable: Variable
    value: float | int | bool | str
    where: Location

    @property
    def is_input(self) -> bool:
        """Whether it is an input, set once for the whole run."""
        return bool(self.variable.causality == "input")

    @cached_property
    def as_value(self) -> Value:
        """The same as plants know it."""
        return Value(self.variable.name, self.variable.type, self.variable.valueReference, (self.value,))


def understand(
    fmu: Fmu, settings: Iterable[Setting], way_out: str = "", known: Known | None = None
) -> tuple[ParameterValue, ...]:
    """Return the values of the parameters that a scenario sets, by their names in the FMU or the roles that they play.

    An input that does not drive or disturb the vehicle may be set too, to a value that it keeps. A role that has a
    constant value in the binding may be set to this value, which then sets nothing.

    Parameters
    ----------
    fmu, settings
        The FMU, and the settings.
    way_out
        Remedy for a parameter that the FMU lacks, for the message.
    known
        Values of settings that are understood already.

    Raises
    ------
    InputError
        The FMU has no such parameter, or the value does not fit: unit, bounds, item of an enumeration, constant. Or it
        follows from the pose, or two settings are of the same parameter by two names.
    """
    known = known or Known()
    first: dict[tuple[str, int], tuple[str, ParameterValue]] = {}
    for one in settings:
        value = known.of((fmu.path, one.name), _understood, fmu, one, way_out)
        if value is None:
            continue
        name, before = first.setdefault(value.variable.identity, (one.name, value))
        if before is not value:
            raise InputError(
                f"{one.name!r} of {fmu.path.name} is {name!r} by another name, and {name!r} has a value "
                f"{before.where.seen_from(value.where)}: remove one",
                value.where,
            )
    return tuple(value for _, value in first.values())


def _understood(fmu: Fmu, setting: Setting, way_out: str) -> ParameterValue | None:
    """Return the value of one parameter; None for a role that has this value anyway."""
    parameters = fmu.settable
    variable = parameters.get(setting.name)
    bound = _geometry_role(fmu, setting.name)
    player = _player(bound)
    plays = variable is not None and player is not None and player.variable.identity == variable.identity
    if variable is not None and not (plays and needs_a_role(fmu.description, variable, setting.value)):
        _check_beside_constant(bound, setting)
        bound = player = None  # it is meant by its own name
    if variable is None and player is None and (bound is None or bound.played_by is not None):
        known = nearest(setting.name, list(parameters)) + (f". {way_out}" if way_out else "")
        raise InputError(f"the FMU {fmu.path.name} has no parameter {setting.name!r}: {known}", setting.where)
    if variable is not None:
        check_not_initial(fmu, variable, setting.where)
    try:
        if bound is not None and bound.played_by is None:
            check_constant(bound.role, bound.constant, setting.value)
            return None
        if player is not None:
            return ParameterValue(player.variable, _value_of_role(fmu, setting, player), setting.where)
        assert variable is not None  # refused above
        return ParameterValue(variable, value_of(fmu.description, variable, setting.value), setting.where)
    except (ValueError, UnitError) as error:
        raise InputError(f"parameter {setting.name} of {fmu.path.name}: {error}", setting.where) from None


def _check_beside_constant(bound: BoundRole | None, setting: Setting) -> None:
    """Refuse a quantity for a parameter of the FMU that has the name of a role of which the binding states another."""
    if bound is None or bound.played_by is not None or not bound.role.unit:
        return
    with suppress(ValueError, UnitError):  # of another dimension, it is something else
        if said := _contradiction(bound.role, bound.constant, setting.value):
            raise InputError(f"parameter {setting.name}: {said}", setting.where)


def check_not_initial(fmu: Fmu, variable: Variable, where: Location) -> None:
    """Refuse a value for a variable that gives the initial value of a pose entry.

    Raises
    ------
    InputError
        It is such a variable.
    """
    for bound in fmu.binding.of(fmu.binding.kind.pose):
        if bound is not None and bound.initial is not None and bound.initial.variable.identity == variable.identity:
            raise InputError(
                f"the {variable.causality} {variable.name!r} of {fmu.path.name} follows from the <pose>: by the "
                f"binding it gives the initial {bound.role.name!r}",
                where,
            )


def check_constant(role: Role, constant: float | str | None, text: str) -> None:
    """Refuse a value of a role that is not the constant one.

    Raises
    ------
    ValueError
        It is another one, or does not fit.
    """
    if said := _contradiction(role, constant, text):
        raise ValueError(said)


def _contradiction(role: Role, constant: float | str | None, text: str) -> str:
    """Say that a value of a role is not the constant one; nothing if it is. Raises ValueError if it does not fit."""
    same = (
        math.isclose(quantity(text, role.unit), float(constant or 0), rel_tol=1e-12) if role.unit else text == constant
    )
    stated = f"{constant:g} {role.unit}" if isinstance(constant, float) else constant
    return "" if same else f"{text!r} contradicts the binding, which states {stated}"


def _geometry_role(fmu: Fmu, name: str) -> BoundRole | None:
    """Return a role of the geometry with its player."""
    roles = {role.name for role in fmu.binding.kind.geometry.values()}
    return fmu.binding.bound.get(name) if name in roles else None


def needs_a_role(description: ModelDescription, variable: Variable, text: str) -> bool:
    """Return whether a value has a unit although the FMU's unit of the parameter is unknown or ambiguous.

    For a parameter that plays a role, the binding then states the unit.
    """
    try:
        unit_of(description, variable)
    except UnitError:
        with suppress(ValueError):
            return split(text)[1] != "1"
    return False


def _player(bound: BoundRole | None) -> BoundVariable | None:
    """Return the player of a role, if it is a parameter or an input of the FMU."""
    if bound is None or bound.played_by is None or bound.played_by.variable.causality not in ("parameter", "input"):
        return None
    return bound.played_by


def _value_of_role(fmu: Fmu, setting: Setting, player: BoundVariable) -> float | int | bool | str:
    """Return the number that a parameter gets for a value of the role that it plays."""
    role = fmu.binding.bound[setting.name].role
    if not role.unit:
        return value_of(fmu.description, player.variable, setting.value)
    if player.variable.dimensions:
        raise ValueError("it is an array, which a scenario cannot set")
    value = quantity(setting.value, role.unit)
    number = (value - player.offset) / player.scale
    if player.variable.type in FLOAT_TYPES:
        check_bounds(player.variable, number, setting.value)
        return number
    if abs(number - round(number)) > _WHOLE_TOLERANCE * max(1.0, abs(number)):
        raise ValueError(
            f"{setting.value} would set {player.variable.name!r} to {number:g}, but it takes whole numbers only"
        )
    check_whole(player.variable, round(number), setting.value)
    return round(number)


def geometry(fmu: Fmu, parameters: Iterable[ParameterValue], where: Location) -> dict[str, float | str | None]:
    """Return the fields of the controllers' vehicle description, as the parameters of an FMU are set.

    Raises
    ------
    InputError
        A parameter of the geometry is neither set nor has a start value.
    """
    values = {parameter.variable.identity: parameter.value for parameter in parameters}
    found: dict[str, float | str | None] = {}
    for field, role in fmu.binding.kind.geometry.items():
        bound = fmu.binding.bound[role.name]
        if bound.played_by is None:
            found[field] = bound.constant
            continue
        variable = bound.played_by.variable
        if variable.type == "Enumeration":
            value = values.get(variable.identity, variable.start)
            try:
                found[field] = None if value is None else items(variable).get(int(value))
            except ValueError:
                raise InputError(
                    f"the FMU {fmu.path.name} has the start value {value!r} of {variable.name!r}, which is no number",
                    where,
                ) from None
            continue
        if variable.identity in values:
            number = float(values[variable.identity])
        elif variable.start is not None:
            number = start_of(variable)[bound.played_by.element]
        else:
            raise InputError(f"the parameter {variable.name!r} of {fmu.path.name} has no value: set it", where)
        found[field] = number * bound.played_by.scale + bound.played_by.offset
    return found


def value_of(description: ModelDescription, variable: Variable, text: str) -> float | int | bool | str:
    """Return the value that a text is for a variable, in its own unit.

    Raises
    ------
    ValueError, plants.UnitError
        It does not fit: unit, bounds, item of an enumeration.
    """
    if variable.dimensions:
        raise ValueError("it is an array, which a scenario cannot set")
    if variable.type in FLOAT_TYPES:
        value = quantity(text, unit_of_values(description, variable, [text]))
        check_bounds(variable, value, text)
        return value
    if variable.type not in DISCRETE:
        raise ValueError(f"it is a {variable.type}, which a scenario cannot set")
    discrete = discrete_value(variable, text)
    check_whole(variable, discrete, text)
    return discrete
