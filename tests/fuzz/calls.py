"""Random sequences of public calls, with FMUs of every version, good and bad: nothing but results and errors.

What a case calls may come twice or in an order that makes no sense; Ctrl-C may come at any moment. Whatever happens,
nothing is left behind, and a run afterwards has the numbers that it has alone.
"""

from __future__ import annotations

import os
import random
import signal
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

import cosim
from cosim.errors import FormationError
from cosim.tests.driving import scenario
from plants import scratch
from tests.fuzz.seeds import KINDS
from tests.stub.stub import make_fmu

GOOD: dict[str, Any] = {"fmi": "2.0"}
BEHAVIOURS = (
    ("good", "step"),
    ("good", "step"),
    ("error", "step"),
    ("fatal_strict", "step"),
    ("discard", "step"),
    ("terminate", "step"),
    ("nan", "step"),
    ("infinity", "step"),
    ("error", "instantiate"),
    ("error", "initialization"),
    ("error", "reset"),
    ("fatal_strict", "reset"),
    ("stale", "reset"),
    ("error", "terminate"),
    ("fatal_strict", "terminate"),
    ("error", "set"),
    ("error", "get"),
    ("log_odd", "step"),
)
"""What an FMU does, and where; none ends its process."""
DEADLY = (("segfault", "step"), ("exit_0", "step"), ("abort", "instantiate"), ("exit", "free"))
"""What ends its process, which is then not this one."""
CHANGES = (
    "simulation/@seed=7",
    "leader/torque/@tau_drive=3 N.m",
    "leader/torque/@tau_drive=-1 N.m",
    "//pose/@x=1e300 m",
    "//gain[@name='none']/@value=1",
    "simulation/@step=0 s",
    "simulation/@horizon=1 s",
    "//follower/@id=other",
    "//plant/@solver=cvode",
    "]",
)
TORQUES: tuple[Any, ...] = (
    None,
    {"follower_1": [1.0, 0.0]},
    {"leader": (0.0, 0.5)},
    {"leader": [float("nan"), 0.0]},
    {"follower_1": [1.0]},
    {"follower_1": "no"},
    {"none": [0.0, 0.0]},
)


def calls_case(seed: int, folder: Path, _: tuple[bytes, ...]) -> None:
    """Make an FMU, call some functions, and raise whatever is no proper error."""
    rng = random.Random(seed)
    kind = dict(rng.choice(KINDS))
    deadly = rng.random() < 0.25
    behaviour, place = rng.choice(DEADLY if deadly else BEHAVIOURS)
    fmu = _fmu(folder, when=0.1, name="stub", behaviour=behaviour, place=place, **kind)
    process = rng.choice(("", "", 'isolate="process"') if deadly else ("", 'isolate="no"', 'isolate="no"'))
    path = _written(folder / "case.xml", fmu, f'{process} time_limit="20 s"')
    before = _held()
    with _temporary(folder / "tmp"):
        for _attempt in range(rng.randint(1, 3)):
            how = "run" if deadly else rng.choice(("run", "prepared", "simulation"))
            after = rng.uniform(0.0, 0.3) if rng.random() < 0.3 else 0.0
            _interrupted(after, partial(_call, how, path, rng))
        left = [entry.name for entry in (folder / "tmp").iterdir() if entry not in scratch.remembered()]
    if left or _held() != before:
        raise AssertionError(f"{kind} {behaviour} {place} {process}: leaves {left}, {before} to {_held()}")
    if seed % 10 == 0 and _digest(folder) != _expected(folder):
        raise AssertionError(f"{kind} {behaviour} {place} {process}: a run afterwards has other numbers")


def warm(folder: Path) -> None:
    """Load everything, so that no case pays for it."""
    _expected(folder)
    for kind in KINDS:
        _fmu(folder, when=0.1, name="stub", behaviour="good", place="step", **kind)


def _call(how: str, path: Path, rng: random.Random) -> None:
    """Call functions of one kind, each of which may refuse or fail."""
    try:
        changes = [rng.choice(CHANGES)] if rng.random() < 0.3 else []
        if how == "run":
            cosim.run(path, changes)
            return
        read = cosim.read_scenario(path).edited(changes)
        with _closed(cosim.Prepared(read) if how == "prepared" else cosim.Simulation(read)) as made:
            calls = _of_prepared(made) if how == "prepared" else _of_simulation(made)
            for _ in range(rng.randint(1, 8)):
                with suppress(FormationError):
                    rng.choice(calls)(rng)
    except (FormationError, KeyboardInterrupt):
        return


def _of_prepared(made: cosim.Prepared) -> list[Callable[[random.Random], object]]:
    def run(rng: random.Random) -> object:
        return made.run([rng.choice(CHANGES)] if rng.random() < 0.7 else [])

    return [run, run, run, lambda rng: rng.random() < 0.2 and made.close()]


def _of_simulation(made: cosim.Simulation) -> list[Callable[[random.Random], object]]:
    return [
        lambda rng: made.step(rng.choice(TORQUES)),
        lambda rng: made.step(),
        lambda rng: [made.step() for _ in range(12)],
        lambda rng: made.run(),
        lambda rng: made.result(),
        lambda rng: rng.random() < 0.2 and made.close(),
    ]


@contextmanager
def _closed(made: Any) -> Iterator[Any]:
    """Close twice."""
    try:
        yield made
    finally:
        try:
            made.close()
        finally:
            made.close()


def _interrupted(after: float, call: Callable[[], None]) -> None:
    """Press Ctrl-C some seconds after the beginning of a call, unless it is zero or the call has ended."""
    calls = True

    def press(*_: object) -> None:
        if calls:
            signal.raise_signal(signal.SIGINT)

    signal.signal(signal.SIGALRM, press)
    try:
        signal.setitimer(signal.ITIMER_REAL, after)
        call()
        calls = False
    except KeyboardInterrupt:
        calls = False
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


@contextmanager
def _temporary(folder: Path) -> Iterator[None]:
    folder.mkdir(exist_ok=True)
    before = tempfile.gettempdir()
    tempfile.tempdir = str(folder)
    try:
        yield
    finally:
        tempfile.tempdir = before


def _held() -> tuple[int, list[str]]:
    """Return the number of open files and the processes that this one has started.

    Not counted are the locks of folders that an interrupt has kept from being removed: they go when this process ends.
    """
    pids = [Path(f"/proc/self/task/{thread}/children").read_text() for thread in os.listdir("/proc/self/task")]
    return len(os.listdir("/proc/self/fd")) - len(scratch.remembered()), " ".join(pids).split()


def _written(path: Path, fmu: Path, attributes: str) -> Path:
    solver = 'solver="euler"' if "model_exchange" in fmu.parent.name else ""
    return scenario(path, f'<plant id="car" fmu="{fmu}" {attributes} {solver}/>', horizon="0.2 s")


_made: dict[tuple[str, str], Path] = {}


def _fmu(folder: Path, **options: Any) -> Path:
    name = "-".join(f"{value}" for value in options.values() if not isinstance(value, bool))
    key = (str(folder), name)
    if key not in _made:
        _made[key] = make_fmu(folder / "made" / name, **options)
    return _made[key]


def _digest(folder: Path) -> bytes:
    path = _written(folder / "good.xml", _fmu(folder, name="good", **GOOD), 'isolate="no"')
    result = cosim.run(path)
    return bytes(result.pose.values.tobytes() + result.torque.values.tobytes())


@cache
def _expected(folder: Path) -> bytes:
    return _digest(folder)
