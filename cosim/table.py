"""Tables in CSV files: columns with units over a time that increases."""

from __future__ import annotations

import csv
import io
import re
from array import array
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError, Location, nearest, printable
from plants import UnitError, units

MAX_BYTES = 64 * 1024 * 1024
MAX_CELLS = 10_000_000

_CELL = re.compile(r"\s*([^\[\]]*[^\[\]\s])\s*(?:\[\s*([^\[\]\s]+)\s*\])?\s*")


@dataclass(frozen=True, eq=False)
class Table:
    """A table whose rows are points in time.

    Attributes
    ----------
    path : Path
        The file that it was read from.
    columns : dict
        The unit of each column as it is written, by the column's name; "1" for pure numbers.
    time : ndarray (T,)
        The column ``time`` [s], strictly increasing.
    """

    path: Path
    columns: dict[str, str]
    time: NDArray[np.float64] = field(repr=False)
    _values: NDArray[np.float64] = field(repr=False)

    def column(self, name: str, unit: str | units.Unit, where: Location) -> NDArray[np.float64]:
        """Return a column (T,) in a unit.

        Parameters
        ----------
        name
            The column's name, without its unit.
        unit
            The unit wanted.
        where
            The place in the scenario that asks for it.

        Raises
        ------
        InputError
            The table has no such column, or its unit is not known or does not fit.
        """
        if name not in self.columns:
            known = printable(nearest(name, list(self.columns)))
            raise InputError(f"the table {self.path} has no column {name!r}: {known}", where)
        wanted = units.parse(unit) if isinstance(unit, str) else unit
        try:
            given = units.parse(self.columns[name])
        except UnitError as error:
            raise _error(self.path, 1, f"the column {name!r}: {error}", where) from None
        if given.exponents != wanted.exponents:
            raise _error(
                self.path,
                1,
                f"the column {name!r} is in {self.columns[name]}, but a unit such as {wanted} is asked for",
                where,
            )
        with np.errstate(over="ignore"):
            column = self._values[:, list(self.columns).index(name)] * (given.factor / wanted.factor)
        if not np.isfinite(column).all():
            raise _error(self.path, 1, f"the column {name!r} has values too large to compute with", where)
        return column


def read_table(path: Path, where: Location) -> Table:
    """Read a CSV file whose first line names each column with its unit, as in ``time [s],wind [N]``.

    Commas separate the cells; a column without a unit holds pure numbers. Empty lines are skipped.

    Parameters
    ----------
    path
        The file, in UTF-8.
    where
        The place in the scenario that asks for it.

    Raises
    ------
    InputError
        The file cannot be read or is too large, is no such table, a cell is not a finite number, or the time does not
        increase; with the line of the file, and the place in the scenario.
    """
    text = io.StringIO(_read_text(path, where), newline="")
    columns = _header(text, path, where)
    body = text.tell()
    try:
        values = np.loadtxt(text, delimiter=",", quotechar='"', comments=None, ndmin=2)
    except ValueError as error:
        text.seek(body)
        raise _problem(text, list(columns), path, where) or _error(path, 0, f"is no such table: {error}", where) from None
    table = Table(path, columns, np.empty(0), values)
    time = table.column("time", "s", where)

    return Table(path, columns, time, values)


def _read_text(path: Path, where: Location) -> str:
    if path.exists() and not path.is_file():  # a pipe or a device may never end
        raise _error(path, 0, "is not a regular file", where)
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise _error(path, 0, "there is no such file", where) from None
    except OSError as error:
        raise _error(path, 0, f"cannot be read: {error.strerror}", where) from None
    if len(data) > MAX_BYTES:
        raise _error(path, 0, f"is larger than {MAX_BYTES // 1024**2} MiB: give fewer points in time", where)
    if (cells := data.count(b",") + data.count(b"\n")) > MAX_CELLS:
        raise _error(path, 0, f"has {cells} cells, more than {MAX_CELLS}: give fewer points in time", where)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise _error(path, line, "is not text in UTF-8: save it in that encoding", where) from None


def _header(row: list[str], path: Path, where: Location) -> dict[str, str]:
    """Return the unit of each column by its name."""
    header: dict[str, str] = {}
    for number, cell in enumerate(row, start=1):
        match = _CELL.fullmatch(cell)
        if match is None:
            raise _error(
                path,
                1,
                f"column {number} is named {_shown(cell)}: a name and its unit are expected, as in 'wind [N]'",
                where,
            )
        name, unit = match.groups()
        if name in header:
            raise _error(path, 1, f"two columns are named {_shown(name)}", where)
        header[name] = unit or "1"
    if "time" not in header:
        hint = "; separate the columns with commas" if len(row) == 1 and re.search(r"[;\t]", row[0]) else ""
        raise _error(path, 1, f"the first line names no column 'time [s]'{hint}", where)
    return header


def _cells(rows: Any, names: list[str], path: Path, where: Location) -> tuple[array[float], array[int]]:
    """Return all numbers, row by row, and the line of each row."""
    cells, lines = array("d"), array("q")
    for row in rows:
        if not row:
            continue
        if len(row) != len(names):
            raise _error(
                path, rows.line_num, f"the row has {len(row)} cells, but the table has {len(names)} columns", where
            )
        try:
            cells.extend(map(float, row))
        except ValueError:
            name, cell = next((name, cell) for name, cell in zip(names, row, strict=True) if not _is_number(cell))
            raise _error(path, rows.line_num, f"{_shown(cell)} in the column {name!r} is not a number", where) from None
        lines.append(rows.line_num)
    return cells, lines


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _shown(text: str) -> str:
    return repr(text if len(text) <= 80 else text[:77] + "...")


def _error(path: Path, line: int, message: str, where: Location) -> InputError:
    return InputError(f"{message} (the table is asked for in {where})", Location(str(path), line))
