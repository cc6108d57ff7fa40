"""The rows of a study on disk: appended as they come, so that whatever ends the study, it goes on where it was.

A file of lines, each a row as JSON, after a first line that says whose they are. A line that was cut off in the middle
of a write is removed when the file is opened again. A row counts for a run with the same key alone.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable
from contextlib import suppress
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Self

from cosim.errors import InputError, OutputError
from cosim.studies.row import Row

FILE = "rows.jsonl"
_FORMAT = "formation-study-rows 1"


class Store:
    """The rows of a study, open for one process.

    Parameters
    ----------
    folder
        The study's folder, which exists.
    name
        The study's name.

    Attributes
    ----------
    rows : dict
        The last row by key.
    unreadable : int
        Lines that are no rows; their runs are made again.

    Raises
    ------
    InputError
        The folder holds the rows of another study or version, or another process has it open.
    OutputError
        The file cannot be read or written.
    """

    def __init__(self, folder: Path, name: str) -> None:
        self._path = folder / FILE
        self.rows: dict[str, Row] = {}
        self.unreadable = 0
        try:
            self._file = self._path.open("a+b", buffering=0)
        except OSError as error:
            raise OutputError(f"{self._path} cannot be opened: {error.strerror}") from error
        try:
            _lock(self._file, self._path)
            self._read(name)
        except BaseException:
            self._file.close()
            raise

    def append(self, rows: Iterable[Row]) -> None:
        """Write rows, whole or not at all.

        Raises
        ------
        OutputError
            They cannot be written.
        """
        kept = list(rows)
        self._write("".join(row.to_json() + "\n" for row in kept))
        self.rows |= {row.key: row for row in kept}

    def __enter__(self) -> Self:
        """Return the store; it is closed at the end of the block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._file.close()

    def _read(self, name: str) -> None:
        self._file.seek(0)
        data = self._file.readall()
        whole = data.rfind(b"\n") + 1
        if whole < len(data):  # the process was ended while it wrote
            self._file.truncate(whole)
        first, *lines = data[:whole].splitlines() or [b""]
        if not first:
            self._write(json.dumps({"format": _FORMAT, "study": name}) + "\n")
            return
        self._check(first, name)
        for line in lines:
            try:
                row = Row.of(json.loads(line))
            except (ValueError, KeyError, TypeError):
                self.unreadable += 1
            else:
                self.rows[row.key] = row

    def _check(self, first: bytes, name: str) -> None:
        advice = "give another folder with --out, or remove it"
        try:
            head = json.loads(first)
            told, of = head["format"], head["study"]
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{self._path} does not hold the rows of a study: {advice}") from None
        if told != _FORMAT:
            raise InputError(f"{self._path} is of another version of Formation ({told!r}, not {_FORMAT!r}): {advice}")
        if of != name:
            raise InputError(f"{self._path} holds the rows of the study {of!r}, not of {name!r}: {advice}")

    def _write(self, text: str) -> None:
        size = os.fstat(self._file.fileno()).st_size
        rest = memoryview(text.encode())
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(size)
            raise OutputError(f"{self._path} cannot be written: {error.strerror}") from error


def _lock(file: FileIO, path: Path) -> None:
    """Refuse a file that another process has open; elsewhere than on POSIX nothing is locked."""
    if sys.platform == "win32":
        return
    import fcntl

    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(f"{path} is in use by another command: wait until it ends, or give another --out") from None
    except OSError:  # a file system without locks
        pass
