"""A wide table in a CSV file: a row for each tick, a column for each number, units in the first line.

It is written as tables are that a scenario reads, see `cosim.scenario.csv_table`: ``time [s],follower_1.pose.x [m]``.
Each number is the shortest text that reads back as the same number. A number that does not exist (NaN) is an empty
cell.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from cosim.export.courses import courses_of
from cosim.export.formats import Options
from cosim.results.files import replacing
from cosim.results.result import Result
from cosim.storage import blocks

_STRANGE = re.compile(r"[^\w./^*\- ]|^-|[^\S ]")
"""Characters that a name or a unit has no need of."""


def write(result: Result, path: Path, options: Options) -> None:
    """Write the table.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    courses = list(courses_of(result))
    columns = [result["time"].values, *(course.values for course in courses)]
    heads = ["time [s]", *(heading(course.path, course.unit) for course in courses)]
    with replacing(path) as file:
        file.write((",".join(heads) + "\n").encode())
        for block in blocks(len(columns[0]), len(columns)):
            rows = np.stack([column[block] for column in columns], axis=1).tolist()
            text = "\n".join([",".join(["" if cell != cell else repr(cell) for cell in row]) for row in rows])
            file.write(f"{text}\n".encode())


def heading(path: tuple[str, ...], unit: str) -> str:
    """Return the first line's cell of a column, in which nothing can be taken for a formula or the end of a cell."""
    name = _STRANGE.sub("_", ".".join(path))
    return name if unit == "1" else f"{name} [{_STRANGE.sub('_', unit)}]"
