"""Messages of ROS 2 in CDR, whose layout is the same at each time: a template, and where its numbers stand.

CDR (Common Data Representation, OMG DDS-XTYPES, version 1, little endian) writes the fields one after the other, each
aligned to its own size, counted from the end of the first four bytes. So the messages of a topic differ only in the
bytes of their numbers, as long as their texts and lengths do not change, and many messages are written at once.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Number: TypeAlias = float | Floats
"""A constant, or a number at each time (T,)."""

_LITTLE_ENDIAN = b"\x00\x01\x00\x00"


class Message:
    """A message, as far as it is written.

    Attributes
    ----------
    data : bytearray
        Its bytes; zero where numbers stand that change.
    numbers : list
        The offset of each number that changes, with its values (T,).
    stamps : list of int
        The offsets of the times in it, seconds and nanoseconds in four bytes each.
    """

    def __init__(self) -> None:
        self.data = bytearray(_LITTLE_ENDIAN)
        self.numbers: list[tuple[int, Floats]] = []
        self.stamps: list[int] = []

    def put(self, kind: str, *values: object) -> Message:
        """Append values of a type of the module `struct`, each aligned to its size."""
        for value in values:
            self._align(struct.calcsize(kind))
            self.data += struct.pack(f"<{kind}", value)
        return self

    def number(self, *values: Number) -> Message:
        """Append numbers of type float64, constant or not."""
        for value in values:
            self._align(8)
            if isinstance(value, np.ndarray):
                self.numbers.append((len(self.data), value))
                value = 0.0
            self.data += struct.pack("<d", value)
        return self

    def text(self, text: str) -> Message:
        """Append a text."""
        data = text.encode(errors="replace").replace(b"\0", b" ") + b"\0"
        self.put("I", len(data))
        self.data += data
        return self

    def stamp(self) -> Message:
        """Append the time at which the message is recorded."""
        self._align(4)
        self.stamps.append(len(self.data))
        self.data += bytes(8)
        return self

    def header(self, frame: str) -> Message:
        """Append a ``std_msgs/Header``."""
        return self.stamp().text(frame)

    def pose(self, x: Number, y: Number, turn: Turn) -> Message:
        """Append a ``geometry_msgs/Pose`` in the plane; a ``Transform`` has the same layout."""
        return self.number(x, y, 0.0, 0.0, 0.0, *turn)

    def points(self, points: Sequence[tuple[float, float]]) -> Message:
        """Append a sequence of ``geometry_msgs/Point`` in the plane."""
        self.put("I", len(points))
        for x, y in points:
            self.number(x, y, 0.0)
        return self

    def _align(self, size: int) -> None:
        self.data += bytes(-(len(self.data) - len(_LITTLE_ENDIAN)) % size)


Turn: TypeAlias = tuple[Number, Number]
"""A rotation in the plane: z and w of its quaternion."""
NO_TURN: Turn = (0.0, 1.0)
