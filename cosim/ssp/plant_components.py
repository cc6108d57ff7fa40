"""A robot's plant as a component of a system: its connectors, its parameter set, and the numbers that it exchanges."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from cosim.errors import InputError
from cosim.fmu.model_description import ModelDescription, Variable
from cosim.fmu.units import unit_name, unit_of
from cosim.master.robot import RobotSetup
from cosim.master.robot_plants import member
from cosim.plant.member import Link, Member
from cosim.plant.spec import FLOAT_TYPES, WHOLE, Block, Value
from cosim.ssp.structure import Component, Connector, Parameter
from plants import UnitError


@dataclass(frozen=True)
class Number:
    """A number of a plant that is exchanged: ``value in the role's unit = scale * number + offset``.

    Attributes
    ----------
    role : str
        The role.
    variable : str
        The plant's variable.
    start : float
        Its value at the start, in the plant's own unit.
    """

    role: str
    variable: str
    scale: float
    offset: float
    start: float

    @property
    def from_role(self) -> tuple[float, float]:
        """Factor and offset that lead from the role's unit to the number."""
        return 1.0 / self.scale, -self.offset / self.scale


@dataclass(frozen=True)
class PlantComponent:
    """A robot's plant in a system.

    Attributes
    ----------
    robot : RobotSetup
        The robot.
    source : str
        The path of its FMU in the SSP.
    baked : dict
        The items of enumerations that its FMU has from the start, by the name of the parameter.
    stop : float
        The end of the run [s].
    """

    robot: RobotSetup
    source: str
    baked: Mapping[str, int]
    stop: float

    @cached_property
    def _member(self) -> Member:
        return member(self.robot, self.stop)

    @property
    def values(self) -> tuple[Value, ...]:
        """The values that its FMU gets before the start: parameters, and the initial pose."""
        return self._member.spec.values

    @cached_property
    def states(self) -> dict[str, Number]:
        """Its pose and velocities, by role; a role that no variable plays is left out."""
        found = _numbers(self._member.outputs, self._member.spec.outputs, self.robot)
        for role, value in zip(self.robot.kind.pose, self.robot.pose, strict=True):
            number = found[role.name]
            found[role.name] = replace(number, start=(value - number.offset) / number.scale)
        return found

    @cached_property
    def inputs(self) -> dict[str, Number]:
        """Its commands and the other inputs that the scenario gives values, by role."""
        return _numbers(self._member.inputs, self._member.spec.inputs, self.robot)

    def component(self, connected: Mapping[str, None]) -> Component:
        """Return the component.

        Parameters
        ----------
        connected
            The roles of its inputs that are connected; the others have their first value for good.
        """
        description = self.robot.fmu.description
        by_name = {variable.name: variable for variable in description.modelVariables}
        taken = [number.variable for role, number in self.inputs.items() if role in connected]
        offered = [number.variable for number in self.states.values()]
        return Component(
            name=self.robot.name,
            source=self.source,
            connectors=(
                *(connector_of(description, by_name[name], "input") for name in dict.fromkeys(taken)),
                *(connector_of(description, by_name[name], "output") for name in dict.fromkeys(offered)),
            ),
            parameters=tuple(self._parameters(by_name, connected)),
            parameters_source=f"resources/{self.robot.name}.ssv",
            description=f"{self.robot.kind.title}, plant {self.robot.source.id}",
        )

    def _parameters(self, by_name: Mapping[str, Variable], connected: Mapping[str, None]) -> Iterator[Parameter]:
        description = self.robot.fmu.description
        for value in (*self._member.spec.values, *self._member.spec.held):
            if value.name not in self.baked:
                yield _parameter(value, unit_in(description, by_name[value.name]), self.robot)
        for role, number in self.inputs.items():
            if role not in connected:
                variable = by_name[number.variable]
                yield Parameter(number.variable, "Real", number.start, unit_in(description, variable))


def connector_of(description: ModelDescription, variable: Variable, kind: str) -> Connector:
    """Return a connector for a variable of an FMU."""
    if variable.type in FLOAT_TYPES:
        return Connector(variable.name, kind, "Real", unit_in(description, variable))
    return Connector(variable.name, kind, _type_of(variable.type))


def unit_in(description: ModelDescription, variable: Variable) -> str:
    """Return the name of a variable's unit; empty if it has none, or one that is not known."""
    if variable.type not in FLOAT_TYPES:
        return ""
    try:
        unit_of(description, variable)
    except UnitError:
        return ""
    return unit_name(variable)


def _type_of(type_name: str) -> str:
    if type_name in FLOAT_TYPES:
        return "Real"
    if type_name in WHOLE or type_name == "Enumeration":  # libcosim and ecos end at the standard's Enumeration
        return "Integer"
    return type_name


def _parameter(value: Value, unit: str, robot: RobotSetup) -> Parameter:
    if len(value.values) != 1:
        raise InputError(
            f"{robot.name}: {value.name!r} of {robot.fmu.path.name} is an array, for which an SSP can state no value",
            robot.where,
        )
    (number,) = value.values
    kind = _type_of(value.type)
    return Parameter(value.name, kind, float(number) if kind == "Real" else number, unit)


def _numbers(links: tuple[Link, ...], block: Block, robot: RobotSetup) -> dict[str, Number]:
    found = {}
    for link in links:
        if link.place < 0:
            continue
        name = block.name_of(link.place)
        variable = next(variable for variable in block.variables if variable.name == name)
        if variable.size != 1:
            raise InputError(
                f"{robot.name}: {link.name} is an element of the array {name!r} of {robot.fmu.path.name}; an SSP "
                "connects whole variables only",
                robot.where,
            )
        found[link.name] = Number(link.name, name, link.scale, link.offset, block.start[link.place])
    return found
