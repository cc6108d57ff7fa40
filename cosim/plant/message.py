"""A message that an FMU has logged, as data."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Self

from cosim.errors import printable
from cosim.plant.failures import STATUS

KEPT_AT_ONCE = 20
"""Upper limit for the messages kept between two communication points: the last ones; repeated ones count as one."""
MAX_LENGTH = 2000
"""Bytes of a message's text."""
MAX_CATEGORY = 200
"""Bytes of its category."""


@dataclass(frozen=True)
class Message:
    """A message that an FMU has logged.

    Attributes
    ----------
    status : str
        The FMI status: ``OK``, ``Warning``, ``Discard``, ``Error``, ``Fatal`` or ``Pending``; another number is
        kept as a number.
    category : str
        As the FMU names it, such as ``logEvents``; empty if it gives none.
    text : str
        The message itself.
    count : int
        How many times it came in succession.
    """

    status: str
    category: str
    text: str
    count: int = 1

    @classmethod
    def of(cls, status: int, category: bytes | None, text: bytes | None) -> Self:
        """Return the message of a call of an FMU's logger."""
        name = STATUS[status] if 0 <= status < len(STATUS) else str(status)
        return cls(name, _decoded(category, MAX_CATEGORY), _decoded(text, MAX_LENGTH))

    def repeats(self, other: Message) -> bool:
        """Return whether it equals another message in all but its count."""
        return (self.text, self.category, self.status) == (other.text, other.category, other.status)

    @property
    def in_a_line(self) -> Self:
        """The message for a reader: category and text printable, in one line."""
        category, text = (printable(" ".join(part.split())) for part in (self.category, self.text))
        return replace(self, category=category, text=text)

    def to_bytes(self) -> bytes:
        """Return the message for a pipe."""
        return "\0".join((self.text, self.category, self.status)).encode("utf-8", "replace")

    @classmethod
    def from_bytes(cls, data: bytes) -> Self:
        """Return the message that came through a pipe; none of it is trusted."""
        parts = [printable(part) for part in data.decode("utf-8", "replace").split("\0", 2)]
        text, category, status = [*parts, "", ""][:3]
        return cls(status if status in STATUS or status.isdecimal() else "", category, text)


@dataclass(frozen=True)
class RobotMessage:
    """A message of a robot's FMU, with the communication point [s] at which it was noticed."""

    time: float
    robot: str
    message: Message


class LastMessages:
    """The last messages of one FMU, no two alike in succession."""

    def __init__(self) -> None:
        self._kept: deque[Message] = deque(maxlen=KEPT_AT_ONCE)

    def __len__(self) -> int:
        return len(self._kept)

    def __iter__(self) -> Iterator[Message]:
        return iter(self._kept)

    def add(self, messages: Iterable[Message]) -> None:
        """Keep messages."""
        for message in messages:
            last = self._kept[-1] if self._kept else None
            if last is not None and last.repeats(message):
                self._kept[-1] = replace(last, count=last.count + message.count)
            else:
                self._kept.append(message)

    def take(self) -> list[Message]:
        """Return the messages that are kept, and forget them."""
        taken = list(self._kept)
        self._kept.clear()
        return taken


def _decoded(data: bytes | None, most: int) -> str:
    return (data or b"")[:most].decode("utf-8", "replace")
