"""A plant in a process of its own: whatever it does there, the harness goes on.

This keeps the harness from a crash, an exit or a hang. It is no sandbox: the process may do what the user may.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import printable
from cosim.plant.outcome import PlantError
from cosim.plant.protocol import CHANGE, DONE, END, HEADER, MAX_TEXT, START, STEP, exactly, send
from cosim.plant.spec import PlantSpec, Value

_LAUNCH_LIMIT = 60.0
"""How long [s] the interpreter of a new process may take to be there, besides the plant's own time limit."""


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
        What it returned at the start.
    """

    def __init__(self, spec: PlantSpec) -> None:
        self.spec = spec
        self.first_outputs: list[float] = []
        self._messages = ""
        environment = {
            **os.environ,
            "NUMBA_DISABLE_JIT": "1",
        }  # compiling for one plant would take longer than it saves
        paths = [str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
        environment["PYTHONPATH"] = os.pathsep.join(path for path in paths if path)
        options: dict[str, Any] = (
            {"start_new_session": True}  # Ctrl-C is the harness's
            if os.name == "posix"
            else {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}  # type: ignore[attr-defined]
        )
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "cosim.plant.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            bufsize=0,
            **options,
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._requests, self._replies = self._process.stdin.fileno(), self._process.stdout.fileno()
        self._watchdog = _Watchdog(self._process, spec.time_limit / 10)
        self._watchdog.allow(_LAUNCH_LIMIT + spec.time_limit)
        self._send(START, spec.to_json())

    def wait_until_started(self) -> None:
        """Wait for the plant.

        Raises
        ------
        PlantError
            It cannot be started.
        """
        numbers = self._receive("start", len(self.spec.outputs.start))
        self.first_outputs = numbers.tolist()

    def begin(self, time: float, step: float, inputs: NDArray[np.float64]) -> None:
        """Let the plant begin a step; it goes on beside the harness."""
        self._watchdog.allow(self.spec.time_limit)
        self._send(STEP, np.concatenate(([time, step], inputs)).tobytes())

    def finish(self, outputs: NDArray[np.float64]) -> None:
        """Wait for the end of the step and write the outputs.

        Raises
        ------
        PlantError
            The plant failed, its process ended, or the time limit has passed.
        """
        outputs[:] = self._receive("complete the step", len(outputs))

    def change(self, values: Sequence[Value]) -> None:
        """Give parameters other values at a communication point.

        Raises
        ------
        PlantError
            The FMU refuses a value, or the process ended.
        """
        self._watchdog.allow(self.spec.time_limit)
        self._send(CHANGE, json.dumps([asdict(value) for value in values]).encode())
        self._receive("change its parameters", 0)

    def take_messages(self) -> str:
        """Return what the FMU has logged since the last time."""
        said, self._messages = self._messages, ""
        return said

    def close(self) -> None:
        """End the plant, within its time limit, and its process."""
        if self._process.poll() is None and not self._watchdog.expired:
            with suppress(PlantError):
                self._watchdog.allow(self.spec.time_limit)
                self._send(END, b"")
                self._receive("end", 0)
        self._watchdog.stop()
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()

    def _send(self, kind: int, body: bytes) -> None:
        with suppress(BrokenPipeError):  # the process has ended: reading its reply will tell how
            send(self._requests, kind, body)

    def _receive(self, what: str, numbers: int) -> NDArray[np.float64]:
        """Return the numbers of a reply, of which nothing is trusted, and keep its messages."""
        kind, length = HEADER.unpack(self._exactly(HEADER.size, what))
        if length > 8 * numbers + MAX_TEXT or (kind == DONE and length < 8 * numbers):
            raise PlantError("has answered something that no plant would, through the pipe of its process")
        body = self._exactly(length, what)
        self._watchdog.rest()
        size = 8 * numbers if kind == DONE else 0
        said = printable(body[size:].decode("utf-8", "replace"))
        if kind != DONE:
            raise PlantError(said)
        if said:
            self._messages = f"{self._messages}; {said}" if self._messages else said
        return np.frombuffer(body[:size], dtype=np.float64)

    def _exactly(self, length: int, what: str) -> bytes:
        data = exactly(self._replies, length)
        if data is None:
            raise PlantError(self._ended(what))
        return data

    def _ended(self, what: str) -> str:
        """Say how the process has ended."""
        try:
            status = self._process.wait(timeout=5)
        except subprocess.TimeoutExpired:  # it has closed its pipe and goes on
            return f"did not {what}: its process has closed the pipe to the harness"
        if self._watchdog.expired:
            return f"did not {what} within {self.spec.time_limit:g} s; its process was ended"
        if status < 0:
            name = signal.Signals(-status).name if -status in set(signal.Signals) else f"signal {-status}"
            return f"did not {what}: its process crashed ({name})"
        return f"did not {what}: its process exited with status {status}"


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
        """Let the process wait for the harness for as long as it likes."""
        self._deadline = float("inf")

    def stop(self) -> None:
        """End the watch."""
        self._stopped.set()

    def _watch(self) -> None:
        while not self._stopped.wait(self._interval):
            if time.monotonic() > self._deadline:
                self.expired = True
                self._process.kill()
                return
