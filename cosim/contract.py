"""Vehicle contracts: which roles a plant must offer, in which unit, so that a controller can drive it.

The master knows a plant by these roles alone. `bind` finds the variables of an FMU that play them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from cosim.errors import InputError, Location
from plants import UnitError, units


@dataclass(frozen=True)
class Role:
    """What a variable is for: its name in the contract, which causality it must have, and the unit used.

    A role without a unit is played by an enumeration, all others by a real variable.
    """

    name: str
    causality: str
    unit: str


@dataclass(frozen=True)
class Contract:
    """The roles of one kind of vehicle.

    Attributes
    ----------
    vehicle : str
        The kind, as the controllers name it.
    pose, velocity, torque : tuple of Role
        Four pose entries and two pseudo-velocities out, two torques in.
    geometry : dict
        Fields of the controllers' vehicle description, each with the parameter that holds it.
    """

    vehicle: str
    pose: tuple[Role, ...]
    velocity: tuple[Role, ...]
    torque: tuple[Role, ...]
    geometry: dict[str, Role]

    @property
    def roles(self) -> Iterable[Role]:
        """All roles."""
        return (*self.pose, *self.velocity, *self.torque, *self.geometry.values())


CAR_LIKE = Contract(
    vehicle="car_like",
    pose=(
        Role("x", "output", "m"),
        Role("y", "output", "m"),
        Role("psi", "output", "rad"),
        Role("gamma", "output", "rad"),
    ),
    velocity=(Role("v", "output", "m/s"), Role("omega", "output", "rad/s")),
    torque=(Role("tau_drive", "input", "N.m"), Role("tau_steer", "input", "N.m")),
    geometry={"wheelbase": Role("a", "parameter", "m"), "drive": Role("drive", "parameter", "")},
)

TRACTOR_TRAILER = Contract(
    vehicle="tractor_trailer",
    pose=(
        Role("x", "output", "m"),
        Role("y", "output", "m"),
        Role("theta_1", "output", "rad"),
        Role("theta_0", "output", "rad"),
    ),
    velocity=(Role("v", "output", "m/s"), Role("omega", "output", "rad/s")),
    torque=(Role("tau_right", "input", "N.m"), Role("tau_left", "input", "N.m")),
    geometry={
        "hitch_length": Role("d", "parameter", "m"),
        "wheel_radius": Role("r", "parameter", "m"),
        "half_track": Role("b", "parameter", "m"),
    },
)

CONTRACTS = (CAR_LIKE, TRACTOR_TRAILER)


def labels(contracts: Iterable[Contract], roles: str) -> tuple[str, ...]:
    """Return names for the entries of the roles ``pose``, ``velocity`` or ``torque`` that fit all of the contracts.

    Where vehicles differ the names are joined, as in "psi/theta_1".
    """
    names = zip(*([role.name for role in getattr(contract, roles)] for contract in contracts), strict=True)
    return tuple("/".join(dict.fromkeys(entry)) for entry in names)


@dataclass(frozen=True)
class BoundRole:
    """A role played by a variable of an FMU: ``value in the role's unit = scale * value of the variable``."""

    role: Role
    variable: Any
    scale: float


@dataclass(frozen=True)
class Binding:
    """A contract that an FMU satisfies, with the variable that plays each role, by the role's name."""

    contract: Contract
    bound: dict[str, BoundRole]

    def of(self, roles: Iterable[Role]) -> tuple[BoundRole, ...]:
        """Return the bound roles in the order given."""
        return tuple(self.bound[role.name] for role in roles)


def bind(description: Any, file: str, where: Location | None = None) -> Binding:
    """Find the contract that an FMU satisfies; a variable plays the role of its name.

    Parameters
    ----------
    description : fmpy.model_description.ModelDescription
        What the FMU says of itself.
    file, where
        The FMU and the place in the scenario that asks for it, for the message.

    Raises
    ------
    InputError
        The FMU satisfies no contract: which roles are missing or of the wrong kind.
    """
    reasons = []
    for contract in CONTRACTS:
        bound, problems = _match(contract, description)
        if not problems:
            return Binding(contract, bound)
        reasons.append(f"as a {contract.vehicle} vehicle it {'; it '.join(problems)}")
    raise InputError(f"the FMU {file} is no vehicle that can be driven here: {'. '.join(reasons)}", where)


def _match(contract: Contract, description: Any) -> tuple[dict[str, BoundRole], list[str]]:
    variables = {variable.name: variable for variable in description.modelVariables}
    bound, problems = {}, []
    for role in contract.roles:
        variable = variables.get(role.name)
        if variable is None or variable.causality != role.causality:
            problems.append(f"lacks the {role.causality} {role.name!r}" + (f" [{role.unit}]" if role.unit else ""))
        elif variable.type != ("Real" if role.unit else "Enumeration"):
            problems.append(f"has {role.name!r} as {variable.type}, not as {'Real' if role.unit else 'Enumeration'}")
        elif role in contract.pose and variable.initial not in ("exact", "approx"):
            problems.append(f"has no start value of {role.name!r} that could be set")
        elif not role.unit:
            bound[role.name] = BoundRole(role, variable, 1.0)
        else:
            try:
                bound[role.name] = BoundRole(role, variable, unit_scale(description, variable, role.unit))
            except UnitError as error:
                problems.append(f"offers a unit that does not fit: {error}")
    return bound, problems


def unit_scale(description: Any, variable: Any, unit: str) -> float:
    """Return by what to multiply a variable's value to have it in another unit.

    Raises
    ------
    plants.UnitError
        The variable has no unit, or one that does not fit.
    """
    own, wanted = unit_of(description, variable), units.parse(unit)
    if own.exponents != wanted.exponents:
        raise UnitError(f"{variable.name!r} is in {own}, not in {wanted}")
    return own.factor / wanted.factor


def unit_of(description: Any, variable: Any) -> units.Unit:
    """Return the unit of a variable: as the FMU defines it, or by its name where it is not defined.

    Raises
    ------
    plants.UnitError
        The variable has no unit, or one that is not known.
    """
    name = variable.unit or (variable.declaredType.unit if variable.declaredType else None)
    if not name:
        raise UnitError(f"{variable.name!r} has no unit")
    for definition in description.unitDefinitions:
        if definition.name == name and definition.baseUnit is not None:
            base = definition.baseUnit
            if base.offset != 0 or not 0.0 < base.factor < math.inf:
                raise UnitError(f"{variable.name!r} is in {name}, which has an offset or a factor that is not positive")
            return units.Unit(tuple(int(getattr(base, symbol)) for symbol in units.BASE_UNITS), float(base.factor))
    return units.parse(name)
