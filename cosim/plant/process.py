"""A plant in a process of its own: the harness goes on when the plant crashes, exits or hangs.

It is no sandbox: the process has the user's rights.
"""

from __future__ import annotations

import json
import os
import select
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

from cosim import process_tree
from cosim.compiled import PLAIN
from cosim.errors import printable
from cosim.plant.failures import PlantError
from cosim.plant.message import LastMessages, Message
from cosim.plant.protocol import HEADER, MAX_SAID, MAX_TEXT, Reply, Request, send
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
        self._mark = process_tree.new_mark()
        self._process = _launched(self._mark)
        try:
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            self._requests, self._replies = self._process.stdin.fileno(), self._process.stdout.fileno()
            self._end = _End(self._process, self._replies)
            self._watchdog = _Watchdog(self._process, self._mark, spec.time_limit / 10)
            self._watchdog.allow(self._limit)
            self._send(Request.START, spec.to_json())
        except BaseException:
            kill(self._process, self._mark)
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
            kill(self._process, self._mark)
            self._end.close()

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
        data = b""
        while len(data) < length and not self._watchdog.expired and self._end.wait():
            part = os.read(self._replies, length - len(data))
            if not part:
                break
            data += part
        if len(data) < length:
            last = f"; it had logged: {'; '.join(self._last_words)}" if self._last_words else ""
            raise PlantError(f"{failed}{self._how_it_ended()}{last}")
        return data

    def _how_it_ended(self) -> str:
        try:
            status = self._process.wait(_EXIT_LIMIT)
        except subprocess.TimeoutExpired:
            return ": its process has closed the pipe to the harness"
        return how_it_ended(status, self._limit if self._watchdog.expired else None)


def how_it_ended(status: int, limit: float | None = None) -> str:
    """Return how a process ended, in words that follow what it did not do.

    Parameters
    ----------
    status
        Its exit status; of a signal, the negative number.
    limit
        The time [s] after which it was to be ended; None if it was within its limit.
    """
    if limit is not None and status == -signal.SIGKILL:  # and not by itself a moment before
        return f" within {limit:g} s; its process was ended"
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


def environment(mark: str) -> dict[str, str]:
    """Return the environment of a process that runs one FMU: it finds this package where the harness has found it.

    Parameters
    ----------
    mark
        That of the process, by which `kill` knows what it has started.
    """
    variables = {**os.environ, PLAIN: "1", mark: "1"}  # compiling for one plant would take longer than it saves
    root = str(Path(__file__).parents[2])
    if root not in (*site.getsitepackages(), site.getusersitepackages()):  # of which some may hide standard modules
        variables["PYTHONPATH"] = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    return variables


def _launched(mark: str) -> subprocess.Popen[bytes]:
    try:
        return subprocess.Popen(
            [sys.executable, *WORKER, str(os.getpid()), *(os.path.abspath(folder) for folder in sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment(mark),
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


def kill(process: subprocess.Popen[bytes], mark: str) -> None:
    """End a process with everything that it has started, and wait for it."""
    _kill(process, mark)
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(OSError):
                pipe.close()


def _kill(process: subprocess.Popen[bytes], mark: str) -> None:
    process_tree.end(process.pid, mark)
    process.kill()


def _text(body: bytes) -> str:
    return printable(body.decode("utf-8", "replace"))


class _End:
    """Notices a reply of a process, or its end, whichever comes first: something that it started may hold its pipe.

    Only Linux tells of the end in this way; elsewhere the end of the pipe has to do.
    """

    def __init__(self, process: subprocess.Popen[bytes], replies: int) -> None:
        self._replies = replies
        self._descriptor = -1
        if sys.platform == "linux":
            with suppress(OSError):
                self._descriptor = os.pidfd_open(process.pid)
        if self._descriptor >= 0:
            self._either, self._reply = select.poll(), select.poll()
            self._either.register(self._descriptor, select.POLLIN)
            for poll in (self._either, self._reply):
                poll.register(replies, select.POLLIN)

    def wait(self) -> bool:
        """Wait for either; return whether the pipe can be read, be it to find its end."""
        if self._descriptor < 0 or any(ready == self._replies for ready, _ in self._either.poll()):
            return True
        return bool(self._reply.poll(0))

    def close(self) -> None:
        """Watch no more."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


class _Watchdog:
    """Ends a process that takes longer than it is allowed, with everything that it has started.

    Parameters
    ----------
    process, mark
        The process, and the mark of what it starts.
    interval
        How often to look [s]; at least 0.02 s, at most 0.5 s.
    """

    def __init__(self, process: subprocess.Popen[bytes], mark: str, interval: float) -> None:
        self.expired = False
        self._process = process
        self._mark = mark
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
                _kill(self._process, self._mark)
                return
