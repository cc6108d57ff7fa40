"""A scenario from an SSP of somebody else: the vehicles that are recognised, and what is missing as comments."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

from cosim.errors import InputError, Location, printable
from cosim.fmu.binding import BoundVariable, match, start_of
from cosim.fmu.interfaces import choose_interface
from cosim.fmu.package import Package, open_package
from cosim.master.robot_inputs import INPUT_TYPES
from cosim.plant.spec import CO_SIMULATION, MODEL_EXCHANGE
from cosim.scenario.grammar import NAMESPACE, matches
from cosim.scenario.scenario import DEFAULT_SOLVER, LEADER, OPEN
from cosim.ssp.experiment import experiment
from cosim.ssp.found import Found
from cosim.ssp.structure import Component, Parameter, Structure, Units
from cosim.ssp.values import number_of, written
from cosim.swap.proposal import Proposal, binding_xml, proposals
from cosim.vehicle.kind import ADAPTIVE_PID, Kind

_STEP, _HORIZON = 0.02, 60.0
"""Step and end of a run [s] where the SSP states none."""


@dataclass
class _Robot:
    """A component that is recognised as a vehicle.

    Attributes
    ----------
    id : str
        Its name in the scenario.
    plant : str
        The id of its plant.
    pose, command : dict
        Values in the roles' units, by role.
    settings, inputs : dict
        Values of its parameters, and of inputs that keep one, as a scenario writes them.
    """

    component: Component
    proposal: Proposal
    id: str
    plant: str
    pose: dict[str, float] = field(default_factory=dict)
    command: dict[str, float] = field(default_factory=dict)
    settings: dict[str, str] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)

    @property
    def kind(self) -> Kind:
        return self.proposal.kind


@dataclass
class _Plant:
    """A plant of the scenario: an FMU of the SSP, with the interface that a component asks for."""

    id: str
    file: str
    binding: str = ""
    interface: str = ""


def recognised_scenario(
    path: Path, structure: Structure, directory: Path, folder: str, name: str, cleanup: ExitStack
) -> Found:
    """Return a scenario with the vehicles of an SSP, their parameters and initial poses.

    The rest, controllers above all, stands in it as comments that say what to do.

    Parameters
    ----------
    path, structure, directory
        The SSP, its system, and where it is unpacked.
    folder
        The folder of the FMUs and bindings, relative to the scenario.
    name
        The name of the scenario.
    cleanup
        Receives the clean-up callbacks.

    Raises
    ------
    InputError
        No component is recognised as a vehicle, or one is no FMU.
    """
    packages: dict[str, Package] = {}
    plants: dict[tuple[str, str], _Plant] = {}
    files: dict[str, bytes] = {}
    robots: list[_Robot] = []
    others: list[str] = []
    reasons: list[str] = []
    to_do: list[str] = []
    for component in structure.components:
        if component.source not in packages:
            packages[component.source] = package = open_package(directory / component.source, component.where)
            cleanup.callback(package.close)
        package = packages[component.source]
        proposal = proposals(package.description)[0]
        if not proposal.plausible:
            others.append(component.name)
            missing = ", ".join(role.name for role in proposal.missing)
            reasons.append(f"{component.name} lacks {missing}" if missing else f"{component.name}: {proposal.refusal}")
            continue
        interface = _interface(component, package)
        plant = plants.get((component.source, interface))
        if plant is None:
            plant = _plant(component, proposal, interface, directory, folder, plants, files)
            plants[component.source, interface] = plant
            to_do += [f"fill in {s.role.name} in {plant.binding}: {' '.join(s.open)}" for s in proposal.open]
            if interface:
                to_do.append(
                    f"the plant {plant.id} has Model Exchange, as in the SSP, which names no solver: state solver and "
                    f"solver_step or tolerance if {DEFAULT_SOLVER} with the step of the run does not suit it"
                )
        robots.append(_Robot(component, proposal, _id(component.name, robots), plant.id))
    if not robots:
        raise InputError(
            f"no component is recognised as a vehicle ({'; '.join(reasons) or 'there is none'}); formation inspect "
            "shows what an FMU lacks",
            Location(str(path)),
        )
    for robot in robots:
        to_do += list(_values(robot, packages[robot.component.source], structure))
    leader = next((robot for robot in robots if LEADER in robot.component.name.lower()), robots[0])
    leads = f"{leader.component.name} is taken as the leader" + (
        "" if LEADER in leader.component.name.lower() else ", as it is the first vehicle and no name tells of one"
    )
    followers = [robot for robot in robots if robot is not leader]
    to_do.insert(0, leads)
    if not followers:
        to_do.append("there is one vehicle alone, which leads: add at least one <follower>")
    if others:
        to_do.append(
            f"left out, as they are no vehicles: {', '.join(others)}; the law below is in the place of controllers"
        )
    to_do.append("the places of the followers are those in which they start: state the formation that you want")
    to_do.append(f"the control law is {ADAPTIVE_PID.name} with gains that suit many vehicles: choose your own")
    step, horizon = experiment(structure, _STEP, _HORIZON, rounds=not (structure.step and structure.stop))
    stated = {"step": structure.step, "end": structure.stop}
    if unstated := " and no ".join(name for name, value in stated.items() if not value):
        to_do.append(f"the run has a step of {step:g} s and ends at {horizon:g} s: the SSP states no {unstated}")
    text = _text(path, structure, name, leader, followers, list(plants.values()), to_do, step, horizon)
    is_open = any(robot.proposal.open for robot in robots) or not followers
    return Found(text.encode(), files, (), tuple(to_do), is_open)


def _interface(component: Component, package: Package) -> str:
    """Return the interface that a plant must state, so that it is the one of the component; empty for none.

    Raises
    ------
    InputError
        The FMU does not offer it.
    """
    wanted = {"ModelExchange": MODEL_EXCHANGE, "CoSimulation": CO_SIMULATION}.get(component.implementation, "")
    chosen = choose_interface(package, wanted, component.where) if wanted else ""
    return chosen if chosen == MODEL_EXCHANGE else ""


def _plant(
    component: Component,
    proposal: Proposal,
    interface: str,
    directory: Path,
    folder: str,
    before: Mapping[tuple[str, str], _Plant],
    files: dict[str, bytes],
) -> _Plant:
    stem = re.sub(r"[^A-Za-z0-9_\-]", "_", Path(component.source).stem).strip("_-") or "plant"
    taken = {plant.id for plant in before.values()}
    while stem in taken or not matches("name", stem):
        stem += "_2" if matches("name", stem) else "p"
    for (source, _), other in before.items():
        if source == component.source:  # with the other interface
            return _Plant(stem, other.file, other.binding, interface)
    plant = _Plant(stem, f"{folder}/{stem}.fmu", interface=interface)
    files[plant.file] = (directory / component.source).read_bytes()
    if not proposal.needs_no_binding:
        plant.binding = f"{folder}/{stem}.binding.xml"
        files[plant.binding] = binding_xml(proposal, f"{stem}.fmu").encode()
    return plant


def _id(name: str, before: Sequence[_Robot]) -> str:
    """Return a component's name as the id of a robot."""
    found = re.sub(r"[^A-Za-z0-9_\-]", "_", name).strip("_-")[:60] or "robot"
    taken = {robot.id for robot in before} | {LEADER}
    number = 1
    chosen = found
    while chosen in taken or not matches("name", chosen):
        number += 1
        chosen = f"{found if matches('name', found) else 'robot'}_{number}"
    return chosen


def _values(robot: _Robot, package: Package, structure: Structure) -> Iterator[str]:
    """Fill in pose, commands, parameters and inputs of a robot; yield what cannot be taken over."""
    description, known, owner = package.description, structure.units, robot.component.name
    connections = {one.end[1]: one for one in structure.connections if one.end[0] == owner}
    declared = [source for source in robot.proposal.binding.roles if OPEN not in (source.variable, source.unit)]
    bound, _ = match(robot.kind, description, [s for s in declared if OPEN not in (s.factor, s.initial, s.value)])
    given = {parameter.name: parameter for parameter in robot.component.parameters}
    by_name = description.by_name
    for role in robot.kind.pose:
        number = bound[role.name].initial if role.name in bound else None
        if number is None:
            robot.pose[role.name] = 0.0
            yield f"the initial {role.name} of {owner} is not known, and stands as 0"
        else:
            robot.pose[role.name] = _taken(number, given, package, known)
    for role in robot.kind.command:
        number = bound[role.name].played_by if role.name in bound else None
        if number is None:
            continue
        name = number.variable.name
        if name in connections and name not in given:  # the law is in the place of what commands it
            del connections[name]
        elif name in given and name not in connections:
            robot.command[role.name] = _taken(number, given, package, known)
    for role in robot.kind.disturbance:
        number = bound[role.name].played_by if role.name in bound else None
        if number is not None and number.variable.name in given and number.variable.name not in connections:
            robot.inputs[role.name] = f"{_taken(number, given, package, known)!r} {role.unit}"
    for name, connection in connections.items():
        start = ".".join(part for part in connection.start if part)
        told = f"the connection of {start} with {name!r} of {owner} is left out"
        variable = by_name.get(name)
        if name not in given:
            yield told
        elif variable is not None and variable.causality == "parameter":
            yield f"{told}: it keeps the value that it has besides"
        else:
            del given[name]
            yield f"{told}, and so is the value that it starts with"
    for name, parameter in given.items():
        variable = by_name.get(name)
        if variable is None:
            yield f"the parameter {name!r} of {owner} ({parameter.where}) is none of its FMU's, and is left out"
        elif variable.causality == "parameter" and not variable.dimensions:
            robot.settings[name] = written(parameter, variable, description, known)
        elif variable.causality == "input" and variable.type in INPUT_TYPES and not variable.dimensions:
            robot.inputs[name] = written(parameter, variable, description, known)
        else:
            yield f"the value of {name!r} of {owner} cannot be stated in a scenario, and is left out"


def _taken(number: BoundVariable, given: dict[str, Parameter], package: Package, known: Units) -> float:
    """Return the value of a number in its role's unit: that of the SSP, or the FMU's start value."""
    parameter = given.pop(number.variable.name, None)
    if parameter is None:
        start = start_of(number.variable)[number.element]
        return number.scale * start + number.offset
    value = number_of(parameter, number.variable, package.description, known, number.unit)
    return number.scale * value + number.offset


# The text ---------------------------------------------------------------------------------------------------


def _text(
    path: Path,
    structure: Structure,
    name: str,
    leader: _Robot,
    followers: Sequence[_Robot],
    plants: Sequence[_Plant],
    to_do: Sequence[str],
    step: float,
    horizon: float,
) -> str:
    law = ADAPTIVE_PID
    listed = "\n".join(
        textwrap.fill(_comment(sentence), 112, initial_indent="       - ", subsequent_indent="         ")
        for sentence in to_do
    )
    gains = "\n".join(f'    <gain name="{gain}" value="{value}"/>' for gain, value in law.gains.items())
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<scenario xmlns="{NAMESPACE}" name="{name}">',
        "",
        f"  <title>{escape(printable(structure.name or name))}</title>",
        "  <description>",
        f"    The vehicles of {escape(printable(path.name))}, with their parameters and initial poses.",
        "  </description>",
        "",
        "  <!-- To do:",
        f"{listed} -->",
        "",
        f'  <simulation horizon="{horizon!r} s" step="{step!r} s" seed="1"/>',
        "",
    ]
    for plant in plants:
        binding = f" binding={quoteattr(plant.binding)}" if plant.binding else ""
        interface = f" interface={quoteattr(plant.interface)}" if plant.interface else ""
        lines.append(f"  <plant id={quoteattr(plant.id)} fmu={quoteattr(plant.file)}{binding}{interface}/>")
    lines += [
        "",
        "  <!-- To do: the control law and its gains; formation list names the laws. -->",
        f'  <controller id="{law.id}" name="{law.name}" package="{law.package}" version="{law.version}">',
        gains,
        "  </controller>",
        "",
        f"  <leader plant={quoteattr(leader.plant)}>",
        f"    {_pose(leader)}",
        f"    {_commands(leader)}",
        *_settings(leader),
        *_inputs(leader),
        "  </leader>",
    ]
    for robot in followers:
        distance, bearing = _seen(robot, leader)
        lines += [
            "",
            f'  <follower id="{robot.id}" plant={quoteattr(robot.plant)} controller="{law.id}">',
            f"    {_pose(robot)}",
            f'    <desired range="{distance:.6g} m" bearing="{math.degrees(bearing):.6g} deg"/> <!-- as it starts -->',
            *_settings(robot),
            *_inputs(robot),
            "  </follower>",
        ]
    return "\n".join([*lines, "", "</scenario>", ""])


def _comment(text: str) -> str:
    return printable(text).replace("--", "- -")


def _pose(robot: _Robot) -> str:
    entries = " ".join(f'{role.name}="{robot.pose[role.name]!r} {role.unit}"' for role in robot.kind.pose)
    return f"<pose {entries}/>"


def _settings(robot: _Robot) -> Iterator[str]:
    for setting, value in robot.settings.items():
        yield f"    <parameter name={quoteattr(setting)} value={quoteattr(value)}/>"


def _inputs(robot: _Robot) -> Iterator[str]:
    for name, value in robot.inputs.items():
        yield f"    <input name={quoteattr(name)}><constant value={quoteattr(value)}/></input>"


def _commands(robot: _Robot) -> str:
    tag = robot.kind.command_word
    entries = " ".join(f'{r.name}="{robot.command.get(r.name, 0.0)!r} {r.unit}"' for r in robot.kind.command)
    return f"<{tag} {entries}/> <!-- to do: what drives the leader -->"


def _seen(robot: _Robot, leader: _Robot) -> tuple[float, float]:
    """Return the range and the bearing at which a robot sees the leader at the start."""
    (x, y, heading), (x_0, y_0) = list(robot.pose.values())[:3], list(leader.pose.values())[:2]
    distance = math.hypot(x_0 - x, y_0 - y)
    bearing = math.atan2(y_0 - y, x_0 - x) - heading
    return max(distance, 0.1), math.remainder(bearing, 2.0 * math.pi)
