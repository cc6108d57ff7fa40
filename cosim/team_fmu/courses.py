"""Courses over time as C: a number where one is constant, a table over the ticks where it is not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.storage import is_constant
from cosim.team_fmu.c_text import number, numbers

FUNCTION = """\
/* The value of a course at a tick; from the end of its table on, its last one. */
static double at(const double course[], long long count, long long tick)
{
    return course[tick < count ? tick : count - 1];
}
"""


class Courses:
    """Courses that are used in expressions.

    Attributes
    ----------
    tables : list of str
        The definitions of their tables.
    last : int or None
        The last tick of the courses, if one of them still changes there; None if all stay what they are.
    """

    def __init__(self) -> None:
        self.tables: list[str] = []
        self.last: int | None = None

    def of(self, name: str, course: NDArray[np.float64]) -> str:
        """Return the value of a course (ticks,) at a tick, as an expression of the variable ``tick``."""
        if is_constant(course) or (course == course[0]).all():
            return number(float(course[0]))
        changes = np.flatnonzero(course[1:] != course[:-1])
        count = int(changes[-1]) + 2
        if count == len(course):
            self.last = len(course) - 1
        table = f"course_{len(self.tables) + 1}"
        self.tables.append(f"/* {name} */\n" + numbers(f"double {table}[{count}]", course[:count]))
        return f"at({table}, {count}, tick)"
