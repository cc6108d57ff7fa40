"""Messages between the harness and a plant's own process, through a pipe each way.

A frame is a kind (one byte), a length (four bytes, the least significant first) and that many bytes. The plant's
process sends numbers and text only, and the harness executes none of it: the FMU may have written it.

The process sends `Reply.DONE` when it has started. After that each request has one reply. Before the reply it sends the
messages that the FMU logs meanwhile, so that they arrive even if there is no reply.
"""

from __future__ import annotations

import os
import struct
from enum import IntEnum

HEADER = struct.Struct("<BI")
MAX_TEXT = 65536
"""Bytes of text in a reply."""
MAX_SAID = 20
"""Upper limit for messages that are sent at once, for each request."""


class Request(IntEnum):
    """Kinds of requests: a PlantSpec as JSON; time, step and inputs as doubles; values as JSON; nothing."""

    START, STEP, CHANGE, END = range(4)


class Reply(IntEnum):
    """Kinds of replies: outputs as doubles, if any, and log; the text of a failure; a `Message` as it comes."""

    DONE, FAILED, SAID = range(3)


def send(pipe: int, kind: IntEnum, body: bytes) -> None:
    """Write a frame."""
    data = HEADER.pack(kind, len(body)) + body
    while data:
        data = data[os.write(pipe, data) :]


def exactly(pipe: int, length: int) -> bytes | None:
    """Read so many bytes; None if the pipe ends before."""
    data = b""
    while len(data) < length:
        part = os.read(pipe, length - len(data))
        if not part:
            return None
        data += part
    return data
