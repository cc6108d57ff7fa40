"""What a fleet is about at the moment: in shared memory, another process sees it whatever happens to this one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from cosim.plant.failures import COMPLETE, FAILURES
from cosim.plant.log import Log
from cosim.plant.message import KEPT_AT_ONCE, MAX_CATEGORY, MAX_LENGTH, Message
from cosim.shared_memory import shared

_SLOT = 4 + MAX_LENGTH + MAX_CATEGORY + 32
"""Bytes of a message and its length."""


class Doing(IntEnum):
    """What a plant's FMU is called for: a step or its start, other parameters, its state."""

    STEP, CHANGE, SAVE = range(3)


UNDONE = {
    Doing.STEP: FAILURES[COMPLETE],
    Doing.CHANGE: "did not change its parameters",
    Doing.SAVE: "did not save its state",
}
"""The words of what an FMU has not done that has ended its process meanwhile; the plant is the subject."""


class Activity(NamedTuple):
    """What a fleet is about.

    Attributes
    ----------
    clock : ndarray
        Communication point and step [s]; the step is zero at the start.
    current : ndarray of int
        The plant whose FMU is called here at the moment; -1 for none.
    doing : ndarray of int
        What for, a `Doing`.
    pending : ndarray of int
        Number of messages that its FMUs have logged since they were last asked; see `Log.pending`.
    said : ndarray of uint8
        The last messages (messages, bytes), of which each number of messages modulo their number is the place.
    logged : ndarray of int
        Number of messages that its FMUs have logged.
    """

    clock: NDArray[np.float64]
    current: NDArray[np.int64]
    doing: NDArray[np.int64]
    pending: NDArray[np.int64]
    said: NDArray[np.uint8]
    logged: NDArray[np.int64]

    @contextmanager
    def of(self, plant: int, doing: Doing = Doing.STEP) -> Iterator[None]:
        """State that a plant's FMU is called in the block, and what for."""
        self.doing[0], self.current[0] = doing, plant
        try:
            yield
        finally:
            self.doing[0], self.current[0] = Doing.STEP, -1

    @property
    def undone(self) -> str:
        """What the FMU that is called has not done, in words."""
        return UNDONE.get(int(self.doing[0]), UNDONE[Doing.STEP])  # type: ignore[call-overload, no-any-return]

    @property
    def last_words(self) -> list[str]:
        """The texts of `last_messages`."""
        return [message.text for message in self.last_messages]

    @property
    def last_messages(self) -> list[Message]:
        """The messages that nobody has asked for yet, the last ones; none of it is trusted."""
        count = int(self.logged[0])
        found = []
        for number in range(max(count - min(int(self.pending[0]), KEPT_AT_ONCE), 0), count):
            slot = self.said[number % KEPT_AT_ONCE].tobytes()
            found.append(Message.from_bytes(slot[4 : 4 + int.from_bytes(slot[:4], "little")]))
        return found

    def listen(self) -> None:
        """Write the messages of all FMUs of this process from now on."""
        Log.pending = self.pending
        slots, logged = self.said.reshape(-1).data, self.logged

        def write(message: Message) -> None:  # an FMU may log a million of them
            data = message.to_bytes()[: _SLOT - 4]
            slot = len(data).to_bytes(4, "little") + data
            at = int(logged[0]) % KEPT_AT_ONCE * _SLOT
            slots[at : at + len(slot)] = slot
            logged[0] += 1

        Log.listener = write


def activity(take: Callable[[tuple[int, ...], DTypeLike], NDArray[Any]] = shared) -> Activity:
    """Return that of a fleet that has not begun, in arrays that a function makes."""
    made = Activity(
        take((2,), np.float64),
        take((1,), np.int64),
        take((1,), np.int64),
        take((1,), np.int64),
        take((KEPT_AT_ONCE, _SLOT), np.uint8),
        take((1,), np.int64),
    )
    made.current[0] = -1
    return made
