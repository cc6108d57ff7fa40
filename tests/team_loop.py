"""A small master of FMPy's instances that closes the loop of plant FMUs and the FMUs of controllers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fmpy
import fmpy.fmi2
import fmpy.fmi3
import numpy as np
import xarray as xr

import plants
from cosim.master.robot import RobotSetup
from cosim.master.setup import Setup, set_up
from cosim.scenario.scenario import LEADER, Scenario
from cosim.team_fmu import build_team_fmu


@dataclass(frozen=True)
class Made:
    """A scenario with its controllers as FMUs."""

    scenario: Scenario
    setup: Setup
    fmus: tuple[Path, ...]
    fmi: str


def make_fmus(scenario: Scenario, cleanup: ExitStack, folder: Path, fmi: str = "2.0") -> Made:
    """Build the FMUs of a scenario's controllers into a folder."""
    setup = set_up(scenario, cleanup, {})
    ids = dict.fromkeys(follower.controller for follower in scenario.followers)
    return Made(scenario, setup, tuple(build_team_fmu(scenario, setup, own, folder, fmi=fmi) for own in ids), fmi)


class Slave:
    """An instance of an FMU, whose variables go by their names."""

    def __init__(self, path: Path, folder: Path, name: str) -> None:
        fmpy.extract(path, folder)
        description = fmpy.read_model_description(folder)
        self.variables = {v.name: v for v in description.modelVariables}
        self.is_2 = description.fmiVersion == "2.0"
        made = fmpy.fmi2.FMU2Slave if self.is_2 else fmpy.fmi3.FMU3Slave
        self.fmu = made(
            instanceName=name,
            guid=description.guid if self.is_2 else description.instantiationToken,
            unzipDirectory=str(folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
        )
        self.fmu.instantiate()

    def set(self, values: Mapping[str, Any]) -> None:
        reals = {n: float(v) for n, v in values.items() if self.variables[n].type in ("Real", "Float64")}
        wholes = {n: int(v) for n, v in values.items() if n not in reals}
        for chosen, write in (
            (reals, self.fmu.setReal if self.is_2 else self.fmu.setFloat64),
            (wholes, self.fmu.setInteger if self.is_2 else self.fmu.setInt64),
        ):
            if chosen:
                write([self.variables[name].valueReference for name in chosen], list(chosen.values()))

    def get(self, names: list[str]) -> list[float]:
        references = [self.variables[name].valueReference for name in names]
        return list((self.fmu.getReal if self.is_2 else self.fmu.getFloat64)(references))

    def begin(self) -> None:
        if self.is_2:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()

    def start(self) -> None:
        self.begin()
        self.fmu.exitInitializationMode()

    def step(self, time: float, step: float) -> None:
        self.fmu.doStep(time, step)

    def close(self) -> None:
        self.fmu.terminate()
        self.fmu.freeInstance()


def slaves(made: Made, folder: Path) -> list[Slave]:
    """Return an instance of each controller's FMU, unpacked in a folder."""
    return [Slave(fmu, folder / f"team_{k}", f"team_{k}") for k, fmu in enumerate(made.fmus)]


def _plant(robot: RobotSetup, fmi: str, folder: Path) -> Slave:
    model = robot.source.model
    path = robot.fmu.path if model is None else plants.build(model, fmi=fmi)
    slave = Slave(path, folder / robot.name, robot.name)
    for parameter in robot.parameters:
        slave.set({parameter.variable.name: parameter.value})
    slave.set({role.name: value for role, value in zip(robot.kind.pose, robot.pose, strict=True)})
    slave.start()
    return slave


def closed_loop(made: Made, teams: list[Slave], folder: Path, ticks: int) -> dict[str, np.ndarray]:
    """Run a scenario of built-in plants tick by tick: set poses, get commands, step all.

    The outputs of the teams and the states of the robots, by ``robot.variable``, one sample a tick.
    """
    setup, step, motion = made.setup, made.scenario.step, made.setup.motion
    driven = setup.followers if motion is not None else (setup.leader, *setup.followers)
    plants = {robot.name: _plant(robot, made.fmi, folder) for robot in driven}
    for team in teams:
        team.start()
    outputs = [[v.name for v in team.variables.values() if v.causality == "output"] for team in teams]
    inputs = [{v.name for v in team.variables.values() if v.causality == "input"} for team in teams]
    names = [name for own in outputs for name in own]
    samples: dict[str, list[float]] = {name: [] for name in names}
    for tick in range(ticks + 1):
        state: dict[str, float] = {}
        if motion is not None:
            roles = (*setup.leader.kind.pose, *setup.leader.kind.velocity)
            state |= {f"{LEADER}.{r.name}": x for r, x in zip(roles, motion.state[tick].tolist(), strict=True)}
            rates = zip(setup.leader.kind.velocity, motion.acceleration[tick].tolist(), strict=True)
            state |= {f"{LEADER}.der_{role.name}": rate for role, rate in rates}
        for robot in driven:
            own = [role.name for role in (*robot.kind.pose, *robot.kind.velocity)]
            state |= {f"{robot.name}.{name}": x for name, x in zip(own, plants[robot.name].get(own), strict=True)}
        commands: dict[str, float] = {}
        for team, out, taken in zip(teams, outputs, inputs, strict=True):
            team.set({name: value for name, value in state.items() if name in taken})
            commands |= dict(zip(out, team.get(out), strict=True))
        for name, value in (commands | state).items():
            samples.setdefault(name, []).append(value)
        if tick == ticks:
            break
        for robot in driven:
            slave = plants[robot.name]
            for parameter in robot.changes.get(tick, ()):
                slave.set({parameter.variable.name: parameter.value})
            given = (
                dict(zip([role.name for role in robot.kind.command], robot.torque[tick].tolist(), strict=True))
                if robot.name == LEADER
                else {role.name: commands[f"{robot.name}.{role.name}"] for role in robot.kind.command}
            )
            others = zip(robot.inputs, robot.samples[tick].tolist(), strict=True)
            slave.set(given | {bound.role.name: value for bound, value in others})
            slave.step(tick * step, step)
        for team in teams:
            team.step(tick * step, step)
    for slave in (*plants.values(), *teams):
        slave.close()
    return {name: np.array(values) for name, values in samples.items()}


def courses(
    result: dict[str, np.ndarray], dataset: xr.Dataset, setup: Setup
) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield name, values and those of a run of ours for all poses, and commands and telemetry of the followers."""
    for column, role in enumerate(setup.leader.kind.pose):
        name = f"{LEADER}.{role.name}"
        yield name, result[name], dataset["leader_pose"].values[:, column]
    for row, robot in enumerate(setup.followers):
        for variable, roles in ("pose", robot.kind.pose), (setup.columns.commands, robot.kind.command):
            for column, role in enumerate(roles):
                name = f"{robot.name}.{role.name}"
                yield name, result[name], dataset[variable].values[:, row, column]
        for variable in dataset.data_vars:
            name = f"{robot.name}.{variable}"
            if name in result and dataset[variable].ndim == 2:
                yield name, result[name], dataset[variable].values[:, row]
