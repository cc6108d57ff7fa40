"""A plant in a process of its own: the harness goes on when the plant crashes, exits or hangs.

It is no sandbox: the process has the user's rights.
"""

from __future__ import annotations

import json
import os
import signal
import site
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import PLAIN
from cosim.errors import printable
from cosim.plant.failures import PlantError
from cosim.plant.message import LastMessages, Message
from cosim.plant.protocol import HEADER, MAX_SAID, MAX_TEXT, Reply, Request, exactly, send
from cosim.plant.spec import PlantSpec, Value

WORKER = ("-P", "-m", "cosim.plant.worker")
"""Options of the interpreter."""

_LAUNCH_LIMIT = 60.0
"""Time limit [s] for the interpreter of a new process to start, before the plant's own time limit counts."""
_EXIT_LIMIT = 5.0
"""Time limit [s] for a process that has closed its pipes to exit."""


class ProcessPlant:
    """A plant in a process of its own, with the interface of a plant that is stepped one call at a time.

    The process starts at once; `wait_until_started` waits for it, so that several can start side by side.

    Parameters
    ----------
    spec
        The plant.

    Attributes
    ----------
    first_outputs : list of float
        Its outputs at the start.

    Raises
    ------
    PlantError
        The system refuses another process.
    """

    def __init__(self, spec: PlantSpec) -> None:
        self.spec = spec
        self.first_outputs: list[float] = []
        self._messages = ""
        self._last_words: deque[str] = deque(maxlen=MAX_SAID)
        self._data = LastMessages()
        self._waiting = False  # whether the process waits for a request
        self._ending = self._closed = False
        self._limit = _LAUNCH_LIMIT
        self._process = _launched()
        try:
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            self._requests, self._replies = self._process.stdin.fileno(), self._process.stdout.fileno()
            self._watchdog = _Watchdog(self._process, spec.time_limit / 10)
            self._watchdog.allow(self._limit)
            self._send(Request.START, spec.to_json())
        except BaseException:
            kill(self._process)
            raise

    def wait_until_started(self) -> None:
        """Wait for the plant.

        Raises
        ------
        PlantError
            It cannot be started.
        """
        self._receive("its process did not start", 0)
        self._limit = self.spec.time_limit
        self._watchdog.allow(self._limit)
        self._waiting = False
        self.first_outputs = self._receive("it did not start", len(self.spec.outputs.start)).tolist()

    def begin(self, time: float, step: float, inputs: NDArray[np.float64]) -> None:
        """Let the plant begin a step; it goes on beside the harness."""
        self._request(Request.STEP, np.concatenate(([time, step], inputs)).tobytes())

    def finish(self, outputs: NDArray[np.float64]) -> None:
        """Wait for the end of the step and write the outputs.

        Raises
        ------
        PlantError
            The plant failed, its process ended, or the time limit has passed.
        """
        outputs[:] = self._receive("did not complete the step", len(outputs))

    def change(self, values: Sequence[Value]) -> None:
        """Give parameters other values at a communication point.

        Raises
        ------
        PlantError
            The FMU refuses a value, or the process ended.
        """
        self._request(Request.CHANGE, json.dumps([asdict(value) for value in values]).encode())
        self._receive("did not change its parameters", 0)

    def take_messages(self) -> str:
        """Return the FMU's messages since the last call."""
        said, self._messages = self._messages, ""
        return said

    def take_data(self) -> list[Message]:
        """Return the messages since the last call, the first ones of each request."""
        return self._data.take()

    def begin_to_end(self) -> None:
        """Let the plant end, if it waits; it goes on beside the harness, and `close` waits for it."""
        if self._waiting:
            self._request(Request.END, b"")
            self._ending = True

    def close(self) -> None:
        """End the plant and its process: within the time limit if it waits for a request, else at once."""
        if self._closed:
            return
        self._closed = True
        try:
            if not self._ending:
                self.begin_to_end()
            if self._ending:
                with suppress(PlantError):
                    self._receive("did not end", 0)
        finally:
            self._watchdog.stop()
            kill(self._process)

    def _request(self, kind: Request, body: bytes) -> None:
        self._watchdog.allow(self._limit)
        self._waiting = False
        self._send(kind, body)

    def _send(self, kind: Request, body: bytes) -> None:
        with suppress(OSError):  # the process has ended: reading its reply shows how
            send(self._requests, kind, body)

    def _receive(self, failed: str, numbers: int) -> NDArray[np.float64]:
        """Return the numbers of a reply, which is not trusted, and keep its messages."""
        self._last_words.clear()
        kind, body = self._frame(failed, numbers)
        while kind == Reply.SAID:  # until the watchdog ends it
            message = Message.from_bytes(body)
            self._last_words.append(message.text)
            self._data.add([message])
            kind, body = self._frame(failed, numbers)
        self._watchdog.rest()
        self._waiting = True
        size = 8 * numbers if kind == Reply.DONE else 0
        said = _text(body[size:])
        if kind != Reply.DONE:
            raise PlantError(said)
        if said:
            self._messages = f"{self._messages}; {said}" if self._messages else said
        return np.frombuffer(body[:size], dtype=np.float64)

    def _frame(self, failed: str, numbers: int) -> tuple[int, bytes]:
        kind, length = HEADER.unpack(self._exactly(HEADER.size, failed))
        if length > 8 * numbers + MAX_TEXT or (kind == Reply.DONE and length < 8 * numbers):
            raise PlantError(f"{failed}: its process answers with bytes that are no reply")
        return kind, self._exactly(length, failed)

    def _exactly(self, length: int, failed: str) -> bytes:
        data = exactly(self._replies, length)
        if data is None:
            last = f"; it had logged: {'; '.join(self._last_words)}" if self._last_words else ""
            raise PlantError(f"{failed}{self._how_it_ended()}{last}")
        return data

    def _how_it_ended(self) -> str:
        try:
            status = self._process.wait(_EXIT_LIMIT)
        except subprocess.TimeoutExpired:
            return ": its process has closed the pipe to the harness"
        if self._watchdog.expired:
            return f" within {self._limit:g} s; its process was ended"
        if status < 0:
            name = signal.Signals(-status).name if -status in set(signal.Signals) else f"signal {-status}"
            return f": its process crashed ({name})"
        return f": its process exited with status {status}"


def end(plants: Iterable[ProcessPlant]) -> None:
    """Close plants that end side by side."""
    with ExitStack() as closing:
        for plant in plants:
            closing.callback(plant.close)
        for plant in plants:
            plant.begin_to_end()


def environment() -> dict[str, str]:
    """Return the environment of a process that runs one FMU: it finds this package where the harness has found it."""
    variables = {**os.environ, PLAIN: "1"}  # compiling for one plant would take longer than it saves
    root = str(Path(__file__).parents[2])
    if root not in (*site.getsitepackages(), site.getusersitepackages()):  # of which some may hide standard modules
        variables["PYTHONPATH"] = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    return variables


def _launched() -> subprocess.Popen[bytes]:
    try:
        return subprocess.Popen(
            [sys.executable, *WORKER, str(os.getpid()), *(os.path.abspath(folder) for folder in sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment(),
            stderr=None if _standard_error() else subprocess.DEVNULL,
            bufsize=0,
            start_new_session=os.name == "posix",  # Ctrl-C is the harness's
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # which Windows alone has
        )
    except OSError as error:
        raise PlantError(f"its process cannot be started: {error.strerror}") from None


def _standard_error() -> bool:
    """Return whether the harness has a standard error that a process can inherit, and no other file in its place."""
    try:
        return os.get_inheritable(2)
    except OSError:
        return False


def kill(process: subprocess.Popen[bytes]) -> None:
    """End a process with its process group, and wait for it."""
    _signal(process)
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(OSError):
                pipe.close()


def _signal(process: subprocess.Popen[bytes]) -> None:
    if os.name == "posix":
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)  # the group is its own, and outlives it
    process.kill()


def _text(body: bytes) -> str:
    return printable(body.decode("utf-8", "replace"))


class _Watchdog:
    """Ends a process that takes longer than it is allowed.

    Parameters
    ----------
    process
        The process.
    interval
        How often to look [s]; at least 0.02 s, at most 0.5 s.
    """

    def __init__(self, process: subprocess.Popen[bytes], interval: float) -> None:
        self.expired = False
        self._process = process
        self._interval = min(max(interval, 0.02), 0.5)
        self._deadline = float("inf")
        self._stopped = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def allow(self, seconds: float) -> None:
        """Let the process work for so long from now."""
        self._deadline = time.monotonic() + seconds

    def rest(self) -> None:
        """Let the process wait for the harness without a limit."""
        self._deadline = float("inf")

    def stop(self) -> None:
        """End the watch."""
        self._stopped.set()

    def _watch(self) -> None:
        while not self._stopped.wait(self._interval):
            if time.monotonic() > self._deadline:
                self.expired = True
                _signal(self._process)
                return
