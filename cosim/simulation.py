"""The master: every communication step it senses, controls, actuates, records and steps the plants."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

import formation_controllers as fc
import numpy as np
import xarray as xr

import plants
from cosim.contract import Contract
from cosim.errors import InputError, RunInterrupted, SimulationError
from cosim.fmu import Fmu, open_fmu
from cosim.plant import Plant
from cosim.recorder import Channel, Recorder
from cosim.result import dataset
from cosim.scenario import LEADER, PlantSource, Scenario
from cosim.sensing import PoseSensor
from cosim.summary import check_expectations
from cosim.team import Team

DIVERGED = 1e6
"""A pose entry or velocity beyond this magnitude [m, rad, m/s, rad/s] is taken for divergence."""


class Simulation:
    """A scenario in the course of being run.

    Legal call order: `step` until `finished`, or `run`; `result` at any time; `close` at the end (or use ``with``).

    Parameters
    ----------
    scenario
        What to run. Built-in plants are built into FMUs here if they are not in the cache.

    Raises
    ------
    InputError
        The scenario asks for something that does not exist or does not fit.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.tick = 0
        self.timing: dict[str, float] = {}
        n = len(scenario.followers)
        self._state = np.zeros((1 + n, 6))  # row 0 is the leader; pose and pseudo-velocities
        self._measured = np.zeros((n, 4))
        self._command = np.zeros((n, 2))
        self._torque = np.zeros((1 + n, 2))
        self._torque[0] = scenario.leader.torque
        desired = np.array([follower.desired for follower in scenario.followers])
        self._desired = fc.Desired(desired, np.zeros_like(desired), np.zeros_like(desired))
        with ExitStack() as cleanup:
            self._fmus = self._open_fmus(cleanup)
            self.contract = self._shared_contract()
            self._plants = self._start_plants(cleanup)
            self._teams = self._gather_teams()
            robots = [follower.id for follower in scenario.followers]
            channels = [role.name for role in self.contract.pose]
            self._sensor = PoseSensor(scenario.seed, robots, channels, scenario.noise)
            self._recorder = self._new_recorder()
            check_expectations(scenario.expectations, self._units_of_signals())
            self._cleanup = cleanup.pop_all()

    # The five steps of a tick ------------------------------------------------------------------------------

    def step(self) -> None:
        """Run one tick: sense, control, actuate, record, and step the plants (but at the horizon, the end).

        Raises
        ------
        SimulationError
            A plant or a controller failed or the motion diverged: the robot, the time and `result` up to then.
        """
        if self.finished:
            raise InputError(f"the run has ended at its horizon of {self.scenario.horizon:g} s")
        try:
            self._sense()
            self._control()
            self._actuate()
            self._record()
            if self.tick < self.scenario.ticks:
                self._step_plants()
        except SimulationError as error:
            error.result = self.result()
            raise
        self.tick += 1

    def _sense(self) -> None:
        for plant, state in zip(self._plants, self._state, strict=True):
            plant.read(self.time, state)
        if not (np.abs(self._state) < DIVERGED).all():  # not finite is not smaller
            self._report_divergence()
        self._sensor.measure(self.tick, self._state[1:, :4], self._measured)

    def _control(self) -> None:
        leader = fc.Leader(self._state[0, :4], self._state[0, 4:])
        for team in self._teams:
            self._command[team.rows] = team.step(self.time, self._measured, leader, self._desired, first=self.tick == 0)

    def _actuate(self) -> None:
        limit = self.scenario.saturation
        np.clip(self._command, -limit, limit, out=self._torque[1:])

    def _record(self) -> None:
        row = self._recorder.row
        k = self.tick
        row("leader_pose", k)[:] = self._state[0, :4]
        row("leader_velocity", k)[:] = self._state[0, 4:]
        row("leader_torque", k)[:] = self._torque[0]
        row("pose", k)[:] = self._state[1:, :4]
        row("velocity", k)[:] = self._state[1:, 4:]
        row("measured_pose", k)[:] = self._measured
        row("torque", k)[:] = self._torque[1:]
        row("desired_range", k)[:] = self._desired.q[:, 0]
        row("desired_bearing", k)[:] = self._desired.q[:, 1]
        for team in self._teams:
            for name, values in team.controller.telemetry().items():
                row(name, k)[team.rows] = values
        self._recorder.recorded = k + 1

    def _step_plants(self) -> None:
        for plant, torque in zip(self._plants, self._torque, strict=True):
            plant.step(self.time, self.scenario.step, torque)

    def _report_divergence(self) -> None:
        row, column = (int(i) for i in np.argwhere(~(np.abs(self._state) < DIVERGED))[0])
        role = (*self.contract.pose, *self.contract.velocity)[column]
        value = self._state[row, column]
        raise SimulationError(
            self._plants[row].robot,
            self.time,
            f"the motion has diverged: {role.name} = {value:.4g} {role.unit}",
        )

    # The whole run -----------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """The communication point [s] of the next tick: the tick's number times the step, never a running sum."""
        return self.tick * self.scenario.step

    @property
    def finished(self) -> bool:
        """Whether the sample at the horizon is recorded."""
        return self.tick > self.scenario.ticks

    def run(self, progress: Callable[[int], None] | None = None) -> xr.Dataset:
        """Run to the horizon and return the result.

        Parameters
        ----------
        progress
            Called with the tick before each tick.

        Raises
        ------
        SimulationError
            See `step`.
        RunInterrupted
            The user pressed Ctrl-C.
        """
        started = time.perf_counter()
        try:
            while not self.finished:
                if progress:
                    progress(self.tick)
                self.step()
        except KeyboardInterrupt:
            raise RunInterrupted(self.time, self.result()) from None
        finally:
            self.timing["loop"] = time.perf_counter() - started
        return self.result()

    def result(self) -> xr.Dataset:
        """Return everything recorded so far; see `cosim.result.dataset`."""
        return dataset(self.scenario, self.contract, self._recorder, self._teams, self._fmus)

    def close(self) -> None:
        """End all plant instances and remove what was unpacked."""
        self._cleanup.close()

    def __enter__(self) -> Self:
        """Return the simulation; it is closed at the end of the block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    # Setting up --------------------------------------------------------------------------------------------

    def _open_fmus(self, cleanup: ExitStack) -> dict[str, Fmu]:
        used = {self.scenario.leader.plant, *(follower.plant for follower in self.scenario.followers)}
        fmus = {}
        for source in self.scenario.plants.values():
            if source.id not in used:
                continue
            with self._timed("build"):
                path = _fmu_path(source)
            with self._timed("load"):
                fmus[source.id] = open_fmu(path, source.where)
            cleanup.callback(fmus[source.id].close)
        return fmus

    def _shared_contract(self) -> Contract:
        contracts = {fmu.binding.contract.vehicle: fmu.binding.contract for fmu in self._fmus.values()}
        if len(contracts) > 1:
            raise InputError(f"a formation of different vehicles ({', '.join(contracts)}) is not possible yet")
        return next(iter(contracts.values()))

    def _start_plants(self, cleanup: ExitStack) -> list[Plant]:
        scenario = self.scenario
        robots = [(LEADER, scenario.leader.plant, scenario.leader.pose)]
        robots += [(follower.id, follower.plant, follower.pose) for follower in scenario.followers]
        started = []
        with self._timed("load"):
            for robot, source, pose in robots:
                plant = Plant(self._fmus[source], robot, scenario.plants[source].parameters, pose, scenario.horizon)
                cleanup.callback(plant.close)
                started.append(plant)
        return started

    def _gather_teams(self) -> list[Team]:
        groups: dict[tuple[str, str], list[int]] = {}
        for row, follower in enumerate(self.scenario.followers):
            groups.setdefault((follower.controller, follower.plant), []).append(row)
        teams = []
        with self._timed("controllers"):
            for (controller, _), rows in groups.items():
                source = self.scenario.controllers[controller]
                try:
                    vehicle = fc.CarLike(**self._plants[1 + rows[0]].geometry())
                except fc.ControllerError as error:
                    raise InputError(str(error), source.where) from None
                robots = [self.scenario.followers[row].id for row in rows]
                teams.append(Team(source, robots, rows, vehicle, self.scenario.step))
        return teams

    def _new_recorder(self) -> Recorder:
        n = len(self.scenario.followers)
        channels: dict[str, tuple[Channel, tuple[int, ...]]] = {}

        def add(name: str, dims: tuple[str, ...], shape: tuple[int, ...], units: str, long_name: str) -> None:
            channels[name] = (Channel(name, dims, units, long_name), shape)

        pose, velocity, torque = (
            ", ".join(role.unit for role in roles)
            for roles in (self.contract.pose, self.contract.velocity, self.contract.torque)
        )
        add("leader_pose", ("pose_component",), (4,), pose, "pose of the virtual leader")
        add(
            "leader_velocity",
            ("velocity_component",),
            (2,),
            velocity,
            "pseudo-velocities of the virtual leader",
        )
        add("leader_torque", ("torque_component",), (2,), torque, "torque that drives the virtual leader")
        add("pose", ("robot", "pose_component"), (n, 4), pose, "pose")
        add("velocity", ("robot", "velocity_component"), (n, 2), velocity, "pseudo-velocities")
        add("measured_pose", ("robot", "pose_component"), (n, 4), pose, "pose as measured")
        add("torque", ("robot", "torque_component"), (n, 2), torque, "torque as applied")
        add("desired_range", ("robot",), (n,), "m", "desired range")
        add("desired_bearing", ("robot",), (n,), "rad", "desired bearing")
        for team in self._teams:
            for signal in team.controller.signals:
                parts = signal.components
                dims = ("robot", f"{signal.name}_component") if parts else ("robot",)
                add(signal.name, dims, (n, len(parts)) if parts else (n,), signal.unit, signal.description)
        return Recorder(
            self.scenario.ticks + 1,
            [channel for channel, _ in channels.values()],
            [s for _, s in channels.values()],
        )

    def _units_of_signals(self) -> dict[str, str]:
        """Return the unit of every signal of the result that has one value a robot and time."""
        units = {c.name: c.units for c in self._recorder.channels.values() if c.dims == ("robot",)}
        return units | {"range": "m", "bearing": "rad", "range_error": "m", "bearing_error": "rad"}

    @contextmanager
    def _timed(self, part: str) -> Iterator[None]:
        started = time.perf_counter()
        try:
            yield
        finally:
            self.timing[part] = self.timing.get(part, 0.0) + time.perf_counter() - started


def _fmu_path(source: PlantSource) -> Path:
    if source.fmu is not None:
        return source.fmu
    assert source.model is not None
    try:
        return plants.build(source.model)
    except plants.PlantError as error:
        raise InputError(str(error), source.where) from None
