"""Plants in a process of their own: the harness goes on when a plant crashes, exits or hangs.

It is no sandbox: the process has the user's rights.
"""

from __future__ import annotations

import json
import os
import pkgutil
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim import process_tree
from cosim.errors import printable
from cosim.plant.awaiting import Awaited
from cosim.plant.bells import BELL, BY_PIPE, STEP, Heard, board, board_size, core_now, fill, watch
from cosim.plant.failures import NoInstance, PlantError
from cosim.plant.interpreter import environment, how_it_ended, kill, kill_only, launch
from cosim.plant.local import NotStarted
from cosim.plant.message import Message
from cosim.plant.printed import Printed
from cosim.plant.protocol import HEADER, MOST, Reply, Request, send
from cosim.plant.spec import PlantSpec, Value
from cosim.shared_memory import MappedMemory
from cosim.undisturbed import undisturbed

WORKER = ("-P", "-m", "cosim.plant.worker")
"""Options of the interpreter."""

_LAUNCH_LIMIT = 60.0
"""Time limit [s] for the interpreter of a new process to start, before a plant's own time limit counts."""
_EXIT_LIMIT = 5.0
"""Time limit [s] for a process that has closed its pipes to exit."""
_RUNS = 20
"""How many runs are reckoned with where there are to be many."""
_SOON_OVER = 400.0
"""Simulated time [s] up to which compiled code takes longer to load than it saves, of all plants and once more.

Loading takes a second. A step from Python takes some 40 us for the process and as much for each plant.
"""


class PlantProcess:
    """Plants in a process of their own, all of one FMU.

    The process starts at once; `wait_until_started` waits for it, so that several can start side by side. A step is
    begun and awaited by `begin` and `finish`, or by the compiled code of `cosim.plant.bells`.

    Parameters
    ----------
    specs
        The plants.
    bell
        An array with one record, which the process fills.
    often
        Whether it is to serve many runs.

    Attributes
    ----------
    board : Board
        Its inputs are given before a step, its outputs are those of the last step, or of the start.

    Raises
    ------
    NotStarted
        The system refuses another process.
    """

    def __init__(self, specs: Sequence[PlantSpec], bell: NDArray[np.void] | None = None, often: bool = False) -> None:
        self.specs = tuple(specs)
        self.bell = np.zeros(1, BELL) if bell is None else bell
        self._limits = [spec.time_limit for spec in specs]
        self._launching = True  # until its interpreter has started
        self._waits = False  # whether it waits for a request
        self._ending = self._closed = False
        self._expired: float | None = None
        self._failure = ""
        inputs, outputs = (
            sum(len(block.start) for block in blocks)
            for blocks in ([spec.inputs for spec in specs], [spec.outputs for spec in specs])
        )
        size = board_size(inputs, outputs)
        memory = MappedMemory(size)
        self.board = board(memory, inputs, outputs)
        self._mark = process_tree.new_mark()
        try:
            self._printed = Printed(specs[0].file)
            variables = environment(self._mark, plain=_plain(specs, often))
            with undisturbed():  # a process that nobody knows would be left
                self._process = self._printed.of(
                    lambda pipe: launch(WORKER, variables, memory.descriptors, errors=pipe)
                )
        except OSError as error:
            raise NotStarted(0, PlantError(f"its process cannot be started: {error.strerror}")) from None
        except KeyboardInterrupt:
            if hasattr(self, "_process"):
                kill(self._process, self._mark)
                self._printed.close()
            raise
        finally:
            memory.is_inherited()
        try:
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            self._requests, self._replies = self._process.stdin.fileno(), self._process.stdout.fileno()
            self._awaited = Awaited(self._process.pid, self._replies)
            self._interval = min(max(min(self._limits) / 10, 0.02), 0.5)
            numbers = self.board.asked, self.board.answered
            for number in numbers:
                number[1] = BY_PIPE
            fill(self.bell, (self._requests, self._replies), numbers, STEP)
            self._timer = watch(self.bell, self._awaited.descriptor, self._interval)
            self._ask(Request.START, {"memory": memory.name, "size": size, **_about(specs)})
        except BaseException:
            kill(self._process, self._mark)
            self._printed.close()
            raise

    def wait_until_started(self) -> None:
        """Wait for the plants.

        Raises
        ------
        NotStarted
            One of them cannot be started.
        """
        try:
            if self._launching:
                self._receive("its process did not start")
                self._launching = False
                self._working()
            told = self._receive("it did not start")
            if told is None:
                return
            with self._sense("it did not start"):
                index, said, no_instance = int(told[0]), printable(str(told[1])), bool(told[2])
                self.specs[index]
        except PlantError as error:
            raise NotStarted(self._culprit, error) from None
        raise NotStarted(index, (NoInstance if no_instance else PlantError)(said))

    @property
    def can_restart(self) -> bool:
        """Whether it waits, and has failed in nothing."""
        return self._waits and self.heard == Heard.DONE

    def restart(self, specs: Sequence[PlantSpec]) -> None:
        """Let the plants, which `can_restart`, begin another run with other values; `wait_until_started` as before.

        Parameters
        ----------
        specs
            The same FMUs for the same robots.
        """
        self.specs = tuple(specs)
        self._ask(Request.RESTART, _about(specs))

    def begin(self, time: float, step: float) -> None:
        """Let the plants begin a step; they go on beside the harness."""
        self.board.told[:2] = time, step
        self.board.told[2:].view(np.int64)[0] = core_now()
        self.bell["heard"] = Heard.NOTHING
        self.board.answered[1] = BY_PIPE
        self._ask(Request.STEP)

    def finish(self) -> None:
        """Wait for the end of the step, and take down how it has ended."""
        self._working()
        self.bell["heard"] = Heard.GONE
        try:
            self._receive("did not complete the step")
        except PlantError as error:
            self._failure = str(error)
        else:
            self.bell["heard"] = Heard.FAILED if self.board.tells[0] else Heard.DONE

    @property
    def number(self) -> int:
        """The system's number of the process."""
        return self._process.pid

    @property
    def heard(self) -> int:
        """What is heard of its last step, of `Heard`."""
        return int(self.bell["heard"][0])

    def failures(self) -> dict[int, str]:
        """Return the failure of each plant that has failed in the last step, by its place among the plants."""
        if self.heard == Heard.DONE:
            return {}
        failed = "did not complete the step"
        try:
            if self._failure:
                raise PlantError(self._failure)
            if self.heard == Heard.NONSENSE:
                raise self._nonsense(failed)
            if self.heard == Heard.GONE:
                raise self._ended(failed)
            self._ask(Request.FAILURES)
            told = self._receive(failed)
            with self._sense(failed):
                failures = {range(len(self.specs))[int(index)]: printable(str(said)) for index, said in told}
                if not failures:
                    raise ValueError
                return failures
        except PlantError as error:
            return {self._culprit: str(error)}

    def change(self, index: int, values: Sequence[Value]) -> None:
        """Give parameters of a plant other values at a communication point.

        Raises
        ------
        PlantError
            The FMU refuses a value, or the process ended.
        """
        self._ask(Request.CHANGE, [index, [asdict(value) for value in values]])
        self._receive("did not change its parameters")

    def messages(self) -> list[tuple[int, str, list[Message]]]:
        """Take the FMUs' messages since the last time: by plant, one text, and all that is not taken yet."""
        if not self.board.activity.pending[0]:
            return []
        if not self._waits:
            last = self.board.activity.last_messages
            self.board.activity.pending[0] = 0
            return [(self._culprit, "", last)]
        failed = "did not tell its messages"
        try:
            self._ask(Request.MESSAGES)
            told = self._receive(failed)
            with self._sense(failed):
                return [
                    (range(len(self.specs))[int(index)], printable(str(said)), [_message(*about) for about in data])
                    for index, said, data in told
                ]
        except PlantError:
            return []

    def begin_to_end(self) -> None:
        """Let the plants end, if they wait; they go on beside the harness, and `close` waits for them."""
        if self._waits and not self._ending:
            self._ask(Request.END)
            self._ending = True

    def close(self) -> None:
        """End the plants and their process: within the time limit if it waits for a request, else at once."""
        if self._closed:
            return
        self._closed = True
        try:
            self.begin_to_end()
            if self._ending:
                with suppress(PlantError):
                    self._receive("did not end")
        finally:
            kill(self._process, self._mark)
            self._printed.close()
            self._awaited.close()
            if self._timer >= 0:
                os.close(self._timer)

    # Requests and replies -----------------------------------------------------------------------------------

    def _ask(self, kind: Request, about: object = None) -> None:
        self._working()
        with suppress(OSError):  # the process has ended: reading its reply shows how
            send(self._requests, kind, b"" if about is None else json.dumps(about).encode())

    def _working(self) -> None:
        """Note that the process works from now on."""
        self._waits = False
        self._seen, self._since = self._culprit, time.monotonic()

    def _receive(self, failed: str) -> Any:
        """Return what is in a reply, which is not trusted."""
        kind, length = HEADER.unpack(self._exactly(HEADER.size, failed))
        if length > MOST:
            raise self._nonsense(failed)
        body = self._exactly(length, failed)
        with self._sense(failed):
            kind, told = Reply(kind), json.loads(body) if body else None
        self._waits = True
        if kind == Reply.FAILED:
            raise PlantError(printable(str(told)))
        return told

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
        while (ready := self._awaited.wait(self._interval)) is None:
            current, now = self._culprit, time.monotonic()
            if current != self._seen and len(self.specs) > 1:  # each of the plants may take its time
                self._seen, self._since = current, now
            limit = _LAUNCH_LIMIT if self._launching else self._limits[current]
            if now - self._since > limit:
                self._expired = limit
                kill_only(self._process, self._mark)
                return False
        return ready

    @property
    def _culprit(self) -> int:
        """The plant whose FMU is called; the first one if there is none, or no sense in what the process tells."""
        current = int(self.board.activity.current[0])
        return current if 0 <= current < len(self.specs) else 0

    @contextmanager
    def _sense(self, failed: str) -> Iterator[None]:
        """Raise PlantError if what the process has told makes no sense."""
        try:
            yield
        except (ValueError, TypeError, LookupError, RecursionError):
            raise self._nonsense(failed) from None

    def _nonsense(self, failed: str) -> PlantError:
        self._waits = False
        return PlantError(f"{failed}: its process answers with bytes that are no reply")

    def _ended(self, failed: str) -> PlantError:
        self._waits = False
        try:
            how = how_it_ended(self._process.wait(_EXIT_LIMIT), self._expired)
        except subprocess.TimeoutExpired:
            how = ": its process has closed the pipe to the harness"
        last = self.board.activity.last_words
        return PlantError(f"{failed}{how}" + (f"; it had logged: {'; '.join(last)}" if last else ""))


def end(processes: Sequence[PlantProcess]) -> None:
    """Close processes that end side by side."""
    with ExitStack() as closing:
        for process in processes:
            closing.callback(process.close)
        for process in processes:
            process.begin_to_end()


def _about(specs: Sequence[PlantSpec]) -> dict[str, Any]:
    return {"specs": [spec.to_json().decode() for spec in specs]}


def _plain(specs: Sequence[PlantSpec], often: bool) -> bool:
    """Return whether a process does without compiled code, as that gains little or the FMU has Python code."""
    if (len(specs) + 1) * specs[0].stop_time * (_RUNS if often else 1) <= _SOON_OVER:
        return True
    return any(pkgutil.iter_modules([str(Path(specs[0].directory, "resources"))]))


def _message(status: object, category: object, text: object, count: int) -> Message:
    return Message(str(status), str(category), str(text), int(count))
