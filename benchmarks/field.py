"""Masters in processes of their own that take turns: each drivers/*.py is the program of one."""

import atexit
import contextlib
import functools
import json
import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from plants.factory.compile import find_compiler

DRIVERS = Path(__file__).parent / "drivers"
PATIENCE = 500.0  # for one answer [s]

ONE_CORE = "int get_nprocs(void) { return 1; }"  # called by std::thread::hardware_concurrency()

T = TypeVar("T")


@dataclass(frozen=True)
class Entry:
    """A master as it is measured.

    Attributes
    ----------
    name, driver : str
        Its name and its program.
    options : dict
        For the driver.
    all_cores : bool
        Whether it may use more than one core, and sees them.
    most : int
        The most robots that it is given.
    why : str
        Why not more.
    agreement : float
        How far its records may be from the others'.
    """

    name: str
    driver: str
    options: dict[str, Any] = field(default_factory=dict)
    all_cores: bool = False
    most: int = 1_000_000
    why: str = ""
    agreement: float = 1e-9


class Failed(Exception):
    """A master failed to do its job."""


class Worker:
    """The process of one master."""

    def __init__(self, entry: Entry, python: str) -> None:
        self.entry = entry
        preload = {} if entry.all_cores else {"LD_PRELOAD": one_core()}
        self.scratch = tempfile.TemporaryDirectory()  # for the files that it unpacks
        self.log = Path(self.scratch.name, "log").open("w+")  # noqa: SIM115
        self.process = subprocess.Popen(
            [python, DRIVERS / f"{entry.driver}.py"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.log,
            text=True,
            env={**os.environ, "TMPDIR": self.scratch.name, **preload},
            preexec_fn=None if entry.all_cores or not hasattr(os, "sched_setaffinity") else _stay_on_one_core,
        )

    def ask(self, what: str, **details: Any) -> dict[str, Any]:
        """Return the answer to a request of drivers/serve.py."""
        assert self.process.stdin
        assert self.process.stdout
        timer = threading.Timer(PATIENCE, self.process.kill)
        timer.start()
        try:
            with contextlib.suppress(BrokenPipeError):
                print(json.dumps({"what": what, **details}), file=self.process.stdin, flush=True)
            line = self.process.stdout.readline()
        finally:
            timer.cancel()
        answer: dict[str, Any] = json.loads(line) if line else {"error": f"its process has ended: {self._last_words()}"}
        if "error" in answer:
            raise Failed(answer["error"])
        return answer

    def seconds(self, ticks: int) -> float:
        """Run as many ticks and return how long they took."""
        return float(self.ask("run", ticks=ticks)["seconds"])

    def record(self, ticks: int) -> dict[str, NDArray[np.float64]]:
        """Return the ``outputs``, and the ``recorded`` samples of the last ticks if the master records."""
        with tempfile.TemporaryDirectory() as scratch:
            path = Path(scratch, "record.npz")
            self.ask("record", path=str(path), ticks=ticks)
            with np.load(path) as arrays:
                return dict(arrays)

    def end(self) -> None:
        self.process.kill()
        with self.process:  # closes its pipes
            pass
        self.log.close()
        self.scratch.cleanup()

    def _last_words(self) -> str:
        self.log.seek(0)
        return " / ".join(self.log.read().splitlines()[-3:]) or "no message"


@functools.cache
def one_core() -> str:
    """Return a library that, loaded before others, tells C++ of a single core; nothing where there is no such thing."""
    if platform.system() != "Linux":
        return ""
    folder = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    source, library = Path(folder, "one_core.c"), Path(folder, "one_core.so")
    source.write_text(ONE_CORE)
    subprocess.run([*find_compiler().command, "-shared", "-fPIC", "-o", library, source], check=True)
    return str(library)


def _stay_on_one_core() -> None:
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


class Field:
    """Those who take part in one comparison.

    Parameters
    ----------
    entries
        The masters.
    pythons
        The interpreter of a driver that does not run in ours; nothing if there is none that could run it.
    robots
        How many each is to run.

    Attributes
    ----------
    workers : dict
        Those who are still in it, by name.
    out : dict
        Why others are not.
    """

    def __init__(self, entries: Iterable[Entry], pythons: Mapping[str, str], robots: int) -> None:
        self.workers: dict[str, Worker] = {}
        self.out: dict[str, str] = {}
        for entry in entries:
            python = pythons.get(entry.driver, sys.executable)
            if robots > entry.most:
                self.out[entry.name] = f"not with so many: {entry.why}"
            elif not python:
                self.out[entry.name] = "it could not be installed"
            else:
                self.workers[entry.name] = Worker(entry, python)

    def each(self, action: Callable[[Worker], T]) -> dict[str, T]:
        """Do something with each, one after the other; who fails takes no further part."""
        results = {}
        for name, worker in list(self.workers.items()):
            try:
                results[name] = action(worker)
            except Failed as error:
                self.drop(name, str(error))
        return results

    def drop(self, name: str, why: str) -> None:
        """Let one take no further part."""
        self.out[name] = why
        print(f"    {name}: {why}", file=sys.stderr, flush=True)
        self.workers.pop(name).end()

    def take_turns(self, rounds: int, measure: Callable[[Worker], float]) -> dict[str, float]:
        """Return the median of each master's measurements; every round measures all masters."""
        times: dict[str, list[float]] = {}
        for _ in range(rounds):
            for name, value in self.each(measure).items():
                times.setdefault(name, []).append(value)
        return {name: statistics.median(times[name]) for name in self.workers}

    def __enter__(self) -> "Field":
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self.workers.values():
            worker.end()
