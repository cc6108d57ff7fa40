"""Tables in CSV files: columns with units over a time that increases."""

from __future__ import annotations

import csv
import errno
import io
import math
import os
import re
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError, Location, nearest, printable
from cosim.missing_file import absent
from cosim.quantity import advice
from plants import UnitError, units

if TYPE_CHECKING:
    from _csv import Reader

MAX_BYTES = 64 * 1024 * 1024
MAX_CELLS = 10_000_000

_CELL = re.compile(r"\s*([^\[\]]*[^\[\]\s])\s*(?:\[\s*([^\[\]\s]+)\s*\])?\s*")
_NUMBER = re.compile(r"[ \t]*[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?[ \t]*")


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
            has = f"is in {self.columns[name]}, but expected a unit such as {wanted}"
            if self.columns[name] == "1":
                has = f"has no unit: name it '{name} [{wanted}]' in the first line, with its true unit"
            raise _error(self.path, 1, f"the column {_shown(name)} {has}", where)
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
    text = _read_text(path, where)
    stream = io.StringIO(text, newline="")
    rows = csv.reader(stream)
    try:
        columns = _header(next(rows, []), path, where)
        values = _parse(stream, list(columns))
        if values is None:
            rows = csv.reader(io.StringIO(text, newline=""))
            raise _problem(rows, list(columns), path, where)
    except csv.Error as error:
        line = max(rows.line_num, 1)
        raise _error(path, line, f"is not a table of comma-separated values: {error}", where) from None
    time = Table(path, columns, np.empty(0), values).column("time", "s", where)
    return Table(path, columns, time, values)


def _read_text(path: Path, where: Location) -> str:
    if os.path.exists(path) and not os.path.isfile(path):  # a pipe or a device may never end
        raise _error(path, 0, "is not a regular file", where)
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise _error(path, 0, absent(path), where) from None
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise InputError(f"the table {str(path)!r} cannot be read: {error.strerror}", where) from None
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
    if len(row) == 1 and re.search(r"[;\t]", row[0]):
        raise _error(
            path, 1, "the first line has no commas: they separate the columns, and decimals follow a point", where
        )
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
        has = ", ".join(map(_shown, header))[:300] or "nothing"
        raise _error(path, 1, f"the first line names no column 'time [s]', but {has}", where)
    return header


def _parse(stream: io.StringIO, names: list[str]) -> NDArray[np.float64] | None:
    """Return the numbers (T, columns) in the rest of a file, or None if it is not such a table."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # there are no rows
        try:
            values = np.loadtxt(stream, delimiter=",", quotechar='"', comments=None, ndmin=2)
        except ValueError:
            return None
    if len(values) == 0 or values.shape[1] != len(names) or not np.isfinite(values).all():
        return None
    time = values[:, names.index("time")]
    return values if (time[1:] > time[:-1]).all() else None


def _problem(rows: Reader, names: list[str], path: Path, where: Location) -> InputError:
    """Return the fault of the first faulty row."""
    next(rows)
    time = names.index("time")
    before = -math.inf
    for row in filter(None, rows):
        if len(row) != len(names):
            count = f"the row has {len(row)} cell{'s' * (len(row) != 1)}, but the first line names {len(names)}"
            if len(row) == 2 * len(names):
                count += " (decimals follow a point)"
            return _error(path, rows.line_num, count, where)
        for name, cell in zip(names, row, strict=True):
            if not _NUMBER.fullmatch(cell) or math.isinf(float(cell)):
                return _error(
                    path,
                    rows.line_num,
                    f"{_shown(cell)} in the column {name!r} is not a finite number{advice(cell[:80])}",
                    where,
                )
        if float(row[time]) <= before:
            return _error(
                path, rows.line_num, f"the time {row[time].strip()} is not later than {before:g} before it", where
            )
        before = float(row[time])
    if before == -math.inf:
        return _error(path, 1, "the table has no rows below its first line", where)
    return _error(path, 0, "is not a table of comma-separated numbers", where)


def _shown(text: str) -> str:
    return repr(text if len(text) <= 80 else text[:77] + "...")


def _error(path: Path, line: int, message: str, where: Location) -> InputError:
    return InputError(f"{message} (the table is named in {where})", Location(str(path), line))
