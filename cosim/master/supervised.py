"""A run in a process that this one supervises: whatever an FMU does there, what was recorded is kept.

The process is forked before the plants are started, and runs the whole loop. The records are in memory that both
share. A crash, an exit or a hang of an FMU ends that process and no other. It is no sandbox: the process has the
user's rights.
"""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numba.core.compiler_lock import global_compiler_lock
from numpy.typing import NDArray

from cosim import process_tree
from cosim.closing import Closing
from cosim.errors import Failure, InputError, Location, RunInterrupted, SimulationError, interruption
from cosim.master.branch import branched
from cosim.master.checkpoint import Start
from cosim.master.checkpoints import Checkpoints
from cosim.master.fleets import AnyFleet, members_of
from cosim.master.foreign import is_foreign, is_supervised
from cosim.master.gate import Gate
from cosim.master.interrupt import HeldSignals
from cosim.master.pacing import Pacer, PaceReport
from cosim.master.recorder import Recorder
from cosim.master.records import Records
from cosim.master.robot import RobotSetup
from cosim.master.setup import Setup, set_up
from cosim.master.simulation import Simulation
from cosim.master.supervised_child import Order, Told, child
from cosim.master.ticks import driven_robots
from cosim.master.timing import timed
from cosim.plant.activity import activity
from cosim.plant.failures import PlantError
from cosim.plant.interpreter import how_it_ended
from cosim.plant.member import Member
from cosim.plant.message import Message, RobotMessage
from cosim.plant.printed import Printed
from cosim.plant.protocol import HEADER, send
from cosim.plant.saved import FleetState
from cosim.plant.spec import Value
from cosim.plant.start_check import not_started
from cosim.results.result import Result
from cosim.scenario.scenario import SUPERVISED_TIME_LIMIT, Scenario
from cosim.shared_memory import provide
from cosim.undisturbed import Ending, undisturbed

_LOOK = 0.05
"""Time [s] between two looks at the process."""
_LAST_MOMENT = 1.0
"""Time [s] for a process whose pipe is closed to end."""
_MOST = 64 * 1024**2
"""Bytes of a message from the process."""


def whole_run(
    scenario: Scenario,
    setup: Setup | None = None,
    gate: Gate | None = None,
    start: Start | None = None,
    checkpoints: Checkpoints | None = None,
) -> Simulation | SupervisedRun:
    """Return a run that goes to its end in one piece, ready to begin: supervised if FMU files are among its plants.

    A scenario that is set up already is one `for_whole_run`. A gate that holds the run must be in memory that processes
    share. For `start` and `checkpoints` see `Simulation`.
    """
    if is_supervised(scenario):
        return SupervisedRun(scenario, setup, gate, start, checkpoints)
    watching = [gate] if gate is not None else ()
    return Simulation(scenario, setup, observers=watching, start=start, checkpoints=checkpoints)


class SupervisedRun(Closing):
    """A run in a process of its own, which is started here.

    Legal call order: `run_to_end` once; `close` at the end (or use ``with``).

    Parameters
    ----------
    scenario
        The scenario.
    setup
        With which set-up; without one, the scenario is set up here.
    gate
        Holds the run where somebody closes it; in memory that processes share.
    start, checkpoints
        As for `Simulation`.

    Raises
    ------
    InputError
        The scenario asks for something that does not exist or does not fit, or a plant cannot be started.
    SimulationError
        A plant returns no finite pose at the start.
    """

    def __init__(
        self,
        scenario: Scenario,
        setup: Setup | None = None,
        gate: Gate | None = None,
        start: Start | None = None,
        checkpoints: Checkpoints | None = None,
    ) -> None:
        self.scenario = scenario
        self._checkpoints = checkpoints
        self.timing: dict[str, float] = {}
        self._gate = gate
        self._status: int | None = None
        self._expired: float | None = None
        self._severed = False
        self._buffer = b""
        self._nonsense = False  # whether the process has answered with something that makes no sense
        self._forwarded = 0
        self._pipes: tuple[int, ...] = ()
        self._printed: Printed | None = None
        self._left = False  # whether the process has ended all that it has started, and leaves
        with Ending() as cleanup:
            if setup is None:
                setup = set_up(scenario, cleanup, self.timing)
                setup = setup if start is None else branched(setup, scenario, start)
            self.setup = setup
            memory: list[NDArray[Any]] = []
            allocate = self.setup.storage.shared
            self._recorder = Recorder(scenario.ticks + 1, self.setup.result_variables, None, memory, allocate)
            self._fleet = _Elsewhere()
            self._records = Simulation(
                scenario, self.setup, fleet=self._fleet.lend, recorder=self._recorder, here=False, start=start
            )
            self._first = self._recorder.recorded
            self.setup.hosts.stop()  # the process has hosts of its own
            limits = [robot.source.time_limit for robot in driven_robots(self.setup)]
            self._limits = [SUPERVISED_TIME_LIMIT if limit is None else limit for limit in limits]
            self._activity = activity()
            self._seen, self._since = (-1, 0, 0.0), time.monotonic()
            cleanup.callback(self._kill)
            with timed(self.timing, "load"):
                self._fork(partial(child, scenario, self.setup, memory, self._activity, gate, start, checkpoints))
                provide(memory, new=True)
                self._begin()
            self._cleanup = cleanup.pop_all()

    def run_to_end(self, progress: Callable[[int], None] | None = None, pacer: Pacer | None = None) -> Result:
        """Run to the horizon and return the result; see `Simulation.run_to_end`."""
        with HeldSignals() as signals, timed(self.timing, "loop"):
            self._send(Order.RUN, {"pace": None if pacer is None else pacer.factor})
            last = -1

            def look() -> None:
                nonlocal last
                if progress is not None and self._tick > last:
                    progress(last := self._tick)
                self._heed(signals)

            told = self._receive(look)
            failure = self._settle(told, signals)
            if progress is not None and failure is None:
                progress(self.scenario.ticks)
            if told is not None and pacer is not None and told[1].get("pace"):
                pacer.take(PaceReport(**told[1]["pace"]))
            result = self._records.recorded(failure)
        if signals.received or (failure is not None and failure.interrupted):
            raise RunInterrupted(self.scenario.horizon if failure is None else failure.time, result)
        if failure is not None and not failure.left:
            error = SimulationError(failure.robot, failure.time, failure.message, failure.variable)
            error.recorded = result
            raise error
        return result

    @property
    def records(self) -> Records:
        """What is recorded so far, also for another thread."""

        def count() -> int:
            held = -1 if self._gate is None else self._gate.tick
            return max(self._recorder.recorded, min(max(self._tick, held), self.scenario.ticks) + 1)

        return replace(self._records.records, count=count)

    @property
    def time(self) -> float:
        """The communication point [s] that the run has reached."""
        return self._recorder.recorded * self.scenario.step

    def close(self) -> None:
        """End all plants with the process, within their time limits."""
        try:
            if self._pipes:
                self._send(Order.CLOSE, {})
                while (told := self._receive(lambda: None)) is not None:
                    self._left |= told[0] == Told.CLOSED
        finally:
            self._cleanup.close()

    # What the process tells ---------------------------------------------------------------------------------

    def _begin(self) -> None:
        """Wait until the plants are started."""
        told = self._receive(lambda: None)
        if told is None:
            index, how = int(self._activity.current[0]), f"did not start{self._how()}{self._last_words()}"
            if not 0 <= index < len(self._fleet.members):
                raise InputError(f"the process for the plants of {self.scenario.name!r} {how}")
            raise not_started(self._fleet.members, index, PlantError(f"it {how}"))
        kind, body = told
        if kind == Told.REFUSED:
            where = body.get("where")
            raise InputError(str(body["message"]), None if where is None else Location(*where))
        if kind == Told.FAILED:
            failure = Failure(**body["failure"])
            error = SimulationError(failure.robot, failure.time, failure.message, failure.variable)
            self._fleet.take(body)
            error.recorded = self._records.recorded(failure)
            raise error
        self._check_known(kind, body)

    def _settle(self, told: tuple[Told, dict[str, Any]] | None, signals: HeldSignals) -> Failure | None:
        """Take over what the process has told of the run; return why it has not reached its end."""
        if told is not None:
            kind, body = told
            self._check_known(kind, body)
            try:
                failure = None if body["failure"] is None else Failure(**body["failure"])
                self._fleet.take(body)
                self._recorder.recorded = int(body["recorded"])
                if self._checkpoints is not None:
                    written, fault = body["checkpoints"]
                    self._checkpoints.written = None if written is None else int(written)
                    self._checkpoints.fault = str(fault)
                self.timing |= {part: float(seconds) for part, seconds in body["timing"].items()}
                return failure
            except (KeyError, TypeError, ValueError):
                self._nonsense = True
                self._kill()
        self._recorder.recorded = min(self._tick + 1, self.scenario.ticks + 1)
        at = max(self._tick, 0) * self.scenario.step  # before the first step none has been recorded
        if signals.received:
            return interruption(at)
        index = int(self._activity.current[0])
        if 0 <= index < len(self._fleet.members):
            spec = self._fleet.members[index].spec
            robot, what = spec.robot, f"the plant {spec.file} {self._activity.undone}"
        else:
            files = dict.fromkeys(member.spec.file for member in self._fleet.members)
            robot, what = "a plant", f"the process that runs {', '.join(files)} has ended"
        return Failure(robot, at, "", f"{what}{self._how()}{self._last_words()}")

    def _check_known(self, kind: Told, body: dict[str, Any]) -> None:
        """Raise what nobody foresaw in the process."""
        if kind == Told.UNFORESEEN:
            error = RuntimeError(str(body["message"]))
            error.add_note(str(body["traceback"]))
            raise error

    @property
    def _tick(self) -> int:
        """The tick at which the plants were stepped or changed last; it is recorded if they were."""
        now, step = self._activity.clock.tolist()
        return round(now / self.scenario.step) if step > 0.0 else self._first - 1

    def _how(self) -> str:
        if self._nonsense:
            return ": its process answers with bytes that are no reply"
        if self._severed:
            return ": its process has closed the pipe to the harness"
        return how_it_ended(self._status or 0, self._expired)

    def _last_words(self) -> str:
        said = self._activity.last_words
        return f"; it had logged: {'; '.join(said)}" if said else ""

    # The process --------------------------------------------------------------------------------------------

    def _fork(self, run: Callable[[str, int, int, int], None]) -> None:
        with undisturbed():  # a process that nobody knows would be left, and pipes
            self._fork_undisturbed(run)

    def _fork_undisturbed(self, run: Callable[[str, int, int, int], None]) -> None:
        orders, tells = os.pipe(), os.pipe()
        self._mark = process_tree.new_mark()
        for stream in (sys.stdout, sys.stderr):
            with suppress(AttributeError, OSError, ValueError):  # None or closed; else nothing is written twice
                stream.flush()
        foreign = (robot.fmu.path.name for robot in driven_robots(self.setup) if is_foreign(robot.source))
        printed = Printed(", ".join(dict.fromkeys(foreign)))
        with warnings.catch_warnings():  # of threads that the child lacks: it runs none of their code
            warnings.simplefilter("ignore", DeprecationWarning)
            self._pid = printed.of(lambda pipe: self._forked(partial(run, printed.mark, pipe, orders[0], tells[1])))
        self._printed = printed
        os.close(orders[0])
        os.close(tells[1])
        self._orders, self._tells = self._pipes = orders[1], tells[0]

    def _forked(self, run: Callable[[], None]) -> int:
        with global_compiler_lock:  # of Numba: no other thread may hold it in the child, where that never ends
            pid = os.fork()
        if pid == 0:
            try:
                os.environ[self._mark] = ""  # for what it starts
                run()
            finally:
                os._exit(70)
        return pid

    def _send(self, order: Order, body: dict[str, Any]) -> None:
        with suppress(BrokenPipeError):  # the process has ended: what it has told shows how
            send(self._orders, order, json.dumps(body).encode())

    def _receive(self, look: Callable[[], None]) -> tuple[Told, dict[str, Any]] | None:
        """Return what the process tells next, which is not trusted; None once it has ended."""
        while True:
            try:
                if (frame := self._frame()) is not None:
                    return frame
            except ValueError:
                self._nonsense = True
                self._kill()
                return None
            look()
            self._watch()
            ended = self._status is not None or not _lives(self._pid)  # then its last words are in the pipe
            if select.select([self._tells], [], [], 0.0 if ended else _LOOK)[0]:
                part = os.read(self._tells, 65536)
                self._buffer += part
                if not part:
                    self._kill()
                    return None
            elif ended:  # and what it has left behind holds the pipe
                self._kill()
                return None

    def _frame(self) -> tuple[Told, dict[str, Any]] | None:
        """Return the next message, None if there is none yet; ValueError if it makes no sense."""
        if len(self._buffer) < HEADER.size:
            return None
        kind, length = HEADER.unpack_from(self._buffer)
        if length > _MOST:
            raise ValueError
        if len(self._buffer) < HEADER.size + length:
            return None
        body = self._buffer[HEADER.size : HEADER.size + length]
        self._buffer = self._buffer[HEADER.size + length :]
        told = json.loads(body)
        if not isinstance(told, dict):
            raise ValueError
        return Told(kind), told

    def _watch(self) -> None:
        """End the process if a call of an FMU takes longer than its time limit."""
        current = int(self._activity.current[0])
        seen = current, int(self._activity.doing[0]), float(self._activity.clock[0])
        now = time.monotonic()
        if seen != self._seen or current < 0:
            self._seen, self._since = seen, now
        elif current < len(self._limits) and now - self._since > self._limits[current]:
            self._expired = self._limits[current]
            self._end_tree()

    def _heed(self, signals: HeldSignals) -> None:
        """Hand the first signal on, so that the run ends after a tick; end the process with the second one."""
        if signals.received > self._forwarded:
            self._forwarded = signals.received
            if signals.received > 1:
                self._end_tree()
            elif self._status is None:
                with suppress(ProcessLookupError):
                    os.kill(self._pid, signal.SIGINT)

    def _has_ended(self, options: int = os.WNOHANG) -> bool:
        if self._status is None:
            pid, status = os.waitpid(self._pid, options)
            if pid:
                self._status = os.waitstatus_to_exitcode(status)
        return self._status is not None

    def _end_tree(self) -> None:
        """End the process and all that it has started."""
        if self._status is None:
            process_tree.end(self._pid, self._mark, self._tells)
            self._has_ended(0)

    def _kill(self) -> None:
        """See that the process has ended, with all that it has started, and close the pipes."""
        with undisturbed():
            if self._pipes:
                self._kill_undisturbed()

    def _kill_undisturbed(self) -> None:
        give_up = time.monotonic() + _LAST_MOMENT  # its pipe closes a little before it ends
        while self._status is None and _lives(self._pid) and time.monotonic() < give_up:
            time.sleep(0.001)
        self._severed = self._status is None and _lives(self._pid)
        if self._left:  # and nothing that it has started is left
            self._has_ended()
        self._end_tree()
        for pipe in self._pipes:
            os.close(pipe)
        self._pipes = ()
        if self._printed is not None:
            self._printed.close()


def _lives(pid: int) -> bool:
    """Return whether a child of this process has not ended; it remains to be waited for."""
    return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None


class _Elsewhere:
    """The plants of a run as the process that supervises it sees them: only what their FMUs have logged."""

    def __init__(self) -> None:
        self.process, self.companions = "supervised", ()
        self.members: list[Member] = []
        self.messages: list[str] = []
        self.logged: list[RobotMessage] = []

    def lend(
        self,
        robots: Sequence[RobotSetup],
        horizon: float,
        state: NDArray[np.float64],
        columns: Sequence[tuple[int, ...]],
    ) -> AbstractContextManager[AnyFleet]:
        self.members = members_of(robots, horizon, columns)
        return nullcontext(self)

    def take(self, body: dict[str, Any]) -> None:
        """Take over what the FMUs have logged."""
        self.messages = [str(text) for text in body["messages"]]
        self.logged = [
            RobotMessage(float(entry["time"]), str(entry["robot"]), Message(**entry["message"]))
            for entry in body["logged"]
        ]

    def step(self, tick: int, step: float, given: NDArray[np.float64]) -> None:
        raise NotImplementedError("the plants are in another process")

    def compiled(self, given: NDArray[np.float64]) -> None:
        return None

    def settle(self, tick: int, step: float, found: int) -> None:
        raise NotImplementedError("the plants are in another process")

    def change(self, index: int, values: Sequence[Value], tick: int, step: float) -> None:
        raise NotImplementedError("the plants are in another process")

    def saved(self, time: float) -> FleetState:
        raise NotImplementedError("the plants are in another process")

    def restore(self, state: FleetState, tick: int, step: float) -> None:
        self.messages, self.logged = list(state.messages), list(state.logged)
