"""Recordings in tables: CSV files with a time and a column for each number, and results of runs."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from cosim.errors import InputError, Location, nearest, printable
from cosim.export.courses import courses_of
from cosim.export.csv import heading
from cosim.missing_file import absent
from cosim.recordings.mapping import Mapped, Place
from cosim.recordings.series import Floats, Series
from cosim.results.files import load_result
from cosim.results.result import Result
from plants import UnitError, units

_CELL = re.compile(r"\s*(.*?)\s*(?:\[\s*([^\[\]\s]*)\s*\])?\s*", re.DOTALL)
_LONGEST_LINE = 16 * 1024**2
MOST_NUMBERS = 500_000_000
"""Numbers that are read of a table."""


def read_table(path: Path, wanted: Iterable[Mapped], time: str) -> dict[Place, Series]:
    """Return the columns of a table that are wanted; those that are only looked for may be missing.

    Parameters
    ----------
    path
        The CSV file, whose first line names each column, with its unit in brackets. An empty cell is no number.
    wanted
        The numbers.
    time
        The column with the time.

    Raises
    ------
    InputError
        The file cannot be read or is no table, a cell is no number, or a column is missing that a mapping names.
    """
    import pandas

    heads, whole = _heads(path)
    names = [name for name, _ in heads]
    if time not in names:
        raise InputError(
            f"the first line of the table {path} names no column {time!r}: {_known(time, names)}; the attribute time "
            "of a <mapping> names the column with the time"
        )
    columns = {one.place: _column(one, path, names) for one in wanted}
    used = sorted({names.index(time), *(at for at in columns.values() if at is not None)})
    try:
        frame = pandas.read_csv(
            path,
            header=0,
            names=range(len(names)),
            usecols=used,
            skipfooter=0,
            float_precision="round_trip",
            encoding="utf-8-sig",
            index_col=False,
            low_memory=False,
            skipinitialspace=True,
        )
    except (ValueError, OSError) as error:  # of pandas' reader, too
        raise InputError(f"the recording {path} cannot be read as a table: {_line(error)}") from None
    if not whole:
        frame = frame.iloc[:-1]  # the last line is cut off, maybe within a number
    if not len(frame):
        raise InputError(f"the table {path} has no rows below its first line")
    numbers = {at: _numbers(frame[at], heads[at][0], path) for at in used}
    seconds = _seconds(numbers[names.index(time)], heads[names.index(time)][1], time, path)
    return {place: Series(seconds, numbers[at], heads[at][1] or "-") for place, at in columns.items() if at is not None}


def read_result(path: Path, wanted: Iterable[Mapped]) -> dict[Place, Series]:
    """Return the numbers of the result of a run that are wanted, named as in an exported table.

    Raises
    ------
    InputError
        It cannot be read, or lacks what a mapping names.
    """
    result = Result.of(load_result(path))
    if "time" not in result or "robot" not in result:
        raise InputError(f"{path} is not the result of a run: 'time' or 'robot' is missing in it")
    courses = {heading(course.path, "1"): course for course in courses_of(result)}
    time = result["time"].values
    found = {}
    for one in wanted:
        name = one.place.column
        if name in courses:
            found[one.place] = Series(time, courses[name].values, courses[name].unit)
        else:
            _refuse_if_named(one, path, list(courses))
    return found


def _heads(path: Path) -> tuple[list[tuple[str, str]], bool]:
    """Return name and unit of each column, and whether the last line is whole."""
    try:
        with path.open("rb") as file:
            first = file.readline(_LONGEST_LINE)
            file.seek(0, 2)
            file.seek(max(0, file.tell() - 1))
            whole = file.read(1) in (b"\n", b"\r")
    except OSError as error:
        said = absent(path) if isinstance(error, FileNotFoundError) else f"it cannot be read: {error.strerror}"
        raise InputError(f"the recording {path}: {said}") from None
    try:
        text = first.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"the recording {path} is not text in UTF-8") from None
    try:
        cells = next(csv.reader([text]), [])
    except csv.Error as error:
        raise InputError(f"the first line of {path} is not that of a table: {error}") from None
    if len(cells) < 2 or "\0" in text:
        raise InputError(
            f"the recording {path} is no table: its first line must name columns, separated by commas, as in "
            "'time [s],follower_1.pose.x [m]'"
        )
    heads = [(match[1], match[2] or "") for cell in cells if (match := _CELL.fullmatch(cell))]
    names = [name for name, _ in heads if name]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError(f"the table {path} has two columns named {printable(twice)!r}")
    return heads, whole


def _column(one: Mapped, path: Path, names: Sequence[str]) -> int | None:
    if one.place.column in names:
        return names.index(one.place.column)
    _refuse_if_named(one, path, names)
    return None


def _refuse_if_named(one: Mapped, path: Path, names: Sequence[str]) -> None:
    if one.where is not None:
        if not one.place.column:
            raise InputError(f"{path} is a table, which has columns and no topics: name a column", one.where)
        raise InputError(
            f"the recording {path} has no column {one.place.column!r}: {_known(one.place.column, names)}", one.where
        )


def _known(name: str, names: Sequence[str]) -> str:
    return printable(nearest(name, [known for known in names if known]))


def _numbers(column: object, name: str, path: Path) -> Floats:
    import pandas

    series = pandas.Series(column)
    if series.dtype.kind not in "fiu":
        numbers = pandas.to_numeric(series, errors="coerce")
        if (wrong := series.notna() & numbers.isna()).any():
            at = int(np.argmax(wrong.to_numpy()))
            cell = printable(str(series.iloc[at]))[:80]
            raise InputError(
                f"{cell!r} in the column {printable(name)!r} is not a number",
                Location(str(path), int(series.index[at]) + 2),
            )
        series = numbers
    found: Floats = series.to_numpy(dtype=np.float64, na_value=np.nan).copy()
    found[np.isinf(found)] = np.nan
    return found


def _seconds(values: Floats, unit: str, name: str, path: Path) -> Floats:
    try:
        own = units.parse(unit or "s")
    except UnitError as error:
        raise InputError(f"the column {name!r} of {path}: {error}") from None
    if own.exponents != units.parse("s").exponents:
        raise InputError(f"the column {name!r} of {path} is in {unit}, which is no time")
    return values if own.factor == 1.0 else values * own.factor


def _line(error: Exception) -> str:
    return printable(str(error)).partition("\n")[0][:300]
