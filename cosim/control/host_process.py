"""The process of a host, as the harness sees it: nothing of what it answers is trusted."""

from __future__ import annotations

import os
import secrets
import subprocess
import threading
from collections.abc import Sequence
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim import compiling
from cosim.control import host
from cosim.control.environment import Environment
from cosim.errors import printable
from cosim.plant.bells import BELL, BY_PIPE, STEP, Heard, core_now, fill, sleep_until, watch
from cosim.plant.companion import Companion
from cosim.plant.interpreter import start
from cosim.plant.printed import LAW_LOG
from cosim.plant.protocol import Reply
from cosim.shared_memory import LaterMemory

START_LIMIT = 300.0
"""Time limit [s] for all that comes before the second tick: a law may be compiled there."""
_PREFACE = 1 << 16
"""Bytes that modules may print before the host begins."""


class Request(IntEnum):
    """What a host is asked for, see `cosim.control.host`."""

    DESCRIBE, STEP, GAINS, TEAMS, FAILURE, NOT_FINITE, RESET, STATE, GO_ON, LIST = range(10)


class HostError(Exception):
    """A host failed; what it was asked for is the subject of the text."""


class Refused(Exception):
    """A host does not do what it was asked for: a sentence, and the place of what is wrong, if it has told one."""

    def __init__(self, sentence: str, place: int = -1) -> None:
        super().__init__(sentence, place)  # so that it pickles
        self.place = place

    def __str__(self) -> str:
        return str(self.args[0])


class HostProcess(Companion):
    """The process of a host; it starts at once, and `greeting` waits for it.

    Parameters
    ----------
    environment
        Where its interpreter is.

    Attributes
    ----------
    bell : ndarray
        Its record for `cosim.plant.bells`; of use from `use` on.
    board : Board or None
        What it shares; from `use` on.

    Raises
    ------
    OSError
        The system does not start it.
    """

    error = HostError

    def __init__(self, environment: Environment) -> None:
        self.bell = np.zeros(1, BELL)
        self.board: host.Board | None = None
        self._memory = LaterMemory()
        self._timer = -1
        self._begins = f"formation {secrets.token_hex(16)}\n"
        self._first = True  # until its first tick has ended
        self._fault = ""
        main_thread = threading.current_thread() is threading.main_thread()
        command = [
            *(str(environment.interpreter), "-I", "-X", "utf8", str(Path(host.__file__))),
            *(str(os.getpid()), str(int(main_thread)), self._begins),
        ]

        def begin(mark: str, errors: int) -> subprocess.Popen[bytes]:
            return start(command, {**os.environ, mark: "1"}, self._memory.descriptors, errors)

        try:
            super().__init__(f"controllers in {environment.folder}", begin, [START_LIMIT], LAW_LOG)
        except BaseException:
            self._memory.close()
            raise

    def greeting(self) -> dict[str, Any]:
        """Wait until it has started; return what it says of itself."""
        failed = "did not start"
        begins, read = self._begins.encode(), b""
        while not read.endswith(begins):
            if len(read) > _PREFACE:
                raise self._nonsense(failed)
            begun = next(n for n in range(len(begins) - 1, -1, -1) if read.endswith(begins[:n]))
            read += self._exactly(len(begins) - begun, failed)  # and nothing of what comes after it
        self._working()
        told = self._receive(failed)
        self._launching = False
        return self.sensible(told, failed)

    @property
    def can_serve(self) -> bool:
        """Whether it waits, and has failed in nothing."""
        return self._waits and not self._launching and self.heard == Heard.DONE

    def request(self, kind: Request, about: object, failed: str) -> Any:
        """Return its answer to a request, which is not trusted.

        Parameters
        ----------
        kind, about
            The request.
        failed
            What it has not done if it fails, such as "did not start".

        Raises
        ------
        Refused
            It does not do that.
        HostError
            It has failed.
        """
        self._ask(kind, about)
        reply, told = self._reply(failed)
        if reply != Reply.FAILED:
            return told
        with self.sense(failed):
            place = told["place"]
            raise Refused(printable(str(told["said"])), place if isinstance(place, int) else -1)

    def sensible(self, told: Any, failed: str) -> dict[str, Any]:
        """Return an answer that is to be an object."""
        if not isinstance(told, dict):
            raise self._nonsense(failed)
        return told

    def map(self, numbers: int) -> tuple[host.Board, dict[str, Any]]:
        """Return a board with so many numbers, and where it is for the process.

        Raises
        ------
        HostError
            It has failed.
        """
        if self.board is not None:  # it may look at the memory of the run before until it has answered this
            self.request(Request.FAILURE, None, "did not end the run before")
        size = host.board_size(numbers)
        memory, name = self._memory.map(size)
        board = host.Board(memory, numbers)
        for array in (board.current, board.told, board.tells, board.asked, board.answered, board.numbers):
            array[:] = 0
        board.current[0] = -1
        board.asked[1] = board.answered[1] = BY_PIPE
        self.board = board
        return board, {"memory": name, "size": size, "numbers": numbers}

    def use(self, limits: Sequence[float]) -> None:
        """Run ticks with the board that was mapped last, each team within its time limit [s]."""
        assert self.board is not None
        self._limits, self._first, self._fault = list(limits), True, ""
        self.ring_by(np.zeros(1, BELL))

    def ring_by(self, bell: NDArray[np.void]) -> None:
        """Ring by another record from now on, an array of one."""
        assert self.board is not None
        self.bell = bell
        fill(bell, (self._requests, self._replies), (self.board.asked, self.board.answered), STEP)
        if self._timer >= 0:
            os.close(self._timer)
        self._timer = watch(bell, self._awaited.descriptor, self.interval)
        bell["heard"] = Heard.DONE

    def begin(self, how: int) -> None:
        """Let it run a tick; it goes on beside the harness."""
        assert self.board is not None
        self.board.told[0] = how
        self.board.told[2:].view(np.int64)[0] = core_now()
        self.bell["heard"] = Heard.NOTHING
        sleep_until(self.board.answered)
        self._ask(Request.STEP)

    def finish(self) -> None:
        """Wait for the end of the tick, and take down how it has ended."""
        assert self.board is not None
        self._working()
        self.bell["heard"] = Heard.GONE
        try:
            self._reply("did not complete the tick")
        except HostError as error:
            self._fault = str(error)
        else:
            self._first = False
            self.bell["heard"] = Heard.FAILED if self.board.tells[0] else Heard.DONE

    @property
    def heard(self) -> int:
        """What is heard of its last tick, of `Heard`."""
        return int(self.bell["heard"][0])

    def failure(self) -> dict[str, Any]:
        """Return what a law tells of its failure in the last tick.

        Raises
        ------
        HostError
            The process itself has failed.
        """
        failed = "did not complete the tick"
        if self._fault:
            raise HostError(self._fault)
        if self.heard == Heard.NONSENSE:
            raise self._nonsense(failed)
        if self.heard == Heard.GONE:
            raise self._ended(failed)
        return self.sensible(self.request(Request.FAILURE, None, failed), failed)

    @property
    def culprit(self) -> int | None:
        """The team whose law is at work; None if there is none, or no sense in what the process tells."""
        current = -1 if self.board is None else int(self.board.current[0])
        return current if 0 <= current < len(self._limits) else None

    def close(self) -> None:
        """End it at once."""
        if self._closed:
            return
        self._closed = True
        self._end()
        self._awaited.close()
        self._memory.close()
        if self._timer >= 0:
            os.close(self._timer)

    def _takes(self, seconds: float) -> None:
        if self._first and not self._launching and seconds > compiling.LONG:  # what else a law may do then
            compiling.tell()

    @property
    def _culprit(self) -> int:
        return self.culprit or 0

    @property
    def _limit(self) -> float:
        limit = self._limits[self._culprit]
        return max(limit, START_LIMIT) if self._launching or self._first else limit
