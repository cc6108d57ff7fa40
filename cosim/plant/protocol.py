"""Messages between the harness and a process that runs plants, through a pipe each way.

A frame is a kind (one byte), a length (four bytes, the least significant first) and that many bytes: JSON, or nothing.
The numbers of a step go through shared memory, see `cosim.plant.bells`. The harness executes nothing of what comes
back, and trusts none of it: an FMU may have written it.

The process sends `Reply.DONE` when it has started. After that each request has one reply.
"""

from __future__ import annotations

import os
import struct
from enum import IntEnum

HEADER = struct.Struct("<BI")
MOST = 64 * 1024**2
"""Bytes of a reply."""


class Request(IntEnum):
    """Kinds of requests.

    Start plants, or change values of one; take a step; the words of the failures in it; the messages of the FMUs; end;
    put the plants at the start of another run; save the state of one; let one go on from a saved state.
    """

    START, STEP, CHANGE, FAILURES, MESSAGES, END, RESTART, SAVE, RESTORE = range(9)


class Reply(IntEnum):
    """Kinds of replies: what was asked for; why that failed."""

    DONE, FAILED = range(2)


def send(pipe: int, kind: IntEnum, body: bytes = b"") -> None:
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


def out_of_reach(descriptor: int) -> int:
    """Return another descriptor of a pipe, and let the one that FMUs know lead to standard error, or nowhere.

    Parameters
    ----------
    descriptor
        0 or 1: standard input or output.
    """
    if os.name == "posix":
        import fcntl

        other = fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, 10)
    else:
        other = os.dup(descriptor)
    os.dup2(2 if descriptor == 1 else os.open(os.devnull, os.O_RDWR), descriptor)
    return other
