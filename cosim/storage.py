"""Where the long arrays of a run lie: in memory while they are small, in files without names when they are large.

Such a file is mapped into memory. Its space on the disk is reserved when the array is made, so a disk that fills up
later harms nothing. The system writes its pages out and forgets them as it likes: a run of any length takes little
memory.
"""

from __future__ import annotations

import errno
import math
import mmap
import os
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from io import FileIO
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from cosim.errors import OutputError
from cosim.shared_memory import shared

IN_MEMORY = 64 * 1024**2
"""Bytes of long arrays that a run keeps in memory."""
_AT_ONCE = 2**15
"""Numbers of a long array that are computed with at once."""
_FEWEST = 1024
"""Samples of a long array that are computed with at once, however many numbers each has."""
_PIECE = 2**20
_MAPPED: weakref.WeakSet[_Mapped] = weakref.WeakSet()


class _Mapped(mmap.mmap):
    """A mapped file; it can be referred to weakly."""


class Storage:
    """Where the long arrays of a run lie.

    Parameters
    ----------
    folder
        The folder of the files, or one that will be in it; without one, that of temporary files.
    in_memory
        Bytes of arrays that lie in memory. Whatever is made beyond lies in files.
    """

    def __init__(self, folder: Path | None = None, in_memory: int | None = None) -> None:
        self._folder = folder
        self._in_memory = IN_MEMORY if in_memory is None else in_memory
        self._left = self._in_memory
        self._reserved: IO[bytes] | None = None

    def empty(self, shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """Return an array whose content is arbitrary."""
        return self._file(shape, np.dtype(dtype)) if self._is_full(shape, dtype) else np.empty(shape, dtype)

    def shared(self, shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """Return an array that processes forked from this one share."""
        return self._file(shape, np.dtype(dtype)) if self._is_full(shape, dtype) else shared(shape, dtype)

    def reserve(self, size: int) -> None:
        """Keep room for a result of so many bytes on the disk, until `release`; none for one that fits in memory.

        Raises
        ------
        OutputError
            There is not so much.
        """
        if size > self._in_memory:
            self._reserved = self._open(size)

    def release(self) -> None:
        """Give the room away that was reserved."""
        if self._reserved is not None:
            self._reserved.close()
            self._reserved = None

    def _is_full(self, shape: tuple[int, ...], dtype: DTypeLike) -> bool:
        self._left -= math.prod(shape) * np.dtype(dtype).itemsize
        return self._left < 0

    def _file(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
        count = math.prod(shape)
        size = count * dtype.itemsize
        with self._open(max(size, 1)) as file:
            mapped = _Mapped(file.fileno(), max(size, 1))
        _MAPPED.add(mapped)
        return np.frombuffer(mapped, dtype, count).reshape(shape)

    def _open(self, size: int) -> IO[bytes]:
        """Return a file of a size without a name, all of whose space is taken."""
        folder = Path(tempfile.gettempdir()) if self._folder is None else self._folder.absolute()
        while not folder.is_dir() and folder != folder.parent:
            folder = folder.parent
        try:
            file: IO[bytes] = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
            try:
                take(file, size)
            except BaseException:
                file.close()
                raise
        except OSError as error:
            raise OutputError(
                f"{folder} has no room for the {size / 1024**3:.2g} GiB that the run needs there: "
                f"{error.strerror}; shorten the run, or make room"
            ) from error
        return file


def take(file: IO[bytes], size: int) -> None:
    """Let a file that is at its start or written up to some place take so many bytes on the disk.

    Raises
    ------
    OSError
        There is not so much space.
    """
    if hasattr(os, "posix_fallocate"):
        try:
            os.posix_fallocate(file.fileno(), 0, size)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP):
                raise
        else:
            return
    file.seek(0, os.SEEK_END)
    while (missing := size - file.tell()) > 0:
        file.write(bytes(min(_PIECE, missing)))
    file.flush()


def write_all(file: FileIO, data: bytes | memoryview) -> None:
    """Write data to a file that may take a part of it at a time, such as a pipe."""
    rest = memoryview(data)
    while len(rest):
        rest = rest[file.write(rest) :]


def blocks(samples: int, numbers: int = 1, multiple: int = 1) -> Iterator[slice]:
    """Yield the parts of a course one after the other, and let the system forget those that have been.

    Parameters
    ----------
    samples
        The length of the course.
    numbers
        How many numbers are computed with at each of them.
    multiple
        All parts but the last one have a multiple of so many samples.
    """
    length = max(_AT_ONCE // max(numbers, 1), _FEWEST)
    length = max(length // multiple, 1) * multiple
    for start in range(0, samples, length):
        yield slice(start, min(start + length, samples))
        forget()


def fill(place: NDArray[Any], values: ArrayLike) -> None:
    """Write values, or those that all samples have, into an array (samples, ...), part by part."""
    whole = np.broadcast_to(values, place.shape)
    for block in blocks(len(place), place[:1].size):
        place[block] = whole[block]


def forget() -> None:
    """Let the system take the memory of all files that are mapped; they are read again when they are needed."""
    for mapped in list(_MAPPED) if _MAPPED else ():
        with suppress(AttributeError, ValueError, OSError):  # the system has no such call
            mapped.madvise(mmap.MADV_DONTNEED)


def constant(values: NDArray[np.float64], samples: int) -> NDArray[np.float64]:
    """Return an array (samples, ...) in which all samples are the same numbers in memory: it is only read.

    For the same numbers it is the same array, so that runs of a study find them where they were.
    """
    return _constant(values.astype(np.float64).tobytes(), values.shape, samples)


@lru_cache(1024)
def _constant(numbers: bytes, shape: tuple[int, ...], samples: int) -> NDArray[np.float64]:
    values = np.frombuffer(bytearray(numbers)).reshape(shape)
    return np.lib.stride_tricks.as_strided(values, (samples, *shape), (0, *values.strides), writeable=False)


def is_constant(course: NDArray[np.float64]) -> bool:
    """Return whether an array is one that `constant` has made."""
    return course.strides[0] == 0
