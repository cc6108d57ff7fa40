"""The master: every communication step it senses, controls, actuates, records and steps the plants."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, nullcontext
from types import TracebackType
from typing import Self

import formation_controllers as fc
import numpy as np
import xarray as xr

from cosim.errors import InputError, RunInterrupted, SimulationError
from cosim.interrupt import HeldSignals
from cosim.plant import Plant
from cosim.recorder import Recorder
from cosim.result import dataset
from cosim.scenario import LEADER, Scenario
from cosim.sensing import PoseSensor
from cosim.setup import set_up
from cosim.team import Team
from cosim.timing import timed

DIVERGED_POSE = 1e9
"""A pose entry beyond this magnitude [m, rad] is taken for divergence."""
DIVERGED_VELOCITY = 1e6
"""A pseudo-velocity beyond this magnitude [m/s, rad/s] is taken for divergence."""

_BOUNDS = np.array([DIVERGED_POSE] * 4 + [DIVERGED_VELOCITY] * 2)


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
            self.setup = set_up(scenario, cleanup, self.timing)
            self._plants = self._start_plants(cleanup)
            self._teams = self._gather_teams()
            robots = [follower.id for follower in scenario.followers]
            channels = [role.name for role in self.setup.contract.pose]
            self._sensor = PoseSensor(scenario.seed, robots, channels, scenario.noise)
            self._recorder = Recorder(scenario.ticks + 1, self.setup.channels)
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
        except Exception as error:  # a fault of ours must not lose what was computed either
            failure = SimulationError("the master", self.time, f"{type(error).__name__}: {error}")
            failure.result = self.result()
            raise failure from error
        self.tick += 1

    def _sense(self) -> None:
        for plant, state in zip(self._plants, self._state, strict=True):
            plant.read(self.time, state)
        if not (np.abs(self._state) < _BOUNDS).all():  # not finite is not smaller
            self._report_divergence()
        self._sensor.measure(self.tick, self._state[1:, :4], self._measured)

    def _control(self) -> None:
        leader = fc.Leader(self._state[0, :4], self._state[0, 4:])
        for team in self._teams:
            self._command[team.rows] = team.step(
                self.time, self._measured, self._state[1:, 4:], leader, self._desired, first=self.tick == 0
            )

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
            for name, values in team.telemetry(self.time).items():
                row(name, k)[team.rows] = values
        self._recorder.recorded = k + 1

    def _step_plants(self) -> None:
        for plant, torque in zip(self._plants, self._torque, strict=True):
            plant.step(self.time, self.scenario.step, torque)

    def _report_divergence(self) -> None:
        row, column = (int(i) for i in np.argwhere(~(np.abs(self._state) < _BOUNDS))[0])
        role = (*self.setup.contract.pose, *self.setup.contract.velocity)[column]
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
        with HeldSignals(patience=1) as signals, timed(self.timing, "loop"):
            try:
                while not self.finished and not signals.received:
                    if progress:
                        progress(self.tick)
                    with timed(self.timing, "first tick") if self.tick == 0 else nullcontext():
                        self.step()
            except KeyboardInterrupt:
                signals.received += 1
            result = self.result()
        if signals.received:
            raise RunInterrupted(self.time, result)
        return result

    def result(self) -> xr.Dataset:
        """Return everything recorded so far; see `cosim.result.dataset`."""
        messages = [f"{plant.robot}, {message}" for plant in self._plants for message in plant.messages]
        return dataset(self.scenario, self.setup, self._recorder, self._teams, messages)

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

    def _start_plants(self, cleanup: ExitStack) -> list[Plant]:
        scenario = self.scenario
        robots = [(LEADER, scenario.leader.plant, scenario.leader.pose)]
        robots += [(follower.id, follower.plant, follower.pose) for follower in scenario.followers]
        started = []
        with timed(self.timing, "load"):
            for robot, source, pose in robots:
                fmu, parameters = self.setup.fmus[source], self.setup.parameters[source]
                plant = Plant(fmu, robot, parameters, pose, scenario.horizon, scenario.plants[source].where)
                cleanup.callback(plant.close)
                started.append(plant)
        return started

    def _gather_teams(self) -> list[Team]:
        groups: dict[tuple[str, str], list[int]] = {}
        for row, follower in enumerate(self.scenario.followers):
            groups.setdefault((follower.controller, follower.plant), []).append(row)
        teams = []
        with timed(self.timing, "controllers"):
            for (controller, _), rows in groups.items():
                law = self.setup.laws[controller]
                try:
                    vehicle = fc.CarLike(**self._plants[1 + rows[0]].geometry())
                except fc.ControllerError as error:
                    raise InputError(str(error), law.source.where) from None
                robots = [self.scenario.followers[row].id for row in rows]
                teams.append(Team(law, robots, rows, vehicle, self.scenario.step))
        return teams
