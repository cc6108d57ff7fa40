"""A file of MATLAB, version 5: a struct for each robot, with a column for each number, and their units in a like one.

The names are those of the result as far as MATLAB takes them, ``follower_1.pose.x``; whatever is no letter, digit or
underscore becomes an underscore. ``units.follower_1.pose.x`` is the unit, and ``about`` states the provenance.
"""

from __future__ import annotations

import re
from io import BytesIO
from pathlib import Path
from typing import Any

from cosim.errors import InputError
from cosim.export.courses import courses_of
from cosim.export.formats import Options
from cosim.results.files import write as write_file
from cosim.results.result import Result

LONGEST = 63
"""Characters of a name in MATLAB."""
_KEYWORDS = re.compile(
    "break|case|catch|classdef|continue|else|elseif|end|for|function|global|if|otherwise|parfor|persistent|return|spmd|"
    "switch|try|while"
)
_ABOUT = ("title", "scenario_name", "status", "seed", "step", "horizon", "versions", "scenario")


class _Struct(dict[str, Any]):
    """The content of a struct, with the names that stand for those of a result."""

    def __init__(self, **content: Any) -> None:
        super().__init__(content)
        self._names: dict[str, str] = {}

    def part(self, name: str) -> _Struct:
        """Return the struct of a name in it, which is made if there is none."""
        part: _Struct = self.setdefault(self.own(name), _Struct())
        return part

    def own(self, name: str) -> str:
        """Return the name in MATLAB of a name in a result, which no other has in this struct."""
        if name not in self._names:
            wanted = found = matlab_name(name)
            number = 1
            while found in self:
                end = f"_{(number := number + 1)}"
                found = wanted[: LONGEST - len(end)] + end
            self._names[name] = found
        return self._names[name]


def matlab_name(name: str) -> str:
    """Return the name that MATLAB takes and that is nearest to a name."""
    found = re.sub(r"[^A-Za-z0-9_]", "_", name).lstrip("_")
    if not found[:1].isalpha() or _KEYWORDS.fullmatch(found):
        found = f"x_{found}"
    return found[:LONGEST]


def write(result: Result, path: Path, options: Options) -> None:
    """Write the file.

    Raises
    ------
    InputError
        A robot has more numbers than the format can hold.
    OutputError
        The file cannot be written.
    """
    from scipy.io import savemat

    units = _Struct(time="s")
    about = {name: result.attrs[name] for name in _ABOUT if name in result.attrs}
    content = _Struct(time=result["time"].values.reshape(-1, 1), units=units, about=about)
    for course in courses_of(result):
        values, its_units = content, units
        for name in course.path[:-1]:
            values, its_units = values.part(name), its_units.part(name)
        *_, last = course.path
        values[values.own(last)] = course.values.reshape(-1, 1)
        its_units[its_units.own(last)] = course.unit
    file = BytesIO()
    try:
        savemat(file, content, long_field_names=True)
    except ValueError as error:  # a struct of 2 GiB, or of 4 GiB
        raise InputError(
            f"{path}: a .mat file of version 5 cannot hold so many numbers ({error}): export to .csv or .mcap"
        ) from None
    write_file(path, file.getbuffer())
