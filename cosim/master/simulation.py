"""The master: every communication step it senses, controls, actuates, records and steps the plants."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cosim.closing import Closing
from cosim.control.team import Team
from cosim.control.teams import begin, companions, team_of
from cosim.errors import Failure, InputError, RunInterrupted, SimulationError, interruption, leave, nearest
from cosim.master.branch import branched
from cosim.master.checkpoint import Checkpoint, Snapshot, Start
from cosim.master.checkpoints import Checkpoints
from cosim.master.content import checksums
from cosim.master.fleets import AnyFleet, StartFleet, start_fleet
from cosim.master.foreign import contained
from cosim.master.interrupt import HeldSignals
from cosim.master.observer import Observer, Progress, Watched, read_only
from cosim.master.origin import Origin
from cosim.master.pacing import Pacer
from cosim.master.recorded_result import MakeResult, part_of_result, recorded_result
from cosim.master.recorder import Recorder
from cosim.master.records import Records
from cosim.master.run_state import RunState
from cosim.master.savable import check_savable
from cosim.master.segment import Segment
from cosim.master.setup import Setup, set_up
from cosim.master.team_arrays import TeamArrays
from cosim.master.teams import teams_of
from cosim.master.ticks import Ticks, driven_robots
from cosim.master.timing import timed
from cosim.plant.one_core import OneCore
from cosim.plant.working_folder import returning
from cosim.results.provenance import Part
from cosim.results.result import Result
from cosim.scenario.edits import Change
from cosim.scenario.scenario import LEADER, Scenario
from cosim.storage import fill, forget
from cosim.undisturbed import Ending

if TYPE_CHECKING:
    import xarray as xr

_KEPT = 32 * 1024**2
"""Bytes of records that lie in memory at least, where the others lie in files."""
_NUMBERS = {1: "one", 2: "two", 3: "three"}


class Simulation(Closing):
    """A scenario in the course of being run.

    Legal call order: `step` until `finished`, or `run`; `result` at any time, `save` and `fork` between two steps;
    `close` at the end (or use ``with``).

    Parameters
    ----------
    scenario
        The scenario to run. Built-in plants are built into FMUs here if they are not in the cache.
    setup
        With which set-up; without one, the scenario is set up here, and its FMU files run in processes of their own,
        unless it trusts them (``isolate="no"``).
    observers
        Who watches the run, from its first tick to its end.
    fleet
        Starts the plants: their FMUs, or for tests a `cosim.master.mock_fleet.MockFleet`.
    recorder
        Gets the records, in memory that another run has used; without one, a new one.
    make_result
        Makes results of the records.
    before
        A run that has reached its end, and is of no use from then on: what is the same in this one is taken over from
        it, as the arrays in which robots have their numbers, laws and wiring.
    here
        Whether the run happens in this process; if not, laws in environments of their own are not started here.
    start
        From where the run goes on, in place of its first tick. A set-up must be one that `branched` has returned.
    checkpoints
        Are written while the run goes on by `run`, `run_to_end` and `record`.

    Attributes
    ----------
    tick : int
        The number of the next tick.
    poses, velocities : dict
        Of every robot, by name: pose and pseudo-velocities at the communication point of the next tick, in
        the order and units of its kind of vehicle; read only. A velocity that its plant does not offer is NaN.

    Raises
    ------
    InputError
        The scenario asks for something that does not exist or does not fit.
    SimulationError
        A plant returns no finite pose at the start.
    """

    def __init__(
        self,
        scenario: Scenario,
        setup: Setup | None = None,
        *,
        observers: Iterable[Observer] = (),
        fleet: StartFleet = start_fleet,
        recorder: Recorder | None = None,
        make_result: MakeResult = recorded_result,
        before: Simulation | None = None,
        here: bool = True,
        start: Start | None = None,
        checkpoints: Checkpoints | None = None,
    ) -> None:
        self.scenario = scenario = contained(scenario) if setup is None else scenario
        self._make_result = make_result
        self._checkpoints = checkpoints
        self.timing: dict[str, float] = {}
        self._ended = ""  # why there are no more steps
        self._failure: Failure | None = None
        self._signals = HeldSignals()
        self._observers: list[Observer] = []
        with Ending() as cleanup:
            if setup is None:
                setup = set_up(scenario, cleanup, self.timing)
                setup = setup if start is None else branched(setup, scenario, start)
            self.setup = setup
            self._files = checksums(scenario) if make_result is recorded_result else None  # before anybody edits them
            self.parts = () if start is None else start.parts
            robots = (self.setup.leader, *self.setup.followers)
            kinds = tuple(robot.kind for robot in robots)
            now = before._now if before is not None and before._now.kinds == kinds else TeamArrays(kinds)
            self._now: TeamArrays = now
            now.clear()
            self.poses = {robot.name: now.visible(row)[0] for row, robot in enumerate(robots)}
            self.velocities = {robot.name: now.visible(row)[1] for row, robot in enumerate(robots)}
            # Before the plants: laws load libraries, which may start threads
            self._teams: list[Team] = self._gather_teams([] if before is None else before._teams)
            self._fleet = self._start_plants(fleet, cleanup)
            if here:
                with timed(self.timing, "controllers"):
                    begin(self._teams, self.setup.motion is not None)
            recorder = recorder or Recorder(
                scenario.ticks + 1, self.setup.result_variables, allocate=self.setup.storage.empty
            )
            self._ticks: Ticks = Ticks(
                *(scenario, self.setup, now, self._teams, self._fleet, recorder),
                None if before is None else before._ticks,
            )
            if start is not None:
                start.fill(recorder)
                self._ticks.restore(start.state, same_seed=start.scenario.seed == scenario.seed, here=here)
            if checkpoints is not None:
                checkpoints.try_out(self._saved, recorder)
            each = sum(variable.bytes_per_sample for variable in self.setup.result_variables)
            self._kept = max(_KEPT // each, 1)  # ticks that the system is not yet told to forget
            self._next_forget = self.tick + self._kept
            for observer in observers:
                self._watch(observer)
            self._cleanup = cleanup.pop_all()

    # A tick ------------------------------------------------------------------------------------------------

    def step(self, torques: Mapping[str, Sequence[float]] | None = None) -> None:
        """Run one tick: sense, control, actuate, record, and step the plants (but at the horizon, the end).

        Parameters
        ----------
        torques
            By robot, the commands of this tick (torques [N.m] of a robot that takes torques) in place of its
            controller's, or of the scenario's for the leader. A follower's still pass through its actuators. The
            result tells of them in its attribute ``given``.

        Raises
        ------
        InputError
            There is no such robot, its motion is given, or these are not as many finite numbers; or the run has ended,
            failed, been interrupted within a tick or been closed.
        SimulationError
            A plant or a controller failed or the motion diverged: the robot, the time and `result` up to then.
        """
        if self.finished:
            raise InputError(f"the run has ended at its horizon of {self.scenario.horizon:.12g} s")
        self._require_open("go on")
        override = self._understood(torques) if torques else {}
        with self._failing():
            self._ticks.one(override, self._tell)

    @contextmanager
    def _failing(self) -> Iterator[None]:
        """Let a failure of a tick keep the records, and tell observers of the end.

        An interruption ends the run: plants may have made a step of which the rest knows nothing.
        """
        try:
            yield
        except SimulationError as error:
            self._fail(error)
            raise
        except Exception as error:  # a fault of ours must not lose the records either
            failure = SimulationError("the master", self.time, f"{type(error).__name__}: {error}")
            self._fail(failure)
            raise failure from error
        except BaseException:
            self._ended = "its last tick is not complete"
            raise
        if self.finished:
            self._end(None)

    def _fail(self, error: SimulationError) -> None:
        self._ended, self._failure = str(error), error.failure
        error.recorded = self.recorded(error.failure)
        self._end(error.failure)

    def _understood(self, torques: Mapping[str, Sequence[float]]) -> dict[int, NDArray[np.float64]]:
        """Return torques by the row of the robot."""
        robots = list(self.poses)
        override = {}
        for robot, torque in torques.items():
            if robot not in robots:
                raise InputError(f"the scenario has no robot {robot!r}: {nearest(robot, robots)}")
            if robot == LEADER and self.setup.motion is not None:
                raise InputError("the leader's motion is given by its <trajectory>: no torque drives it")
            try:
                values = np.asarray(torque, dtype=np.float64)
            except (TypeError, ValueError):
                values = np.empty(0)
            row = robots.index(robot)
            commands = self._now.kinds[row].command
            if values.shape != (len(commands),) or not np.isfinite(values).all():
                units = ", ".join(dict.fromkeys(role.unit for role in commands))
                count = _NUMBERS.get(len(commands), str(len(commands)))
                raise InputError(f"the torque of {robot} is {torque!r}; expected {count} finite numbers [{units}]")
            override[row] = np.full(self._now.torque.shape[1], np.nan)
            override[row][: len(commands)] = values
        return override

    # Who watches -------------------------------------------------------------------------------------------

    def _watch(self, observer: Observer) -> None:
        state, measured, torque = map(read_only, (self._now.state, self._now.measured, self._now.torque))
        run = Watched(
            self.scenario.clock,
            self.tick,
            tuple(self.poses),
            state,
            measured,
            torque,
            lambda: self._signals.received > 0,
            lambda: sum(getattr(one, "held", 0.0) for one in self._observers),
            self.records,
        )
        observer.started(run)
        self._observers.append(observer)

    def _tell(self, tick: int) -> None:
        for observer in self._observers:
            observer.ticked(tick)

    def _end(self, failure: Failure | None, watching: Sequence[Observer] | None = None) -> None:
        """Tell observers, or all, that the run has ended for them, if they have not been told."""
        for observer in list(self._observers):
            if watching is None or any(observer is one for one in watching):
                self._observers.remove(observer)
                observer.ended(failure)

    # The whole run -----------------------------------------------------------------------------------------

    @property
    def tick(self) -> int:
        """The number of the next tick."""
        return self._ticks.tick

    @property
    def time(self) -> float:
        """The communication point [s] of the next tick: the tick's number times the step, never a running sum."""
        return self.tick * self.scenario.step

    @property
    def finished(self) -> bool:
        """Whether the sample at the horizon is recorded."""
        return self.tick > self.scenario.ticks

    def run(self, progress: Callable[[int], None] | None = None, pacer: Pacer | None = None) -> xr.Dataset:
        """Run to the horizon and return the result as an xarray dataset; see `run_to_end`."""
        return self.run_to_end(progress, pacer).dataset

    def run_to_end(self, progress: Callable[[int], None] | None = None, pacer: Pacer | None = None) -> Result:
        """Run to the horizon and return the result.

        Parameters
        ----------
        progress
            Called with a tick some times a second, and with the last one; an observer that is a function.
        pacer
            An observer that waits after each tick, so that the run keeps pace with a clock.

        Raises
        ------
        SimulationError
            See `step`.
        RunInterrupted
            The user pressed Ctrl-C.
        """
        with HeldSignals() as signals, timed(self.timing, "loop"), returning():
            result = self.recorded(self.record(signals, progress, pacer))
        if signals.received:
            raise RunInterrupted(min(self.time, self.scenario.horizon), result)
        return result

    def record(
        self, signals: HeldSignals, progress: Callable[[int], None] | None = None, pacer: Pacer | None = None
    ) -> Failure | None:
        """Do what `run_to_end` does, but return the interruption by a signal, if any, and make no result."""
        watching: list[Observer] = [Progress(progress)] if progress else []
        watching += [pacer] if pacer else []
        if not self.finished:
            self._require_open("go on")
        self._signals = signals
        stopped: Failure | None = None
        try:
            signals.breakable(lambda: self._run_ticks(watching))
            if not self.finished:
                stopped = interruption(self.time) if signals.received else leave(self.time)
                signals.breakable(self._leave)
        finally:
            if self._checkpoints is not None:
                self._checkpoints.finish()
        signals.breakable(lambda: self._end(stopped, watching))
        return stopped

    def _leave(self) -> None:
        """Write a checkpoint from which a run can go on that is interrupted or left, between two ticks."""
        if self._checkpoints is not None and not self._ended:
            self._checkpoints.leave(self.tick, self._saved, self._ticks.recorder)

    def _run_ticks(self, watching: Sequence[Observer]) -> None:
        """Run ticks up to the horizon, or to a signal."""
        for observer in watching:
            self._watch(observer)
        if self._goes_on():
            with timed(self.timing, "first tick"):
                self.step()
        segment = Segment()
        with OneCore((*self._fleet.companions, *companions(self._teams))) as core:
            while self._goes_on():
                with self._failing():
                    self._segment(segment)
                core.settle(self.tick)

    def _goes_on(self) -> bool:
        """Return whether there is another tick, and write a checkpoint where one is due."""
        if self.finished or self._signals.received:
            return False
        checkpoints = self._checkpoints
        return checkpoints is None or not checkpoints.reach(self.tick, self._saved, self._ticks.recorder)

    def _segment(self, segment: Segment) -> None:
        """Run a tick, or a segment of ticks if nobody needs every tick."""
        last = self.scenario.ticks
        stop = last + 1 if self._checkpoints is None else self._checkpoints.next_stop(self.tick, last)
        if self.tick >= self._next_forget:
            forget()
            self._next_forget = self.tick + self._kept
        if any(getattr(observer, "every_tick", True) for observer in self._observers) or not segment.run(
            self._ticks, stop - self.tick
        ):
            self._ticks.one({}, self._tell)
        else:
            self._tell(self.tick - 1)

    def result(self) -> xr.Dataset:
        """Return everything recorded so far; see `cosim.master.recorded_result`."""
        return self.recorded(self._failure).dataset

    def recorded(self, failure: Failure | None) -> Result:
        """Return everything recorded so far, of a run that has not reached its end for some reason."""
        recorder = self._ticks.recorder
        result = self._make_result(self.scenario, self.setup, recorder, self._teams, self._fleet, failure)
        told: dict[str, object] = {} if self._files is None else {"files": self._files}
        if self.parts:
            told["parts"] = [part.as_data for part in self.parts]
        if given := self._ticks.given:
            told["given"] = {robot: [tick * self.scenario.step for tick in ticks] for robot, ticks in given.items()}
        return replace(result, attrs={**result.attrs, **{name: json.dumps(data) for name, data in told.items()}})

    @property
    def records(self) -> Records:
        """What is recorded so far, also for another thread."""
        recorder = self._ticks.recorder
        part = partial(part_of_result, self.scenario, self.setup, recorder, self._teams, self._fleet)
        return Records(self.scenario, self.setup, lambda: recorder.recorded, part, self.recorded)

    def close(self) -> None:
        """End all plant instances and remove unpacked files; `result` stays."""
        self._end(self._failure)
        self._ended = self._ended or "it is closed"
        self._cleanup.close()

    # Left and taken up again -------------------------------------------------------------------------------

    def save(self, path: str | Path) -> None:
        """Write a checkpoint, from which `load` goes on with the same bits, also in another process.

        Parameters
        ----------
        path
            The file; it is written whole or not at all.

        Raises
        ------
        InputError
            The FMU of a robot cannot save its state; or the run has failed, been interrupted within a tick or been
            closed.
        OutputError
            The file cannot be written.
        SimulationError
            A plant or a controller does not return its state.
        """
        self._require_open("be saved")
        check_savable(self.setup)
        origin = Origin.of(self.scenario, self.setup, self.parts)
        Snapshot.of(origin, self._saved(), self._ticks.recorder).write(Path(path))

    @classmethod
    def load(
        cls, path: str | Path, changes: Iterable[str | Change] = (), *, observers: Iterable[Observer] = ()
    ) -> Simulation:
        """Return a simulation that goes on from a checkpoint.

        Parameters
        ----------
        path
            The file that `save` or ``formation run --checkpoint`` has written.
        changes
            Changes of the scenario from there on, as for `cosim.scenario.scenario.Scenario.edited`.
        observers
            Who watches the run from there on.

        Raises
        ------
        InputError
            The checkpoint is damaged, or was written with other versions, for other FMUs, or before a file of the
            scenario was edited; or a change cannot happen in the course of a run.
        SimulationError
            A plant or a controller refuses its state.
        """
        checkpoint = Checkpoint(Path(path))
        checkpoint.origin.check_surroundings(checkpoint.path)
        changes = list(changes)
        scenario = checkpoint.scenario.edited(changes)
        made = cls(scenario, observers=observers, start=checkpoint.start("" if changes else None))
        try:
            checkpoint.origin.check_parts(made.setup, checkpoint.path)
        except BaseException:
            made.close()
            raise
        return made

    def fork(self, changes: Iterable[str | Change] = (), *, observers: Iterable[Observer] = ()) -> Simulation:
        """Return another simulation in the same state, with plants of its own; both go on independently.

        Parameters
        ----------
        changes, observers
            As for `load`: what if the payload grows now?

        Raises
        ------
        InputError, SimulationError
            As `save` and `load`.
        """
        self._require_open("be forked")
        check_savable(self.setup)
        changes = list(changes)
        part = Part(self.time, self.scenario.changes, self.scenario.text if changes else "")
        recorder, tick = self._ticks.recorder, self.tick

        def take_over(other: Recorder) -> None:
            for place, own in zip(other.numbers(0, tick), recorder.numbers(0, tick), strict=True):
                fill(place, own)

        start = Start(self.scenario, self._saved(), take_over, (*self.parts, part))
        return type(self)(self.scenario.edited(changes), observers=observers, start=start)

    def _saved(self) -> RunState:
        """Return the state. An interruption ends the run: an answer that is on its way would be taken for the next."""
        try:
            return self._ticks.saved()
        except KeyboardInterrupt:
            self._ended = "it was interrupted while its state was saved"
            raise

    def _require_open(self, what: str) -> None:
        if self._ended:
            raise InputError(f"the run cannot {what}: {self._ended}")

    # Setting up --------------------------------------------------------------------------------------------

    def _start_plants(self, fleet: StartFleet, cleanup: ExitStack) -> AnyFleet:
        driven, now = driven_robots(self.setup), self._now
        with timed(self.timing, "load"):
            columns = [now.columns_of(robot.kind) for robot in driven]
            started = fleet(driven, self.scenario.horizon, now.state[len(now.kinds) - len(driven) :], columns)
            return cleanup.enter_context(started)

    def _gather_teams(self, before: Sequence[Team]) -> list[Team]:
        """Return the laws with their followers; those of an earlier run where they are made of the same."""
        teams = []
        with timed(self.timing, "controllers"):
            for made_of in teams_of(self.scenario, self.setup):
                again = (team for team in before if team.restart(*made_of))
                teams.append(next(again, None) or team_of(*made_of))
        return teams
