"""Arrays in memory that this process shares with others."""

from __future__ import annotations

import math
import mmap
import os
import secrets
import sys
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

_POPULATE_READ, _POPULATE_WRITE = 22, 23
"""Advice of Linux; after the first one shared memory can be written, too, without another fault."""
_LINE = 64
"""Bytes of a cache line, at which arrays begin."""


def shared(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Return zeros in memory that this process shares with the processes that are forked from it."""
    of = np.dtype(dtype)
    size = math.prod(shape)
    return np.frombuffer(mmap.mmap(-1, max(size * of.itemsize, 1)), of, size).reshape(shape)


def provide(arrays: Iterable[NDArray[Any]], new: bool) -> None:
    """Let this process have the memory of `shared` arrays at once, where the system can do that.

    Page by page, each when it is first touched, takes several times as long.

    Parameters
    ----------
    arrays
        The arrays.
    new
        Whether the memory is still to be made; else another process has it already.
    """
    for array in arrays:
        whole: Any = array
        while isinstance(whole, np.ndarray | memoryview):
            whole = whole.base if isinstance(whole, np.ndarray) else whole.obj
        if type(whole) is mmap.mmap and sys.platform == "linux":
            with suppress(OSError):  # an old system has no such call
                whole.madvise(_POPULATE_WRITE if new else _POPULATE_READ)


class MappedMemory:
    """Zeros in memory that a process maps which this one starts; nothing is left of them once both have ended.

    Parameters
    ----------
    size
        Bytes.
    name
        The `name` of the memory of another process; empty for new memory.

    Attributes
    ----------
    name : str
        Its name for a process that is started with `descriptors`.
    descriptors : tuple of int
        What such a process must inherit.
    """

    def __init__(self, size: int, name: str = "") -> None:
        self._used = 0
        self.name = name
        self.descriptors: tuple[int, ...] = ()
        if sys.platform == "win32":
            self.name = name or f"formation-{secrets.token_hex(16)}"
            self._memory = mmap.mmap(-1, size, self.name)
            return
        descriptor = int(name) if name else _file(size)
        self._memory = mmap.mmap(descriptor, size)
        if name:
            os.close(descriptor)
        else:
            self.name, self.descriptors = str(descriptor), (descriptor,)

    def take(self, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
        """Return the next array: whoever maps the memory takes the same ones in the same order."""
        of = np.dtype(dtype)
        size = math.prod(shape)
        array = np.frombuffer(self._memory, of, size, self._used).reshape(shape)
        self._used += -(-size * of.itemsize // _LINE) * _LINE
        return array

    def is_inherited(self) -> None:
        """Give up the descriptors: the other process has them now."""
        for descriptor in self.descriptors:
            os.close(descriptor)
        self.descriptors = ()


class LaterMemory:
    """Memory for a process that this one starts, whose size is known only later.

    Attributes
    ----------
    descriptors : tuple of int
        What the process must inherit.
    """

    def __init__(self) -> None:
        self._size = 0
        self.descriptors: tuple[int, ...] = () if sys.platform == "win32" else (_file(0),)

    def map(self, size: int) -> tuple[mmap.mmap, str]:
        """Return so many bytes, of any content if some have been mapped before, and their name for the process."""
        if sys.platform == "win32":
            name = f"formation-{secrets.token_hex(16)}"
            return mmap.mmap(-1, size, name), name
        (descriptor,) = self.descriptors
        if size > self._size:  # what somebody has mapped must not become shorter
            os.truncate(descriptor, size)
            self._size = size
        return mmap.mmap(descriptor, size), str(descriptor)

    def close(self) -> None:
        """Give up the descriptors; what is mapped stays."""
        for descriptor in self.descriptors:
            os.close(descriptor)
        self.descriptors = ()


def _file(size: int) -> int:
    """Return the descriptor of a file without a name."""
    if hasattr(os, "memfd_create"):
        descriptor: int = os.memfd_create("formation")
    else:
        with tempfile.TemporaryFile() as file:
            descriptor = os.dup(file.fileno())
    os.truncate(descriptor, size)
    return descriptor
