"""Plants in a process of their own: the harness goes on when a plant crashes, exits or hangs.

It is no sandbox: the process has the user's rights.
"""

from __future__ import annotations

import os
import pkgutil
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import printable
from cosim.plant.activity import UNDONE, Doing
from cosim.plant.bells import BELL, BY_PIPE, STEP, Heard, board, board_size, core_now, fill, sleep_until, watch
from cosim.plant.companion import Companion
from cosim.plant.failures import NoInstance, PlantError
from cosim.plant.interpreter import environment, launch
from cosim.plant.local import NotStarted
from cosim.plant.message import Message
from cosim.plant.protocol import Request
from cosim.plant.saved import PlantState
from cosim.plant.spec import PlantSpec, Value
from cosim.shared_memory import MappedMemory
from cosim.undisturbed import Ending

WORKER = ("-P", "-m", "cosim.plant.worker")
"""Options of the interpreter."""

_RUNS = 20
"""How many runs are reckoned with where there are to be many."""
_SOON_OVER = 400.0
"""Simulated time [s] up to which compiled code takes longer to load than it saves, of all plants and once more.

Loading takes a second. A step from Python takes some 40 us for the process and as much for each plant.
"""


class PlantProcess(Companion):
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

    error = PlantError

    def __init__(self, specs: Sequence[PlantSpec], bell: NDArray[np.void] | None = None, often: bool = False) -> None:
        self.specs = tuple(specs)
        self.bell = np.zeros(1, BELL) if bell is None else bell
        self._ending = False
        self._failure = ""
        inputs, outputs = (
            sum(len(block.start) for block in blocks)
            for blocks in ([spec.inputs for spec in specs], [spec.outputs for spec in specs])
        )
        size = board_size(inputs, outputs)
        memory = MappedMemory(size)
        self.board = board(memory, inputs, outputs)
        plain = _plain(specs, often)

        def start(mark: str, errors: int) -> subprocess.Popen[bytes]:
            return launch((sys.executable, *WORKER), environment(mark, plain), memory.descriptors, errors)

        try:
            super().__init__(specs[0].file, start, [spec.time_limit for spec in specs])
        except OSError as error:
            raise NotStarted(0, PlantError(f"its process cannot be started: {error.strerror}")) from None
        finally:
            memory.is_inherited()
        try:
            numbers = self.board.asked, self.board.answered
            for number in numbers:
                number[1] = BY_PIPE
            fill(self.bell, (self._requests, self._replies), numbers, STEP)
            self._timer = watch(self.bell, self._awaited.descriptor, self.interval)
            self._ask(Request.START, {"memory": memory.name, "size": size, **_about(specs)})
        except BaseException:
            self._end()
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
            with self.sense("it did not start"):
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
        sleep_until(self.board.answered)
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
            with self.sense(failed):
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
        self._receive(UNDONE[Doing.CHANGE])

    def saved(self, index: int) -> PlantState:
        """Return the state of a plant at a communication point.

        Raises
        ------
        PlantError
            The FMU does not return it, or the process ended.
        """
        failed = UNDONE[Doing.SAVE]
        self._ask(Request.SAVE, [index])
        told = self._receive(failed)
        with self.sense(failed):
            return PlantState.from_json(told)

    def restore(self, index: int, state: PlantState) -> None:
        """Let a plant that has just been started go on from a saved state.

        Raises
        ------
        PlantError
            The FMU refuses it, or the process ended.
        """
        self._ask(Request.RESTORE, [index, state.to_json()])
        self._receive("did not take up the state that it has saved")

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
            with self.sense(failed):
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
            self._end()
            self._awaited.close()
            if self._timer >= 0:
                os.close(self._timer)

    @property
    def _culprit(self) -> int:
        """The plant whose FMU is called; the first one if there is none, or no sense in what the process tells."""
        current = int(self.board.activity.current[0])
        return current if 0 <= current < len(self.specs) else 0

    @property
    def _last_words(self) -> list[str]:
        return self.board.activity.last_words


def end(processes: Sequence[PlantProcess]) -> None:
    """Close processes that end side by side."""
    with Ending() as closing:
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
