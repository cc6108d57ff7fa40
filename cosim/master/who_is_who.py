"""Who is who in a result: kind, geometry, outline and plant of every robot, components, and the FMUs' messages.

All of it is coordinates, variables that describe others: texts and numbers with units, so that a file explains itself.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from cosim.fmu.vehicle import Fmu
from cosim.master.robot import RobotSetup
from cosim.plant.message import RobotMessage
from cosim.results import outlines
from cosim.results.result import Variable
from cosim.scenario.scenario import Scenario
from cosim.vehicle.columns import Columns, run_columns
from cosim.vehicle.kind import Kind, Role

Coordinates = dict[str, Variable]

_PLANT: Mapping[str, tuple[str, Callable[[Scenario, str, Fmu], str]]] = {
    "plant_model": ("built-in model; empty for a file", lambda scenario, name, _: scenario.plants[name].model or ""),
    "plant_file": ("file of the FMU", lambda _, __, fmu: fmu.path.name),
    "plant_sha256": ("SHA-256 of that file", lambda _, __, fmu: fmu.sha256),
    "plant_fmi_version": ("version of FMI", lambda _, __, fmu: fmu.description.fmiVersion),
    "plant_interface": ("co_simulation or model_exchange", lambda _, __, fmu: fmu.interface),
    "plant_tool": ("tool that made the FMU", lambda _, __, fmu: fmu.description.generationTool or ""),
}

_MESSAGE: Mapping[str, tuple[str, Callable[[RobotMessage], str]]] = {
    "message_robot": ("robot whose FMU logged the message", lambda entry: entry.robot),
    "message_status": ("FMI status of the message", lambda entry: entry.message.status),
    "message_category": ("category of the message, as the FMU names it", lambda entry: entry.message.category),
    "message_text": ("text of the message", lambda entry: entry.message.text),
}

_OWN = re.compile(
    "vehicle|vehicle_.*|plant|message|message_time|message_count|(pose|velocity|torque|command)_(name|meaning)"
)


def is_taken(name: str) -> bool:
    """Return whether a name in a result is for who is who, so that no signal of a controller can have it."""
    return _OWN.fullmatch(name) is not None or name in _PLANT or name in _MESSAGE or outlines.is_taken(name)


def who_is_who(
    scenario: Scenario, robots: Sequence[RobotSetup], fmus: Mapping[str, Fmu], messages: Sequence[RobotMessage]
) -> Coordinates:
    """Return the coordinates that say who is who.

    Parameters
    ----------
    scenario
        The scenario.
    robots
        The leader and the followers.
    fmus
        The FMU of each plant, by its id.
    messages
        The FMUs' messages.
    """
    drawn = outlines.coordinates_of({robot.name: robot.outline for robot in robots})
    return {**_vehicles(robots), **drawn, **_components(robots), **_plants(scenario, fmus), **_messages(messages)}


def _vehicles(robots: Sequence[RobotSetup]) -> Coordinates:
    found: Coordinates = {
        "vehicle": texts("vehicle", [robot.name for robot in robots], "leader and followers"),
        "vehicle_kind": texts("vehicle", [robot.kind.name for robot in robots], "kind of vehicle"),
        "vehicle_plant": texts("vehicle", [robot.source.id for robot in robots], "plant of the vehicle"),
    }
    for name, (fields, role) in _geometry(robots).items():
        values = [
            getattr(robot.vehicle, fields[robot.kind.name]) if robot.kind.name in fields else None for robot in robots
        ]
        if role.unit:
            numbers = np.array([np.nan if value is None else value for value in values], dtype=np.float64)
            found[name] = Variable(("vehicle",), numbers, {"units": role.unit, "long_name": role.meaning})
        else:
            found[name] = texts("vehicle", ["" if value is None else str(value) for value in values], role.meaning)
    return found


def _components(robots: Sequence[RobotSetup]) -> Coordinates:
    """Return unit, name and meaning of each component; the latter two differ from kind to kind."""
    found: Coordinates = {}
    columns = run_columns([robot.kind for robot in robots])
    for group, roles, shared in (
        ("pose", "pose", columns.pose),
        ("velocity", "velocity", columns.velocity),
        (columns.commands, "command", columns.command),
    ):
        dim = f"{group}_component"
        found[f"{dim}_units"] = texts(dim, shared.units, f"unit of each component of a {group}")
        for fact in ("name", "meaning"):
            table = [_row(robot.kind, roles, shared, fact) for robot in robots]
            long_name = f"{fact} of each component of a {group}; empty where the vehicle has none"
            found[f"{group}_{fact}"] = Variable(
                ("vehicle", dim), np.array(table, dtype=np.str_), {"long_name": long_name}
            )
    return found


def _row(kind: Kind, roles: str, shared: Columns, fact: str) -> list[str]:
    """Return a fact on each entry of a kind, in the columns that it shares with others."""
    row = [""] * len(shared.labels)
    for role, place in zip(getattr(kind, roles), shared.of[kind.name], strict=True):
        row[place] = getattr(role, fact)
    return row


def _geometry(robots: Sequence[RobotSetup]) -> dict[str, tuple[dict[str, str], Role]]:
    """Return by the name in the result the geometry's field of each kind that has it, and its meaning.

    Kinds share a name if they state the same quantity in the same unit.
    """
    found: dict[str, tuple[dict[str, str], Role]] = {}
    for robot in robots:
        for field, role in robot.kind.geometry.items():
            name = f"vehicle_{field}"
            if name in found and found[name][1].unit != role.unit:
                name = f"{name}_of_{robot.kind.name}"
            fields, _ = found.setdefault(name, ({}, role))
            fields[robot.kind.name] = field
    return found


def _plants(scenario: Scenario, fmus: Mapping[str, Fmu]) -> Coordinates:
    found = {"plant": texts("plant", list(fmus), "plants, by their ids in the scenario")}
    for name, (about, fact) in _PLANT.items():
        found[name] = texts("plant", [fact(scenario, plant, fmu) for plant, fmu in fmus.items()], about)
    return found


def _messages(messages: Sequence[RobotMessage]) -> Coordinates:
    times = np.array([entry.time for entry in messages], dtype=np.float64)
    counts = np.array([entry.message.count for entry in messages], dtype=np.int64)
    found: Coordinates = {
        "message_time": Variable(
            ("message",), times, {"units": "s", "long_name": "communication point of the message"}
        ),
        "message_count": Variable(
            ("message",), counts, {"units": "1", "long_name": "how many times the message came in succession"}
        ),
    }
    for name, (about, fact) in _MESSAGE.items():
        found[name] = texts("message", [fact(entry) for entry in messages], about)
    return found


def texts(dim: str, values: Sequence[str], about: str = "") -> Variable:
    """Return a variable of texts along a dimension, with a description if there is one."""
    return Variable((dim,), np.array(values, dtype=np.str_), {"long_name": about} if about else {})
