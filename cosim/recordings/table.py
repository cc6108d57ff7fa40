"""Recordings in tables: CSV files with a time and a column for each number, and results of runs."""

from __future__ import annotations

import csv
import math
import re
from array import array
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import numpy as np

from cosim.errors import InputError, Location, nearest, printable
from cosim.export.courses import courses_of
from cosim.export.csv import heading
from cosim.recordings.mapping import Mapped
from cosim.recordings.series import NO_UNIT, Floats, Numbers, Series
from cosim.results.files import load_run
from plants import UnitError, units

if TYPE_CHECKING:
    from _csv import Reader

_CELL = re.compile(r"\s*(.*?)\s*(?:\[\s*([^\[\]\s]*)\s*\])?\s*", re.DOTALL)


def read_table(path: Path, wanted: Iterable[Mapped], time: str) -> Numbers:
    """Return the columns of a table that are wanted; those that are only looked for may be missing.

    Parameters
    ----------
    path
        The CSV file, whose first line names each column, with its unit in brackets. An empty cell is no number. Nor is
        the last cell of a last line without a line end: it may be cut off, within a number.
    wanted
        The numbers.
    time
        The column with the time.

    Raises
    ------
    InputError
        The file cannot be read or is no table, a cell is no number, or a column is missing that a mapping names.
    """
    with _opened(path) as (file, whole):
        rows = csv.reader(file)
        try:
            heads = _heads(next(rows, []), path)
            names = [name for name, _ in heads]
            if time not in names:
                raise InputError(
                    f"the first line of the table {path} names no column {time!r}: {_known(time, names)}; the "
                    "attribute time of a <mapping> names the column with the time"
                )
            columns = {one.place: at for one in wanted if (at := _column(one, path, names)) is not None}
            used = sorted({names.index(time), *columns.values()})
            found, cut = _numbers(rows, used, heads, whole, path)
            numbers = dict(zip(used, found, strict=True))
        except csv.Error as error:
            raise InputError(f"is no table: {error}", Location(str(path), max(rows.line_num, 1))) from None
        except UnicodeDecodeError:
            raise InputError(f"the recording {path} is not text in UTF-8") from None
    seconds = _seconds(numbers[names.index(time)], heads[names.index(time)][1], time, path)
    there = ~np.isnan(seconds)
    series = {
        place: Series(seconds[there], numbers[at][there], heads[at][1] or NO_UNIT) for place, at in columns.items()
    }
    return Numbers(series, names, tuple(_notes(path, cut, int((~there).sum()))))


def read_result(path: Path, wanted: Iterable[Mapped]) -> Numbers:
    """Return the numbers of the result of a run that are wanted, named as in an exported table.

    Raises
    ------
    InputError
        It cannot be read, or lacks what a mapping names.
    """
    result = load_run(path)
    courses = {heading(course.path, "1"): course for course in courses_of(result)}
    time = result["time"].values
    found = {}
    for one in wanted:
        name = one.place.column
        if name in courses:
            found[one.place] = Series(time, courses[name].values, courses[name].unit)
        else:
            _refuse_if_named(one, path, list(courses))
    return Numbers(found, list(courses))


@contextmanager
def _opened(path: Path) -> Iterator[tuple[TextIO, bool]]:
    """Open a table; also return whether its last line is whole."""
    if path.is_dir():
        raise InputError(f"the recording {path} is a folder without metadata.yaml, which a bag of ROS 2 has")
    try:
        with path.open("rb") as file:
            file.seek(max(0, file.seek(0, 2) - 1))
            whole = file.read(1) in (b"\n", b"\r")
        with path.open(encoding="utf-8-sig", newline="") as text:
            yield text, whole
    except OSError as error:
        raise InputError(f"the recording {path} cannot be read: {error.strerror}") from None


def _heads(cells: Sequence[str], path: Path) -> list[tuple[str, str]]:
    """Return name and unit of each column."""
    if len(cells) < 2 or any("\0" in cell for cell in cells):
        raise InputError(
            f"the recording {path} is no table: its first line must name columns, separated by commas, as in "
            "'time [s],follower_1.pose.x [m]'"
        )
    heads = [(match[1], match[2] or "") for cell in cells if (match := _CELL.fullmatch(cell))]
    names = [name for name, _ in heads if name]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError(f"the table {path} has two columns named {printable(twice)!r}")
    return heads


def _column(one: Mapped, path: Path, names: Sequence[str]) -> int | None:
    if one.place.column and one.place.column in names:  # a column may have no name, as the one with pandas' index
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


def _numbers(
    rows: Reader, used: Sequence[int], heads: Sequence[tuple[str, str]], whole: bool, path: Path
) -> tuple[list[Floats], bool]:
    """Return some columns of the rows that follow, and whether something of the last line was left out."""
    columns = [array("d") for _ in used]
    waiting: list[str] = []  # of the line before, as the last one may be cut off
    line, cut = 0, False
    for row in rows:
        if waiting:
            _append(waiting, columns, used, heads, Location(str(path), line))
        waiting, line = row, rows.line_num
    if waiting and not whole and len(waiting) <= len(heads):
        cut = used[-1] >= len(waiting) - 1
        waiting = [*waiting[:-1], *[""] * (len(heads) - len(waiting) + 1)]  # a comma ends each of the others
    if waiting:
        _append(waiting, columns, used, heads, Location(str(path), line))
    if not len(columns[0]):
        raise InputError(f"the table {path} has no rows below its first line")
    return [np.frombuffer(column).copy() for column in columns], cut


def _notes(path: Path, cut: bool, timeless: int) -> Iterator[str]:
    if cut:
        yield (
            f"{path.name}: the last line has no line end, so its last number may be cut off, and is left out, as "
            "is what does not follow it; add a line end if it is whole"
        )
    if timeless:
        yield f"{path.name}: {timeless} rows have no time and are left out"


def _append(
    row: Sequence[str],
    columns: Sequence[array[float]],
    used: Sequence[int],
    heads: Sequence[tuple[str, str]],
    where: Location,
) -> None:
    if len(row) != len(heads):
        raise InputError(f"the row has {len(row)} cells, but the first line names {len(heads)}", where)
    for at, column in zip(used, columns, strict=True):
        try:
            number = float(row[at] or "nan")
        except ValueError:
            cell, name = printable(row[at])[:80], printable(heads[at][0])
            raise InputError(f"{cell!r} in the column {name!r} is not a number", where) from None
        column.append(number if math.isfinite(number) else math.nan)


def _seconds(values: Floats, unit: str, name: str, path: Path) -> Floats:
    try:
        own = units.parse(unit or "s")
    except UnitError as error:
        raise InputError(f"the column {name!r} of {path}: {error}") from None
    if own.exponents != units.parse("s").exponents:
        raise InputError(f"the column {name!r} of {path} is in {unit}, which is no time")
    return values if own.factor == 1.0 else values * own.factor
