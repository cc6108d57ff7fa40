"""From a scenario to the system of FMUs that does the same: plants, teams, courses over time, and their connections."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

import plants
from cosim.errors import InputError, listed
from cosim.fmu.discrete_values import items
from cosim.fmu.interfaces import interfaces
from cosim.fmu.model_description import Variable
from cosim.fmu.package import open_package
from cosim.fmu.units import unit_name, unit_of
from cosim.master.robot import RobotSetup
from cosim.master.setup import Setup, set_up
from cosim.plant.spec import CO_SIMULATION, FLOAT_TYPES
from cosim.scenario.scenario import LEADER, Scenario
from cosim.ssp.carried import carried, content_of
from cosim.ssp.courses import Course, courses_fmu
from cosim.ssp.document import ALL_PARAMETERS
from cosim.ssp.plant_components import Number, PlantComponent, connector_of
from cosim.ssp.structure import RESOURCES, Component, Connection, Connector, Parameter, Structure
from cosim.ssp.teams import TeamFmu, team_fmus
from plants import units

COURSES = "inputs"
"""The component that gives plants the inputs of which the scenario states a course over time."""


@dataclass(frozen=True)
class System:
    """A system of FMUs that does what a scenario states.

    Attributes
    ----------
    structure : Structure
        The system.
    content : dict
        The FMUs, the scenario and the files that it names, by their paths in the SSP.
    notes : tuple of str
        What other masters do otherwise, or cannot be told, each a sentence.
    """

    structure: Structure
    content: Mapping[str, Path | bytes]
    notes: tuple[str, ...]


@dataclass
class _Parts:
    """The parts of a system, as they come together.

    Attributes
    ----------
    names : set of str
        Those of components, and of files in the folder of resources, so that none has the name of another.
    plants : dict
        The FMUs that Formation has not built, by the ids of the plants: their names in the folder of resources.
    """

    names: set[str]
    plants: dict[str, str] = field(default_factory=dict)
    components: list[Component] = field(default_factory=list)
    connections: list[Connection] = field(default_factory=list)
    content: dict[str, Path | bytes] = field(default_factory=dict)
    units: dict[str, tuple[tuple[int, ...], float]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def name(self, wanted: str, prefix: str) -> str:
        """Return a name that nothing has yet: the wanted one, if need be with prefixes."""
        while wanted in self.names:
            wanted = prefix + wanted  # no suffix, as FMPy takes mine_team.x for a parameter of mine
        self.names.add(wanted)
        return wanted

    def note(self, sentence: str) -> None:
        """Keep a sentence, once."""
        if sentence not in self.notes:
            self.notes.append(sentence)


def system_of(scenario: Scenario, cleanup: ExitStack, *, late: bool = True, version: str = "1.0") -> System:
    """Return the system of a scenario. The FMUs that it needs are built.

    Parameters
    ----------
    scenario
        The scenario.
    cleanup
        Receives the clean-up callbacks.
    late
        Whether the teams give their commands one communication step late, so that every master computes the same.
    version
        The version of SSP.

    Raises
    ------
    InputError
        The scenario is wrong, or states what a system of FMUs cannot.
    """
    setup = set_up(scenario, cleanup, {})
    robots = (setup.leader, *setup.followers)
    _check(scenario, robots)
    parts = _Parts({robot.name for robot in robots} | {Path(ALL_PARAMETERS).stem})
    limited: dict[str, dict[str, None]] = {}
    for follower in scenario.followers if late else ():
        for effect in follower.actuator:
            if effect.start > 0.0 or effect.stop < scenario.horizon:
                limited.setdefault(effect.kind, {})[follower.id] = None
    for kind, names in limited.items():
        parts.note(f"the window of <{kind}> in actuators is one communication step late, too: {listed([*names])}")
    of_courses = parts.name(COURSES, "given_")
    teams = [replace(team, name=parts.name(team.name, "team_")) for team in team_fmus(scenario, setup, late=late)]
    for robot in setup.followers if late else ():
        if np.any(robot.torque):
            parts.note(f"the <input> that adds to the command of {robot.name} acts one communication step late, too")
        if any(event.stops for event in scenario.events_by_robot.get(robot.name, ())):
            parts.note(f"the <stop/> of {robot.name} acts one communication step late, too")
    moving = setup.followers if setup.motion is not None else robots
    placed = [_plant(scenario, robot, parts) for robot in moving]
    courses = list(_given_courses(placed, scenario))
    for plant in placed:
        component = plant.component(dict.fromkeys(_connected(plant, courses, teams)))
        parts.components.append(_with_units(parts, plant.robot, component))
    outputs = {plant.robot.name: plant.states for plant in placed}
    if setup.motion is not None:
        outputs[LEADER] = _leading(scenario, setup, parts)
    _teams(teams, placed, outputs, scenario, cleanup, parts)
    _inputs(of_courses, courses, placed, scenario, parts)
    content, notes = carried(scenario)
    structure = Structure(
        name=scenario.name,
        description=_described(scenario, late),
        components=tuple(parts.components),
        connections=tuple(parts.connections),
        units=parts.units,
        stop=scenario.horizon,
        step=scenario.step,
        version=version,
    )
    return System(structure, {**parts.content, **content}, (*parts.notes, *notes))


def _described(scenario: Scenario, late: bool) -> str:
    text = f"{scenario.title}. Made by Formation from the scenario {scenario.name}"
    if not late:
        return text
    step = f"{scenario.step:.12g} s"
    return (
        f"{text}. The teams give their commands one communication step ({step}) late, under every master: "
        f'the run to compare with has <delay time="{step}"/> in the actuators of all followers'
    )


def _check(scenario: Scenario, robots: Iterable[RobotSetup]) -> None:
    """Refuse what a system of FMUs cannot state."""
    for event in scenario.events:
        if event.parameters or event.inputs:
            raise InputError(
                f"this event changes {event.robot} in the course of the run, which an SSP cannot state: leave the "
                "event out to export the rest",
                event.where,
            )
    for follower in scenario.followers:
        if follower.id == Path(ALL_PARAMETERS).stem:
            raise InputError(
                f"no robot of an SSP can be called {follower.id!r}, as the parameters of all are in {ALL_PARAMETERS}",
                follower.where,
            )
    for robot in robots:
        if robot.changes:
            raise InputError(
                f"{robot.name} has an input that is no real number and changes in the course of the run, which an SSP "
                "cannot state",
                robot.where,
            )
        if CO_SIMULATION not in interfaces(robot.fmu.description):
            raise InputError(
                f"the FMU {robot.fmu.path} offers Model Exchange alone; an SSP for co-simulation needs plants with "
                "Co-Simulation",
                robot.source.where,
            )


# Plants -----------------------------------------------------------------------------------------------------


def _plant(scenario: Scenario, robot: RobotSetup, parts: _Parts) -> PlantComponent:
    """Return the plant of a robot; its FMU is kept."""
    source = robot.source
    if source.model is not None:
        begun = PlantComponent(robot, f"{RESOURCES}/{robot.name}.fmu", {}, scenario.horizon)
        try:
            fmu: Path | bytes = plants.build(source.model, starts=_starts(begun))
        except plants.PlantError as error:
            raise InputError(str(error), source.where) from None
        baked = {v.name: 0 for v in robot.fmu.description.modelVariables if v.type == "Enumeration"}
        plant = PlantComponent(robot, begun.source, baked, scenario.horizon)
    else:
        assert source.fmu is not None
        if source.id not in parts.plants:
            parts.plants[source.id] = parts.name(source.id, "plant_")
        plant = PlantComponent(robot, f"{RESOURCES}/{parts.plants[source.id]}.fmu", {}, scenario.horizon)
        fmu = content_of(source.fmu)
        _note_limits(plant, parts)
    _note_interface(plant, parts)
    parts.content[plant.source] = fmu
    return plant


def _starts(plant: PlantComponent) -> dict[str, float | str]:
    """Return the start values of a built-in model's FMU: libcosim sets no enumeration and no initial pose."""
    by_name = {variable.name: variable for variable in plant.robot.fmu.description.modelVariables}
    starts: dict[str, float | str] = {}
    for value in plant.values:
        (number,) = value.values
        starts[value.name] = items(by_name[value.name])[int(number)] if value.type == "Enumeration" else float(number)
    return starts


def _note_limits(plant: PlantComponent, parts: _Parts) -> None:
    """Tell what other masters do otherwise with an FMU that Formation has not built."""
    robot, name = plant.robot, plant.robot.fmu.path.name
    by_name = {variable.name: variable for variable in robot.fmu.description.modelVariables}
    unset = [v.name for v in plant.values if v.type == "Enumeration" or by_name[v.name].causality == "output"]
    if unset:
        parts.note(
            f"libcosim sets no enumeration and no start value of an output, so that {name} keeps its own for "
            f"{', '.join(dict.fromkeys(unset))}; other masters take them from the parameter set"
        )


def _note_interface(plant: PlantComponent, parts: _Parts) -> None:
    """Tell in what other masters run an FMU otherwise than the scenario."""
    robot, source = plant.robot, plant.robot.source
    name = source.model or robot.fmu.path.name
    if robot.fmu.interface != CO_SIMULATION:
        parts.note(
            f"{name} is integrated by the solver of its Co-Simulation there, as an SSP for co-simulation states no "
            "Model Exchange: the trajectories differ from those of the scenario"
        )
    elif source.tolerance is not None:
        parts.note(
            f"the tolerance of the plant {source.id!r} is not in an SSP: other masters give {name} one of theirs"
        )
    if source.late_outputs:
        parts.note(f'other masters read the outputs of {name} before its first step, which start="first_step" ignores')


def _with_units(parts: _Parts, robot: RobotSetup, component: Component) -> Component:
    """Define the units that a component uses; return it without those that another FMU defines otherwise."""
    description = robot.fmu.description
    by_name = {variable.name: variable for variable in description.modelVariables}

    def stated(one: Connector | Parameter) -> str:
        if not one.unit:
            return ""
        unit = unit_of(description, by_name[one.name])
        defined = unit.exponents, unit.factor
        return one.unit if parts.units.setdefault(one.unit, defined) == defined else ""

    connectors = tuple(replace(one, unit=stated(one)) for one in component.connectors)
    return replace(
        component,
        connectors=connectors,
        parameters=tuple(replace(one, unit=stated(one)) for one in component.parameters),
    )


# Teams ------------------------------------------------------------------------------------------------------


def _teams(
    teams: Sequence[TeamFmu],
    placed: Sequence[PlantComponent],
    outputs: Mapping[str, Mapping[str, Number]],
    scenario: Scenario,
    cleanup: ExitStack,
    parts: _Parts,
) -> None:
    plants_of = {plant.robot.name: plant for plant in placed}
    for team in teams:
        package = open_package(team.path)
        cleanup.callback(package.close)
        source = f"{RESOURCES}/{team.name}.fmu"
        parts.content[source] = team.path
        variables = [v for v in package.description.modelVariables if v.causality in ("input", "output")]
        connectors = tuple(connector_of(package.description, v, v.causality) for v in variables)
        begun: list[Parameter] = []
        for connector in connectors:
            robot, _, entry = connector.name.rpartition(".")
            if connector.kind == "input":
                number = outputs[robot][entry]
                parts.connections.append(
                    Connection((robot, number.variable), (team.name, connector.name), number.scale, number.offset)
                )
                value = number.scale * number.start + number.offset
                begun.append(Parameter(connector.name, "Real", value, connector.unit))
            elif (plant := plants_of.get(robot)) is not None and entry in plant.inputs:
                number = plant.inputs[entry]
                parts.connections.append(
                    Connection((team.name, connector.name), (robot, number.variable), *number.from_role)
                )
        gains = [_start(v) for v in package.description.modelVariables if v.causality == "parameter"]
        _define_plain(parts, (*connectors, *gains))
        parts.components.append(
            Component(
                name=team.name,
                source=source,
                connectors=connectors,
                parameters=(*begun, *gains),
                parameters_source=f"{RESOURCES}/{team.name}.ssv",
                description=f"sensors, control law and actuators of {', '.join(team.robots)}",
            )
        )


def _start(variable: Variable) -> Parameter:
    """Return the start value of a parameter of an FMU that Formation has built."""
    if variable.type in FLOAT_TYPES:
        return Parameter(variable.name, "Real", float(variable.start or 0.0), unit_name(variable))
    return Parameter(variable.name, "Integer", int(variable.start or 0))


def _define_plain(parts: _Parts, used: Iterable[Connector | Parameter]) -> None:
    """Define the units of an FMU that Formation has built."""
    for one in used:
        if one.unit and one.unit not in parts.units:
            unit = units.parse(one.unit)
            parts.units[one.unit] = (unit.exponents, unit.factor)


# Courses over time ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Given:
    """A course of an input of a robot's plant."""

    robot: str
    role: str
    course: Course


def _given_courses(placed: Iterable[PlantComponent], scenario: Scenario) -> Iterator[_Given]:
    """Yield the inputs of plants that change over time and that no team gives."""
    for plant in placed:
        robot = plant.robot
        roles = [role.name for role in robot.kind.command] if robot.name == LEADER else []
        given = [(role, robot.torque[:, column]) for column, role in enumerate(roles)]
        given += [(bound.role.name, robot.samples[:, column]) for column, bound in enumerate(robot.inputs)]
        units_of = {r.name: r.unit for r in (*robot.kind.command, *(bound.role for bound in robot.inputs))}
        for role, values in given:
            if role in plant.inputs and np.any(values != values[0]):
                text = f"{role} of {robot.name}"
                yield _Given(robot.name, role, Course(f"{robot.name}.{role}", units_of[role], text, np.array(values)))


def _connected(plant: PlantComponent, courses: Iterable[_Given], teams: Iterable[TeamFmu]) -> Iterator[str]:
    """Yield the roles of the inputs of a robot's plant that are connected."""
    robot = plant.robot
    yield from (given.role for given in courses if given.robot == robot.name)
    if any(robot.name in team.robots for team in teams):
        yield from (role.name for role in robot.kind.command if role.name in plant.inputs)


def _inputs(
    name: str, courses: Sequence[_Given], placed: Iterable[PlantComponent], scenario: Scenario, parts: _Parts
) -> None:
    if not courses:
        return
    plants_of = {plant.robot.name: plant for plant in placed}
    text = f"Inputs of the plants over time, from the scenario {scenario.name}"
    parts.components.append(_course_component(name, text, [given.course for given in courses], scenario, parts))
    for given in courses:
        number = plants_of[given.robot].inputs[given.role]
        parts.connections.append(
            Connection((name, given.course.name), (given.robot, number.variable), *number.from_role)
        )


def _leading(scenario: Scenario, setup: Setup, parts: _Parts) -> dict[str, Number]:
    """Add the leader's FMU, which moves along its path; return its outputs by role."""
    motion, kind = setup.motion, setup.leader.kind
    assert motion is not None
    courses = [
        Course(role.name, role.unit, role.meaning or role.name, np.array(motion.state[:, column]))
        for column, role in enumerate(kind.states)
    ]
    courses += [
        Course(f"der_{role.name}", units.per_second(role.unit), f"rate of {role.name}", np.array(values))
        for role, values in zip(kind.velocity, motion.acceleration.T, strict=True)
    ]
    text = f"Motion of the leader on its path, from the scenario {scenario.name}"
    parts.components.append(_course_component(LEADER, text, courses, scenario, parts))
    return {course.name: Number(course.name, course.name, 1.0, 0.0, float(course.values[0])) for course in courses}


def _course_component(name: str, text: str, courses: Sequence[Course], scenario: Scenario, parts: _Parts) -> Component:
    source = f"{RESOURCES}/{name}.fmu"
    try:
        parts.content[source] = courses_fmu(name, text, courses, scenario.step)
    except plants.PlantError as error:
        raise InputError(str(error), scenario.where) from None
    connectors = tuple(Connector(course.name, "output", "Real", course.unit) for course in courses)
    _define_plain(parts, connectors)
    return Component(name, source, connectors, description=text)
