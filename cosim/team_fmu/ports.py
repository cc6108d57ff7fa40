"""The variables of a team's FMU: poses in, commands and telemetry out, gains as parameters."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

import formation_controllers as fc
import numpy as np
from formation_controllers.gains import GainInfo, gain_info, gain_records

from cosim.control.team import Team
from cosim.master.robot import RobotSetup
from cosim.scenario.scenario import LEADER
from plants import units
from plants.sampled import Port


def state_inputs(robot: RobotSetup, *, velocities: bool, accelerations: bool = False) -> Iterator[Port]:
    """Yield the inputs of a robot: its pose, and its velocities and their rates where they are needed."""
    whose = "the leader" if robot.name == LEADER else robot.name
    for role, start in zip(robot.kind.pose, robot.pose, strict=True):
        yield Port(f"{robot.name}.{role.name}", role.unit, f"True pose of {whose}: {role.meaning}", start=float(start))
    for role in robot.kind.velocity if velocities else ():
        yield Port(f"{robot.name}.{role.name}", role.unit, f"Velocity of {whose}: {role.meaning}")
    for role in robot.kind.velocity if accelerations else ():
        unit = units.per_second(role.unit)
        yield Port(f"{robot.name}.der_{role.name}", unit, f"Acceleration of {whose}: the rate of {role.name}")


def command_outputs(robot: RobotSetup, depends: tuple[str, ...]) -> Iterator[Port]:
    """Yield the outputs of a robot's actuators."""
    for role in robot.kind.command:
        text = f"What the actuators of {robot.name} give to its plant: {role.meaning}"
        yield Port(f"{robot.name}.{role.name}", role.unit, text, depends=depends)


def telemetry_outputs(team: Team, robot: str, depends: tuple[str, ...]) -> Iterator[tuple[Port, str]]:
    """Yield the signals of a team's law for a robot, each with its place in the telemetry record."""
    for signal in team.law.signals:
        for index, component in enumerate(signal.components or [""]):
            at = f"[{index + 1}]" if component else ""
            text = f"{signal.description}, {component}" if component else signal.description
            port = Port(f"{robot}.{signal.name}{at}", _known(signal.unit), sentence(text), depends=depends)
            yield port, f"{signal.name}[{index}]" if component else signal.name


def gain_parameters(own: fc.Gains, robot: str) -> Iterator[tuple[Port, str]]:
    """Yield the gains of a robot that can be parameters, each with its place in the record of gains.

    An infinite gain is none: a number of FMI is finite. It stays as the scenario has it.
    """
    record = gain_records([own])
    for name, info in gain_info(type(own)).items():
        for port, index in gain_ports(name, info, record[name][0], robot, tunable=True):
            yield port, name + "".join(f"[{i}]" for i in index)


def gain_ports(
    name: str, info: GainInfo, values: Any, robot: str, *, tunable: bool
) -> Iterator[tuple[Port, tuple[int, ...]]]:
    """Yield the entries of a gain that can be parameters, each with its place."""
    for index in np.ndindex(np.shape(values)):
        start = float(np.asarray(values)[index])
        if not math.isfinite(start):
            continue
        at = "".join(f"[{i + 1}]" for i in index)
        low = info.above if info.above is not None else info.at_least
        yield (
            Port(
                f"{robot}.{name}{at}",
                _known(info.unit if info.size != 2 or index == (0,) else _of_bearing(info.unit)),
                sentence(f"Gain {info.symbol} of {robot}: {info.description}"),
                start=start,
                min=-math.inf if low is None else low,
                max=math.inf if info.below is None else info.below,
                above=info.above is not None,
                below=info.below is not None,
                tunable=tunable,
            ),
            index,
        )


def _known(unit: str) -> str:
    return unit if units.is_unit(unit) else ""


def _of_bearing(unit: str) -> str:
    """Return the unit of the bearing's component of a gain, from that of the range's."""
    return re.sub("[A-Za-z]+", lambda symbol: {"m": "rad", "N": "N.m"}.get(symbol.group(), symbol.group()), unit)


def sentence(text: str) -> str:
    """Return a description that begins with a capital letter."""
    return text[:1].upper() + text[1:]
