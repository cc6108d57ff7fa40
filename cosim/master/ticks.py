"""The ticks of a run: one after the other part by part, or many at once in compiled code, with the same numbers."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Callable, Mapping, Sequence

import formation_controllers as fc
import numpy as np
from numpy.typing import NDArray

from cosim.compiled import entry_of
from cosim.control.team import Team
from cosim.errors import InputError
from cosim.master.fleets import AnyFleet
from cosim.master.loop import Ended, Loop, Part, Stage, Wiring, advance
from cosim.master.moves import spots, spots_by_tick
from cosim.master.recorder import Recorder
from cosim.master.robot import RobotSetup
from cosim.master.run_state import NUMBERS, RunState
from cosim.master.setup import Setup
from cosim.master.team_arrays import TeamArrays
from cosim.master.wiring import wire_acting, wire_laws, wire_path, wire_plants
from cosim.plant.fleet_step import NO_FLEET, CompiledFleet
from cosim.scenario.scenario import Scenario
from cosim.signals.actuators import actuators
from cosim.signals.chain import Chain
from cosim.signals.sensors import pose_sensors
from cosim.storage import fill

Floats = NDArray[np.float64]


class Ticks:
    """What a tick of a run does: sense, control, actuate, record and step the plants.

    Legal call order: `restore` at first, if at all; `one`, `some` and `saved`, in any number, until `tick` is beyond
    the scenario's last one. After an exception none of them.

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
    before
        The ticks of an earlier run that has ended, with robots of the same kinds: its wiring is taken over if all
        numbers are where they were.

    Attributes
    ----------
    tick : int
        The number of the next tick.
    recorder : Recorder
        The records of the ticks so far.
    given : dict
        As in a `cosim.master.run_state.RunState`.
    """

    def __init__(
        self,
        scenario: Scenario,
        setup: Setup,
        now: TeamArrays,
        teams: Sequence[Team],
        fleet: AnyFleet,
        recorder: Recorder,
        before: Ticks | None = None,
    ) -> None:
        self.tick = 0
        self.recorder = recorder
        self.given: dict[str, tuple[int, int]] = {}
        self._scenario, self._setup, self._now, self._teams, self._fleet = scenario, setup, now, tuple(teams), fleet
        robots = (setup.leader, *setup.followers)
        names = self._names = [robot.name for robot in robots]
        poses = [[role.name for role in robot.kind.pose] for robot in robots]
        commands = [[role.name for role in robot.kind.command] for robot in setup.followers]
        step = scenario.step
        sensors, acting = (None, None) if before is None else (before._sensors, before._actuators)
        self._sensors: Chain = pose_sensors(
            scenario.seed, names, poses, [robot.sensor for robot in robots], step, sensors
        )
        self._actuators: Chain = actuators(commands, [robot.actuator for robot in setup.followers], step, acting)
        besides = any(robot.has_torque for robot in setup.followers)
        self._external = now.padded([robot.torque for robot in (robots if besides else robots[:1])], setup.storage)
        driven = driven_robots(setup)
        self._changes: dict[int, list[tuple[int, RobotSetup]]] = {}
        for row, robot in enumerate(driven):
            for tick in robot.changes:
                self._changes.setdefault(tick, []).append((row, robot))
        self._switches = sorted(self._changes)
        self._records = self._record()
        self._telemetry = [recorder.records_of(team.rows, team.telemetry_type) for team in self._teams]
        self._recorded = [name for name in recorder.variables if recorder.records(name)]
        self._places = (
            *(now, self._external, *setup.desired, setup.motion, *(robot.samples for robot in driven)),
            *(*self._teams, *recorder.places),
        )
        known = before is not None and before._has_places_of(self)
        self._wiring: Wiring = before._wiring if before is not None and known else self._wire(driven)
        self._has_laws: bool | None = before._has_laws if before is not None and known else None
        self._loop = self._wired(NO_FLEET)
        self._advance = entry_of(advance, self._loop, 0, 0, 0)
        self._do(Part.LEAD, -1)

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
        self._do(Part.SENSE, tick)
        self._control()
        self._actuators.make_ready(tick)
        self._act(override)
        for team, (records, numbers) in zip(self._teams, self._telemetry, strict=True):
            records[tick] = team.telemetry(tick * step)[numbers]
        self.recorder.recorded = tick + 1
        watch(tick)
        if tick < self._scenario.ticks:
            for row, robot in self._changes.get(tick, ()):
                self._fleet.change(row, [parameter.as_value for parameter in robot.changes[tick]], tick, step)
            self._do(Part.GIVE, tick)
            self._fleet.step(tick, step, self._wiring.given)
            self._do(Part.LEAD, tick)
        self.tick += 1

    def some(self, most: int) -> bool:
        """Run up to so many ticks in compiled code; return whether that was possible.

        Raises
        ------
        SimulationError
            As `one`.
        """
        first, step, horizon = self.tick, self._scenario.step, self._scenario.ticks
        if first == 0 or first in self._changes or not self._is_compiled:  # at the first tick controllers are started
            return False
        last = min(
            first + most,
            self._sensors.make_ready(first),
            self._actuators.make_ready(first),
            horizon + 1,
            *self._switches[bisect(self._switches, first) :][:1],
        )
        self.tick, ended = self._advance(self._loop, Part.ALL.value, first, last)
        if ended == Ended.RAISED and self._wiring.elsewhere is not None:
            self.recorder.recorded = self.tick
            if self._wiring.elsewhere.settle(self.tick * step):  # a law has taken long, and answered
                rest = (Part.ALL & ~Part.SENSE).value
                self.tick, ended = self._advance(self._loop, rest, self.tick, self.tick + 1)
        self.recorder.recorded = self.tick + (ended == Ended.PLANTS)
        if ended == Ended.PLANTS:
            self._fleet.settle(self.tick, step, int(self._loop.fleet.found[0]))  # raises, unless a plant takes long
            self._do(Part.LEAD, self.tick)
            self.tick += 1
        self._fleet.settle(min(self.tick, horizon) - 1, step, 0)  # at the horizon no plant is stepped
        if ended == Ended.COMMANDS:
            self._raise_not_finite()
        if ended in (Ended.INPUTS, Ended.RAISED):
            self._control()  # says why
            raise RuntimeError("the compiled code of a controller has failed, which its Python code does not")
        return True

    def saved(self) -> RunState:
        """Return the state before the next tick.

        Raises
        ------
        SimulationError
            A plant or a controller does not return its own.
        """
        time = self.tick * self._scenario.step
        return RunState(
            tick=self.tick,
            numbers={name: getattr(self._now, name).copy() for name in NUMBERS},
            sensors=self._sensors.saved(),
            actuators=self._actuators.saved(),
            laws=tuple(team.to_bytes(time) for team in self._teams) if self.tick > 0 else (),
            signals=tuple(team.telemetry(time).copy() for team in self._teams),
            fleet=self._fleet.saved(time),
            given=dict(self.given),
        )

    def restore(self, state: RunState, *, same_seed: bool = True, here: bool = True) -> None:
        """Go on from a state of a run with the same structure, in place of the first tick.

        Parameters
        ----------
        state
            The state; its earlier ticks are recorded already.
        same_seed
            Whether that run had the same seed; otherwise noise begins anew.
        here
            Whether the laws are called in this process.

        Raises
        ------
        InputError
            An effect remembers numbers that the run did not have.
        SimulationError
            A plant or a controller refuses its state.
        """
        tick, step = state.tick, self._scenario.step
        if tick > 0:
            self._fleet.restore(state.fleet, tick, step)
            for chain, own in ((self._sensors, state.sensors), (self._actuators, state.actuators)):
                try:
                    chain.restore(own, tick, same_seed=same_seed)
                except ValueError as error:
                    raise InputError(
                        f"<{error}> cannot be added or changed in the course of a run: it depends on earlier ticks"
                    ) from None
            for team, law, signals in zip(self._teams, state.laws, state.signals, strict=True) if here else ():
                team.from_bytes(law, tick * step)
                team.telemetry(tick * step)[:] = signals
            for name, values in state.numbers.items():
                getattr(self._now, name)[:] = values
            self.given = dict(state.given)
        self.tick = self.recorder.recorded = tick

    def _control(self) -> None:
        if self.tick % self._scenario.period:
            return  # the commands are held
        motion, tick = self._setup.motion, self.tick
        acceleration = None if motion is None else motion.acceleration[tick]
        now, told = self._now, self._now.told_of_the_leader()
        desired = [part[tick] for part in self._setup.desired]
        for team in self._teams:
            team.give(
                now.measured[1:],
                now.velocity[1:],
                told,
                acceleration,
                fc.Desired(*(part[team.place] for part in desired)),
            )
        for team in self._teams:
            now.command[team.commands] = team.step(tick * self._scenario.step, first=tick == 0)

    def _raise_not_finite(self) -> None:
        for team in self._teams:
            command = self._now.command[team.commands]
            if not np.isfinite(command).all():
                raise team.not_finite(command, self.tick * self._scenario.step)

    def _act(self, override: Mapping[int, Floats]) -> None:
        """Let the commands act, some of this tick alone: those of the controllers may be held longer."""
        command, held = self._now.command, self._now.command.copy()
        for row, own in override.items():
            name = self._names[row]
            self.given[name] = (self.given.get(name, (self.tick,))[0], self.tick)
            if row > 0:
                command[row - 1] = own
        self._do(Part.ACT, self.tick)
        command[:] = held
        if 0 in override:
            self._now.torque[0] = override[0]
            for values, place in self._records:
                place[self.tick] = values

    def _do(self, parts: Part, tick: int) -> None:
        """Run parts of a tick."""
        self._advance(self._loop, parts.value, tick, tick + 1)

    def _record(self) -> list[tuple[Floats, Floats]]:
        """Prepare the records, and fill in the values known before the run; return values with the places for them."""
        recorder, now, desired = self.recorder, self._now, self._setup.desired
        for name, values in (("desired_range", desired.q[..., 0]), ("desired_bearing", desired.q[..., 1])):
            if recorder.records(name):
                fill(recorder.of(name), values)
        records = []
        for own, values in (
            ("pose", now.pose),
            ("velocity", now.velocity),
            ("measured_pose", now.measured),
            (self._setup.columns.commands, now.torque),
        ):
            leader = "measured_leader_pose" if own == "measured_pose" else f"leader_{own}"
            first, last = 0 if recorder.records(leader) else 1, len(values) if recorder.records(own) else 1
            if first == last:
                continue
            place = recorder.place_of(values[first:last])
            records.append((values[first:last], place))
            if first == 0:
                recorder.keep(leader, place[:, 0])
            if last > 1:
                recorder.keep(own, place[:, 1 - first :])
        return records

    def _has_places_of(self, later: Ticks) -> bool:
        """Return whether all numbers of a later run are where they are in this one."""
        here, there = self._places, later._places
        return (
            self._recorded == later._recorded
            and len(here) == len(there)
            and all(one is other for one, other in zip(here, there, strict=True))
        )

    def _wire(self, driven: Sequence[RobotSetup]) -> Wiring:
        """Return who takes which number from where, but for the laws; the robots that are plants are given."""
        wiring, now, setup = Wiring(), self._now, self._setup
        wiring.move(Stage.SENSE, spots(now.measured), spots(now.pose))
        wire_acting(wiring, now, self._external)
        wire_plants(wiring, now, len(now.kinds) - len(driven), driven)
        wire_path(wiring, now, setup.leader, setup.motion)
        for values, place in self._records:
            wiring.move(Stage.RECORD, spots_by_tick(place), spots(values), values, place)
        return wiring

    def _wired(self, fleet: CompiledFleet) -> Loop:
        moves, stages, laws = self._wiring.arrays()
        return Loop(
            step=self._scenario.step,
            ticks=self._scenario.ticks,
            period=self._scenario.period,
            moves=moves,
            stages=stages,
            laws=laws,
            sensors=self._sensors.arrays,
            measured=self._now.measured,
            actuators=self._actuators.arrays,
            acting=self._now.torque[1:],
            fleet=fleet,
        )

    @property
    def _is_compiled(self) -> bool:
        """Whether compiled code can run whole ticks, and Python has a share in none of them."""
        if self._loop.fleet is not NO_FLEET:
            return True
        if self._has_laws is None:
            setup = self._setup
            self._has_laws = wire_laws(
                self._wiring, self._teams, self._now, setup.desired, setup.motion, self._telemetry
            )
        if self._has_laws and (fleet := self._fleet.compiled(self._wiring.given)) is not None:
            self._loop = self._wired(fleet)
        return self._loop.fleet is not NO_FLEET


def driven_robots(setup: Setup) -> tuple[RobotSetup, ...]:
    """Return the robots that are plants: all, but for a leader whose motion is given."""
    return setup.followers if setup.motion is not None else (setup.leader, *setup.followers)
