"""A process beside the harness that is asked and answers, within its time limit or not, until it ends."""

from __future__ import annotations

import json
import os
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from enum import IntEnum
from typing import Any

from cosim import process_tree
from cosim.errors import printable
from cosim.plant.awaiting import Awaited
from cosim.plant.interpreter import how_it_ended, kill, kill_only, wait
from cosim.plant.printed import LOG, Printed
from cosim.plant.protocol import HEADER, MOST, Reply, send
from cosim.undisturbed import disturbed

_LAUNCH_LIMIT = 60.0
"""Time limit [s] for the interpreter of a new process to start, before the time limit of its work counts."""
_EXIT_LIMIT = 5.0
"""Time limit [s] for a process that has closed its pipes to exit."""


class Companion:
    """A process that answers requests, one at a time, by frames of `cosim.plant.protocol`; none of it is trusted.

    It is made within `undisturbed`: a process that nobody knows would be left.

    Parameters
    ----------
    whose
        Before each line that it prints.
    start
        Starts it, with its mark in the environment, and a descriptor for its standard error.
    limits
        Time limits [s] of its parts, such as the plants that it runs.
    log
        Where that goes which it prints.

    Attributes
    ----------
    error : type
        Of what is raised when it fails: its subject is the process, or a part of it.

    Raises
    ------
    OSError
        The system refuses another process.
    """

    error: type[Exception] = Exception

    def __init__(
        self,
        whose: str,
        start: Callable[[str, int], subprocess.Popen[bytes]],
        limits: Sequence[float],
        log: Any = LOG,
    ) -> None:
        self._limits = list(limits)
        self._launching = True  # until its interpreter has started
        self._waits = False  # whether it waits for a request
        self._closed = False
        self._expired: float | None = None
        self._seen, self._since = -1, time.monotonic()
        self._mark = process_tree.new_mark()
        self._printed = Printed(whose, log)
        self._process = self._printed.of(lambda pipe: start(self._mark, pipe))
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._requests, self._replies = self._process.stdin.fileno(), self._process.stdout.fileno()
        self._awaited = Awaited(self._process.pid, self._replies)

    @property
    def number(self) -> int:
        """The system's number of the process."""
        return self._process.pid

    @property
    def interval(self) -> float:
        """The time [s] after which it is looked at again whether it takes too long."""
        return min(max(min(self._limits) / 10, 0.02), 0.5)

    def _end(self) -> None:
        """End it at once, with everything that it has started."""
        kill(self._process, self._mark)
        self._printed.close()

    def _takes(self, seconds: float) -> None:
        """Take notice of how long its work has taken so far."""

    # Requests and replies -----------------------------------------------------------------------------------

    @property
    def _culprit(self) -> int:
        """The part that is at work; the first one if there is none, or no sense in what the process tells."""
        return 0

    @property
    def _limit(self) -> float:
        """The time limit [s] of what it does now."""
        return _LAUNCH_LIMIT if self._launching else self._limits[self._culprit]

    @property
    def _last_words(self) -> list[str]:
        """The last messages before its end."""
        return []

    def _ask(self, kind: IntEnum, about: object = None) -> None:
        self._working()
        with suppress(OSError):  # the process has ended: reading its reply shows how
            send(self._requests, kind, b"" if about is None else json.dumps(about).encode())

    def _working(self) -> None:
        """Note that the process works from now on."""
        self._waits = False
        self._seen, self._since = self._culprit, time.monotonic()

    def _receive(self, failed: str) -> Any:
        """Return what is in a reply, which is not trusted."""
        kind, told = self._reply(failed)
        if kind == Reply.FAILED:
            raise self.error(printable(str(told)))
        return told

    def _reply(self, failed: str) -> tuple[Reply, Any]:
        """Return the kind of a reply, and what is in it."""
        kind, length = HEADER.unpack(self._exactly(HEADER.size, failed))
        if length > MOST:
            raise self._nonsense(failed)
        body = self._exactly(length, failed)
        with self.sense(failed):
            reply, told = Reply(kind), json.loads(body) if body else None
        self._waits = True
        return reply, told

    def _exactly(self, length: int, failed: str) -> bytes:
        data = b""
        while len(data) < length and self._is_readable():
            part = os.read(self._replies, length - len(data))
            if not part:
                break
            data += part
        if len(data) < length:
            raise self._ended(failed)
        return data

    def _is_readable(self) -> bool:
        """Wait until a reply can be read, be it to find the end; False if the process has ended or takes too long."""
        while (ready := self._awaited.wait(self.interval)) is None:
            current, now = self._culprit, time.monotonic()
            if current != self._seen and len(self._limits) > 1:  # each of the parts may take its time
                self._seen, self._since = current, now
            self._takes(now - self._since)
            if disturbed():
                kill_only(self._process, self._mark)
                return False
            if now - self._since > self._limit:
                self._expired = self._limit
                kill_only(self._process, self._mark)
                return False
        return ready

    @contextmanager
    def sense(self, failed: str) -> Iterator[None]:
        """Raise an error if what the process has told makes no sense."""
        try:
            yield
        except (ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError):
            raise self._nonsense(failed) from None

    def _nonsense(self, failed: str) -> Exception:
        self._waits = False
        return self.error(f"{failed}: its process answers with bytes that are no reply")

    def _ended(self, failed: str) -> Exception:
        self._waits = False
        try:
            how = how_it_ended(wait(self._process, self._mark, _EXIT_LIMIT), self._expired)
        except subprocess.TimeoutExpired:
            how = ": its process has closed the pipe to the harness"
        last = self._last_words
        return self.error(f"{failed}{how}" + (f"; it had logged: {'; '.join(last)}" if last else ""))
