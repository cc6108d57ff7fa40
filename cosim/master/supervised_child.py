"""The process in which a supervised run happens: forked, it starts the plants, runs the loop and tells how it went.

Messages are frames of `cosim.plant.protocol`, each with an object as JSON.
"""

from __future__ import annotations

import ctypes
import faulthandler
import json
import os
import signal
import sys
import traceback
from contextlib import AbstractContextManager, closing
from dataclasses import asdict, replace
from enum import IntEnum
from functools import partial
from itertools import pairwise
from typing import Any

from numpy.typing import NDArray

from cosim import process_tree
from cosim.errors import InputError, SimulationError
from cosim.master.checkpoint import Start
from cosim.master.checkpoints import Checkpoints
from cosim.master.fleets import members_of
from cosim.master.gate import Gate
from cosim.master.interrupt import HeldSignals
from cosim.master.pacing import Pacer
from cosim.master.recorder import Recorder
from cosim.master.setup import Setup
from cosim.master.simulation import Simulation
from cosim.plant.activity import Activity
from cosim.plant.fleet import Fleet
from cosim.plant.log import Log
from cosim.plant.printed import hand_on, line_by_line
from cosim.plant.protocol import HEADER, exactly, send
from cosim.scenario.scenario import Scenario
from cosim.shared_memory import provide

_PR_SET_PDEATHSIG = 1


class Order(IntEnum):
    """Kinds of orders: run, with the pace or none; end the plants."""

    RUN, CLOSE = range(2)


class Told(IntEnum):
    """Kinds of answers: started; refused, with message and place; failed at the start; ended; closed; unforeseen."""

    STARTED, REFUSED, FAILED, ENDED, CLOSED, UNFORESEEN = range(6)


def child(
    scenario: Scenario,
    setup: Setup,
    memory: list[NDArray[Any]],
    activity: Activity,
    gate: Gate | None,
    start: Start | None,
    checkpoints: Checkpoints | None,
    mark: str,
    printed: int,
    orders: int,
    tells: int,
) -> None:
    """Do everything, and end this process.

    Parameters
    ----------
    scenario, setup
        The scenario with its set-up.
    memory
        Where it is recorded, see `Recorder`.
    activity
        Shows what the plants are about.
    gate
        Holds the run, if there is one.
    start, checkpoints
        As for `Simulation`; what was recorded up to the start is in the memory already.
    mark, printed
        That of a `Printed` of the process that supervises this one, and its pipe, for everything that is printed here.
    orders, tells
        Pipes from and to it.
    """
    faulthandler.disable()  # a crash is told by the process that sees it
    _leave()
    signals = HeldSignals(supervised=True).__enter__()  # to the end of the process: one while plants start ends the run
    Log.begin_anew()  # FMI 1.0 tells instances apart by their names, which those of the supervising process have, too
    orders, tells, printed = _out_of_reach(orders, tells, printed)
    _print_to(printed, mark)
    tell = partial(_tell, tells)
    activity.listen()
    try:
        recorder = Recorder(scenario.ticks + 1, setup.result_variables, None, memory)
        started: list[Fleet] = []

        def lend(robots: Any, horizon: float, state: Any, columns: Any) -> AbstractContextManager[Fleet]:
            started.append(Fleet(members_of(robots, horizon, columns), state, activity))
            return closing(started[0])

        try:
            watching = [gate] if gate is not None else []
            if start is not None:
                start = replace(start, fill=lambda _: None)
            simulation = Simulation(
                scenario,
                setup,
                observers=watching,
                fleet=lend,
                recorder=recorder,
                start=start,
                checkpoints=checkpoints,
            )
        except InputError as error:
            where = None if error.where is None else [error.where.file, error.where.line, error.where.column]
            tell(Told.REFUSED, message=error.message, where=where)
            os._exit(0)
        except SimulationError as error:
            tell(Told.FAILED, failure=asdict(error.failure), messages=[], logged=[])
            os._exit(0)
        provide(memory, new=False)
        tell(Told.STARTED)
        while (order := _order(orders)) is not None:
            kind, body = order
            if kind == Order.RUN:
                tell(Told.ENDED, **_run(simulation, signals, started[0], recorder, body["pace"], checkpoints))
            else:
                simulation.close()
                process_tree.end_descendants(os.getpid())
                tell(Told.CLOSED)
                break
    except BaseException as error:
        tell(Told.UNFORESEEN, message=f"{type(error).__name__}: {error}", traceback=traceback.format_exc())
    os._exit(0)  # without the FMU's exit handlers


def _run(
    simulation: Simulation,
    signals: HeldSignals,
    fleet: Fleet,
    recorder: Recorder,
    pace: float | None,
    checkpoints: Checkpoints | None,
) -> dict[str, Any]:
    """Run to the end; return what there is to be told."""
    pacer = None if pace is None else Pacer(simulation.scenario.step, pace)
    try:
        failure = simulation.record(signals, pacer=pacer)
    except SimulationError as error:
        failure = error.failure
    return {
        "failure": None if failure is None else asdict(failure),
        "recorded": recorder.recorded,
        "messages": fleet.messages,
        "logged": [asdict(entry) for entry in fleet.logged],
        "timing": {part: seconds for part, seconds in simulation.timing.items() if part == "first tick"},
        "checkpoints": None if checkpoints is None else (checkpoints.written, checkpoints.fault),
        "pace": None if pacer is None else asdict(pacer.report),
    }


def _leave() -> None:
    """Leave the terminal, whose signals are not for this process, and end with the process that supervises it."""
    parent = os.getppid()
    os.setsid()
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(0)
    process_tree.adopt()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:  # as SIGHUP by nohup
            signal.signal(number, signal.SIG_DFL)


def _print_to(pipe: int, mark: str) -> None:
    """Let everything that is printed or logged go there, line by line, so that a crash loses none."""
    for standard in (1, 2):
        os.dup2(pipe, standard)
    os.close(pipe)
    sys.stdout = sys.stderr = open(2, "w", 1, "utf-8", "backslashreplace", closefd=False)  # noqa: SIM115
    line_by_line()
    hand_on(mark, sys.stderr)


def _out_of_reach(*pipes: int) -> list[int]:
    """Return other descriptors of pipes, which are closed with all that is open but the standard streams."""
    import fcntl

    first = 100
    found = [fcntl.fcntl(pipe, fcntl.F_DUPFD_CLOEXEC, first) for pipe in pipes]
    os.closerange(3, first)
    for one, other in pairwise([*sorted(found), os.sysconf("SC_OPEN_MAX")]):
        os.closerange(one + 1, other)
    return found


def _tell(pipe: int, kind: Told, **body: Any) -> None:
    send(pipe, kind, json.dumps(body).encode())


def _order(pipe: int) -> tuple[Order, dict[str, Any]] | None:
    header = exactly(pipe, HEADER.size)
    if header is None:
        return None
    kind, length = HEADER.unpack(header)
    body = exactly(pipe, length)
    return None if body is None else (Order(kind), json.loads(body))
