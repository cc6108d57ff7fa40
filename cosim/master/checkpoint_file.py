"""The file of a checkpoint: facts as JSON, arrays of plain numbers, and a checksum; nothing in it can be executed.

A file is `MAGIC`, the length of the facts (eight bytes, the least significant first), the facts, the arrays one after
the other, and the CRC-32 of all that (four bytes). The facts state name, type and shape of each array under ``arrays``.
"""

from __future__ import annotations

import errno
import json
import math
import os
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError, OutputError
from cosim.storage import forget, write_all

MAGIC = b"formation checkpoint 1\n"
PARTIAL = ".partial"
"""How the name of a file ends that is being written."""
_FAMILY = b"formation checkpoint "
_MOST_FACTS = 256 * 1024**2
_TYPES = ("<f8", "<i8", "<u8", "|u1")
_PIECE = 2**20
_AT_ONCE = 2**24
"""Bytes that are read into an array at once."""


def write_checkpoint(path: Path, facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write a checkpoint whole or not at all; once this returns, it survives a loss of power.

    Raises
    ------
    OutputError
        It cannot be written; an older file of the name is left as it is.
    """
    listed = [(name, array.dtype.str, array.shape) for name, array in arrays.items()]
    about = json.dumps({**facts, "arrays": listed}).encode()
    partial = path.with_name(f".{path.name}{PARTIAL}")
    try:
        try:
            with partial.open("wb", buffering=0) as file:
                checksum = 0
                for piece in _pieces(MAGIC + len(about).to_bytes(8, "little") + about, arrays.values()):
                    checksum = zlib.crc32(piece, checksum)
                    write_all(file, piece)
                write_all(file, checksum.to_bytes(4, "little"))
                os.fsync(file.fileno())
            os.replace(partial, path)
            _sync(path.parent)
        except BaseException:
            with suppress(OSError):
                partial.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(f"the checkpoint {path} cannot be written: {error.strerror}") from None


def _pieces(head: bytes, arrays: Iterable[NDArray[Any]]) -> Iterator[bytes | memoryview]:
    """Yield what a file consists of, in few pieces.

    Whoever writes a piece lets go of the interpreter's lock and takes it back, for which it waits for the loop, and the
    loop for it. So small arrays go together, and a large one is not divided.
    """
    small: list[bytes | memoryview] = [head]
    for array in arrays:
        data = np.ascontiguousarray(array).data.cast("B") if array.size else memoryview(b"")
        if len(data) < _PIECE:
            small.append(data)
        else:
            yield from (b"".join(small), data)
            small = []
    yield b"".join(small)


def _sync(folder: Path) -> None:
    """Let the names in a folder survive a loss of power, where the system can do that."""
    if os.name == "posix":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        except OSError as error:
            if error.errno != errno.EINVAL:
                raise
        finally:
            os.close(descriptor)


class CheckpointFile:
    """A checkpoint that is read: whole, as its checksum says, and of a known form.

    Parameters
    ----------
    path
        The file.

    Attributes
    ----------
    facts : dict
        The facts, as they were written.

    Raises
    ------
    InputError
        There is none, or it is damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._places: dict[str, tuple[np.dtype[Any], tuple[int, ...], int]] = {}
        try:
            with path.open("rb", buffering=0) as file:
                self.facts: dict[str, Any] = self._read(file)
        except OSError as error:
            raise InputError(f"the checkpoint {path} cannot be read: {error.strerror}") from None

    def array(self, name: str) -> NDArray[Any]:
        """Return an array; KeyError if there is none of the name."""
        dtype, shape, _ = self._places[name]
        found = np.empty(shape, dtype)
        self.read_into(name, found)
        return found

    def read_into(self, name: str, place: NDArray[Any]) -> None:
        """Read an array into another one of its shape and type, in one piece of memory."""
        dtype, shape, start = self._places[name]
        if (place.dtype, place.shape) != (dtype, shape) or not place.flags.c_contiguous:
            raise self.damaged(f"{name} has another shape than it should have")
        if not place.size:
            return
        with self.path.open("rb", buffering=0) as file:
            file.seek(start)
            rest = place.data.cast("B")
            while len(rest):
                if not (count := file.readinto(rest[:_AT_ONCE])):
                    raise self.damaged("it was cut off")
                rest = rest[count:]
                forget()  # the records of a long run are mapped

    @property
    def names(self) -> Iterator[str]:
        """The names of the arrays."""
        return iter(self._places)

    def damaged(self, how: str) -> InputError:
        """Return the error of a file that is not what it should be."""
        return InputError(f"the checkpoint {self.path} is damaged: {how}")

    @contextmanager
    def understood(self) -> Iterator[None]:
        """Let what does not make sense in the facts or arrays be an InputError."""
        try:
            yield
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
            raise self.damaged(f"{type(error).__name__}: {error}") from None

    def _read(self, file: FileIO) -> dict[str, Any]:
        size = os.fstat(file.fileno()).st_size
        head = _exactly(file, len(MAGIC) + 8)
        if head[: len(MAGIC)] != MAGIC:
            if head.startswith(_FAMILY):
                raise InputError(f"the checkpoint {self.path} was written by another version of Formation")
            raise InputError(f"{self.path} is no checkpoint of formation")
        length = int.from_bytes(head[len(MAGIC) :], "little")
        if length > min(_MOST_FACTS, size - len(head) - 4):
            raise self.damaged("it was cut off")
        about = _exactly(file, length)
        checksum, left = zlib.crc32(about, zlib.crc32(head)), size - len(head) - length - 4
        while left > 0 and (piece := file.read(min(left, _PIECE))):
            checksum, left = zlib.crc32(piece, checksum), left - len(piece)
        if checksum.to_bytes(4, "little") != _exactly(file, 4):
            raise self.damaged("its checksum is not that of its content, so it was cut off or changed")
        with self.understood():
            facts: dict[str, Any] = json.loads(about)
            start = len(head) + length
            for name, kind, shape in facts["arrays"]:
                if kind not in _TYPES or any(type(n) is not int or n < 0 for n in shape):
                    raise ValueError(f"array {name!r}")
                dtype = np.dtype(kind)
                self._places[name] = dtype, tuple(shape), start
                start += math.prod(shape) * dtype.itemsize
            if start + 4 != size:
                raise ValueError("its arrays do not fill it")
        return facts


def _exactly(file: FileIO, size: int) -> bytes:
    """Return so many bytes of a file, or less at its end."""
    data = b""
    while len(data) < size and (part := file.read(size - len(data))):
        data += part
    return data
