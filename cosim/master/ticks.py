"""The ticks of a run: one after the other part by part, or many at once in compiled code, with the same numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import formation_controllers as fc
import numpy as np
from numpy.typing import NDArray

from cosim.compiled import entry_of
from cosim.control.team import Team
from cosim.master.fleets import AnyFleet
from cosim.master.loop import (
    Acting,
    Commanding,
    Ended,
    LawCall,
    Loop,
    Recording,
    Sensing,
    Taking,
    act,
    advance,
    give,
    lead,
    record,
    sense,
)
from cosim.master.recorder import Recorder
from cosim.master.robot import RobotSetup
from cosim.master.setup import Setup
from cosim.master.team_arrays import TeamArrays
from cosim.master.wiring import driving_of, laws_of, path_of
from cosim.scenario.scenario import Scenario
from cosim.signals.actuators import actuators
from cosim.signals.chain import WINDOW
from cosim.signals.sensors import pose_sensors

Floats = NDArray[np.float64]
_Compiled = tuple[Callable[[Loop, tuple[LawCall, ...], int, int], tuple[int, int]], Loop, tuple[LawCall, ...]]


class Ticks:
    """What a tick of a run does: sense, control, actuate, record and step the plants.

    Legal call order: `one` and `some`, in any number, until `tick` is beyond the scenario's last one. After an
    exception none of them.

    Parameters
    ----------
    scenario, setup
        The scenario with its set-up.
    now
        The numbers of all robots.
    teams
        The laws with their followers.
    fleet
        The plants, started.
    recorder
        Gets the records.

    Attributes
    ----------
    tick : int
        The number of the next tick.
    recorder : Recorder
        The records of the ticks so far.
    """

    def __init__(
        self,
        scenario: Scenario,
        setup: Setup,
        now: TeamArrays,
        teams: Sequence[Team],
        fleet: AnyFleet,
        recorder: Recorder,
    ) -> None:
        self.tick = 0
        self.recorder = recorder
        self._scenario, self._setup, self._now, self._teams, self._fleet = scenario, setup, now, tuple(teams), fleet
        robots = (setup.leader, *setup.followers)
        names = [robot.name for robot in robots]
        poses = [[role.name for role in robot.kind.pose] for robot in robots]
        commands = [[role.name for role in robot.kind.command] for robot in setup.followers]
        step = scenario.step
        self._sensors = pose_sensors(scenario.seed, names, poses, [robot.sensor for robot in robots], step)
        self._actuators = actuators(commands, [robot.actuator for robot in setup.followers], step)
        self._sensing = Sensing(now.state, now.measured, self._sensors.arrays)
        external = now.padded([robot.torque for robot in robots])
        disturbed = bool(np.nan_to_num(external[:, 1:]).any())
        self._acting = Acting(now.command, now.torque[1:], now.torque, external, disturbed, self._actuators.arrays)
        self._desired = [[np.ascontiguousarray(part[:, team.place]) for part in setup.desired] for team in teams]
        driven = driven_robots(setup)
        self._driving = driving_of(now, len(robots) - len(driven), driven)
        self._changes: dict[int, list[tuple[int, RobotSetup]]] = {}
        for row, robot in enumerate(driven):
            for tick in robot.changes:
                self._changes.setdefault(tick, []).append((row, robot))
        self._path = path_of(now, setup.leader, setup.motion)
        self._recording, self._telemetry = self._records()
        self._loop: _Compiled | None = None
        lead(self._path, now.state, 0)

    def one(self, override: Mapping[int, Floats], watch: Callable[[int], None]) -> None:
        """Run a tick part by part.

        Parameters
        ----------
        override
            By robot's row, the commands of this tick in place of its own.
        watch
            Called with the tick once it is recorded.

        Raises
        ------
        SimulationError
            A plant or a controller has failed, or the motion has diverged.
        """
        tick, step = self.tick, self._scenario.step
        self._sensors.make_ready(tick)
        sense(self._sensing, tick)
        self._control()
        self._actuators.make_ready(tick)
        self._act(override)
        record(self._recording, tick)
        for team, records in zip(self._teams, self._telemetry, strict=True):
            records[tick] = team.telemetry(tick * step)
        self.recorder.recorded = tick + 1
        watch(tick)
        if tick < self._scenario.ticks:
            for row, robot in self._changes.get(tick, ()):
                self._fleet.change(row, [parameter.as_value for parameter in robot.changes[tick]], tick * step)
            give(self._driving, tick)
            self._fleet.step(tick, step, self._driving.given)
        self.tick += 1
        if self.tick <= self._scenario.ticks:
            lead(self._path, self._now.state, self.tick)

    def some(self, most: int) -> bool:
        """Run up to so many ticks in compiled code; return whether that was possible.

        Raises
        ------
        SimulationError
            As `one`.
        """
        compiled = self._compiled
        first, step, horizon = self.tick, self._scenario.step, self._scenario.ticks
        if first == 0 or first in self._changes or compiled is None:  # at the first tick controllers are started
            return False
        last = min(first + most, first - first % WINDOW + WINDOW, horizon + 1, *(t for t in self._changes if t > first))
        run, loop, laws = compiled
        self._sensors.make_ready(first)
        self._actuators.make_ready(first)
        self.tick, ended = run(loop, laws, first, last)
        self.recorder.recorded = self.tick + (ended == Ended.PLANTS)
        if ended == Ended.PLANTS:
            self._fleet.settle(self.tick, step, int(loop.fleet.found[0]))
        self._fleet.settle(min(self.tick, horizon) - 1, step, 0)  # at the horizon no plant is stepped
        if ended == Ended.COMMANDS:
            self._raise_not_finite()
        if ended in (Ended.INPUTS, Ended.RAISED):
            self._control()  # says why
            raise RuntimeError("the compiled code of a controller has failed, which its Python code does not")
        return True

    def _control(self) -> None:
        if self.tick % self._scenario.period:
            return  # the commands are held
        motion, tick = self._setup.motion, self.tick
        acceleration = None if motion is None else motion.acceleration[tick]
        now, told = self._now, self._now.told_of_the_leader()
        for team, (q, q_dot, q_ddot) in zip(self._teams, self._desired, strict=True):
            now.command[team.commands] = team.step(
                tick * self._scenario.step,
                now.measured[1:],
                now.velocity[1:],
                told,
                acceleration,
                fc.Desired(q[tick], q_dot[tick], q_ddot[tick]),
                first=tick == 0,
            )

    def _raise_not_finite(self) -> None:
        for team in self._teams:
            command = self._now.command[team.commands]
            if not np.isfinite(command).all():
                raise team.not_finite(command, self.tick * self._scenario.step)

    def _act(self, override: Mapping[int, Floats]) -> None:
        """Let the commands act, some of this tick alone: those of the controllers may be held longer."""
        if not override:
            act(self._acting, self.tick)
            return
        command, leader = self._now.command, self._acting.external[self.tick, 0]
        held = command.copy(), leader.copy()
        for row, own in override.items():
            (command[row - 1] if row else leader)[:] = own
        act(self._acting, self.tick)
        command[:], leader[:] = held

    def _records(self) -> tuple[Recording, list[Floats]]:
        """Prepare the records, and fill in the values known before the run."""
        recorder, now, desired = self.recorder, self._now, self._setup.desired
        recorder.of("desired_range")[:] = desired.q[..., 0]
        recorder.of("desired_bearing")[:] = desired.q[..., 1]
        telemetry = [recorder.records_of(team.rows, team.telemetry_type) for team in self._teams]
        state, measured, torque = map(recorder.place_of, (now.state, now.measured, now.torque))
        commands = self._setup.columns.commands
        pose, velocity = np.split(state, [now.pose.shape[1]], axis=-1)
        for name, place in {
            "leader_pose": pose[:, 0],
            "leader_velocity": velocity[:, 0],
            f"leader_{commands}": torque[:, 0],
            "pose": pose[:, 1:],
            "velocity": velocity[:, 1:],
            "measured_pose": measured[:, 1:],
            "measured_leader_pose": measured[:, 0],
            commands: torque[:, 1:],
        }.items():
            if name in recorder.variables:
                recorder.keep(name, place)
        return Recording(now.state, now.measured, now.torque, state, measured, torque), telemetry

    @cached_property
    def _laws(self) -> tuple[tuple[LawCall, ...], Taking, Commanding] | None:
        return laws_of(self._teams, self._now, self._setup.desired, self._setup.motion, self._telemetry)

    @property
    def _compiled(self) -> _Compiled | None:
        """The compiled loop, and its arguments; None while Python has a share in every tick."""
        if self._loop is None and self._laws is not None and (fleet := self._fleet.compiled()) is not None:
            laws, taking, commanding = self._laws
            scenario = self._scenario
            loop = Loop(
                step=scenario.step,
                ticks=scenario.ticks,
                period=scenario.period,
                sensing=self._sensing,
                taking=taking,
                commanding=commanding,
                acting=self._acting,
                recording=self._recording,
                driving=self._driving,
                path=self._path,
                fleet=fleet,
            )
            self._loop = entry_of(advance, loop, laws, 0, 0), loop, laws
        return self._loop


def driven_robots(setup: Setup) -> tuple[RobotSetup, ...]:
    """Return the robots that are plants: all, but for a leader whose motion is given."""
    return setup.followers if setup.motion is not None else (setup.leader, *setup.followers)
