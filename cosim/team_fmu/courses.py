"""Courses over time as C: a number where one is constant, a table over the ticks where it is not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.storage import is_constant
from cosim.team_fmu.c_text import number, numbers, table

PLACE_OF = """\
/* The last place in an ascending array whose tick has come; the first one's has. */
static long long place_of(const long long ticks[], long long count, long long tick)
{
    long long low = 0, high = count;
    while (high - low > 1) {
        const long long middle = low + (high - low) / 2;
        if (ticks[middle] <= tick) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}
"""


class Courses:
    """Courses that are used in expressions; some of these call `PLACE_OF`.

    Attributes
    ----------
    tables : list of str
        The definitions of their tables.
    last : int or None
        The last tick of the courses, if one of them still changes there; None if all stay what they are.
    count : int
        How many numbers the tables have.
    """

    def __init__(self) -> None:
        self.tables: list[str] = []
        self.last: int | None = None
        self.count = 0

    def of(self, name: str, course: NDArray[np.float64]) -> str:
        """Return the value of a course (ticks,) at a tick, as an expression of the variable ``tick``.

        Behind the end of the course it is its last value.
        """
        if is_constant(course):
            return number(float(course[0]))
        bits = np.ascontiguousarray(course, dtype=np.float64).view(np.int64)  # so that -0.0 is another value than 0.0
        changes = np.flatnonzero(np.r_[True, bits[1:] != bits[:-1]])
        if len(changes) == 1:
            return number(float(course[0]))
        size = int(changes[-1]) + 1
        if size == len(course):
            self.last = len(course) - 1
        place = len(self.tables) + 1
        if 2 * len(changes) < size:
            values, at = course[changes], f"place_of(ticks_{place}, {len(changes)}, tick)"
            ticks = table(f"long long ticks_{place}[{len(changes)}]", map(str, changes.tolist())) + "\n"
        else:
            values, at, ticks = course[:size], f"tick < {size} ? tick : {size - 1}", ""
        self.count += len(values)
        self.tables.append(f"/* {name} */\n{ticks}" + numbers(f"double values_{place}[{len(values)}]", values))
        return f"values_{place}[{at}]"
