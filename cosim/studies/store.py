"""The rows of a study on disk: appended as they come, so that whatever ends the study, it goes on where it was.

A file of lines, each a row as JSON, after a first line that says whose they are. A line that was cut off in the middle
of a write is removed when the file is opened again. A row counts for a run with the same key alone. What a row has
for the picture of all runs stays on disk.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from cosim.closing import Closing
from cosim.errors import InputError, OutputError
from cosim.file_lock import lock
from cosim.studies.row import Row

FILE = "rows.jsonl"
_FORMAT = "formation-study-rows 1"


class Store(Closing):
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
        The last row by key, without its courses.
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
        self._places: dict[str, int] = {}  # where in the file the rows with courses are
        self.unreadable = 0
        try:
            self._file = self._path.open("a+b", buffering=0)
        except OSError as error:
            raise OutputError(f"{self._path} cannot be opened: {error.strerror}") from error
        try:
            lock(self._file, self._path)
            self._read(name)
        except BaseException:
            self._file.close()
            raise

    def append(self, rows: Iterable[Row]) -> list[Row]:
        """Write rows, whole or not at all; return them as they are kept.

        Raises
        ------
        OutputError
            They cannot be written.
        """
        rows = list(rows)
        lines = [(row.to_json() + "\n").encode() for row in rows]
        place = self._write(b"".join(lines))
        kept = []
        for row, line in zip(rows, lines, strict=True):
            kept.append(self._keep(row, place))
            place += len(line)
        return kept

    def courses(self, rows: Iterable[Row]) -> Iterator[tuple[str, ...]]:
        """Return the courses of each of some rows that are kept; of one that has none, nothing."""
        with open(os.dup(self._file.fileno()), "rb") as file:  # somebody may have removed the folder
            for row in rows:
                if (place := self._places.get(row.key)) is None:
                    yield ()
                    continue
                file.seek(place)
                yield Row.of(json.loads(file.readline())).courses

    def close(self) -> None:
        """Let others write to it."""
        self._file.close()

    def _read(self, name: str) -> None:
        place = 0
        with self._path.open("rb") as file:
            for line in file:
                if not line.endswith(b"\n"):  # the process was ended while it wrote
                    self._file.truncate(place)
                    break
                if not place:
                    self._check(line, name)
                else:
                    self._read_line(line, place)
                place += len(line)
        if not place:
            self._write((json.dumps({"format": _FORMAT, "study": name}) + "\n").encode())

    def _read_line(self, line: bytes, place: int) -> None:
        try:
            row = Row.of(json.loads(line))
        except (ValueError, KeyError, TypeError):
            self.unreadable += 1
        else:
            self._keep(row, place)

    def _keep(self, row: Row, place: int) -> Row:
        """Keep a row that stands at a place of the file, but for its courses; return it without them."""
        self._places.pop(row.key, None)
        if row.courses:
            self._places[row.key] = place
            row = replace(row, courses=())
        self.rows[row.key] = row
        return row

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

    def _write(self, data: bytes) -> int:
        """Write at the end; return where that was."""
        size = os.fstat(self._file.fileno()).st_size
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(size)
            raise OutputError(f"{self._path} cannot be written: {error.strerror}") from error
        return size
