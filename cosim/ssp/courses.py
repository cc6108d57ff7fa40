"""Courses over time as an FMU: inputs of plants that a scenario states, and the motion of a leader on a given path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import plants
from cosim.errors import InputError
from cosim.team_fmu.c_text import numbers, table
from plants.sampled import Port, Sampled

MOST_VALUES = 2_000_000
"""Upper limit for the numbers of an FMU, which a compiler must read as text."""

_MEMORY = """\
/* A course remembers nothing. */
#ifndef MEMORY_H
#define MEMORY_H

typedef struct {
    char unused;
} Memory;

#endif
"""
_HEAD = """\
/* Courses over time: for each output, the ticks at which it changes, and its values from there on. */
#include "model.h"

void model_start(const double *parameters, const int *integers, Memory *memory)
{
    (void)parameters;
    (void)integers;
    (void)memory;
}

/* Return the last place in an ascending array whose entry is not beyond a tick; the first entry is 0. */
static long long place_of(const long long *ticks, long long count, long long tick)
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
_TICK = """
const char *model_tick(long long tick, const double *inputs, const double *parameters, const int *integers,
                       Memory *memory, struct Tool *tool, double *outputs)
{
    (void)inputs;
    (void)parameters;
    (void)integers;
    (void)memory;
    (void)tool;
%s
    return 0;
}
"""


@dataclass(frozen=True, eq=False)
class Course:
    """A number over time.

    Attributes
    ----------
    name, unit, description : str
        The output that gives it.
    values : ndarray
        Its value at each communication point (ticks + 1), in its unit.
    """

    name: str
    unit: str
    description: str
    values: NDArray[np.float64]


def courses_fmu(name: str, description: str, courses: Sequence[Course], step: float) -> Path:
    """Return an FMU (FMI 2.0) that gives courses at the communication points.

    Parameters
    ----------
    name, description
        Of the FMU.
    courses
        Its outputs.
    step
        The communication step [s].

    Raises
    ------
    InputError
        There are more numbers than an FMU can have.
    plants.PlantError
        It cannot be built.
    """
    last = len(courses[0].values) - 1
    tables, lines = [], []
    changes = [_changes(course.values) for course in courses]
    if (count := sum(map(len, changes))) > MOST_VALUES:
        raise InputError(
            f"the courses over time are {count:,} numbers, and an FMU of them may have {MOST_VALUES:,}: shorten the "
            "run by --horizon, or lengthen its step"
        )
    for place, (course, ticks) in enumerate(zip(courses, changes, strict=True)):
        values = course.values[ticks]
        tables.append(numbers(f"double values_{place}[{len(values)}]", values))
        if len(ticks) > last:
            lines.append(f"    outputs[{place}] = values_{place}[tick];")
        elif len(ticks) == 1:
            lines.append(f"    outputs[{place}] = values_{place}[0];")
        else:
            tables.append(table(f"long long ticks_{place}[{len(ticks)}]", map(str, ticks.tolist())))
            lines.append(f"    outputs[{place}] = values_{place}[place_of(ticks_{place}, {len(ticks)}, tick)];")
    model = Sampled(
        name=name,
        description=description,
        step=step,
        sources={
            "memory.h": _MEMORY,
            "courses.c": _HEAD + "\n" + "\n".join(tables) + "\n" + _TICK % "\n".join(lines),
        },
        last=last,
        stop=last * step,
        outputs=tuple(Port(course.name, course.unit, course.description, depends=()) for course in courses),
    )
    return plants.build(model)


def _changes(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the ticks at which a course changes, the first one among them; all ticks if they are not few."""
    ticks = np.flatnonzero(np.r_[True, values[1:] != values[:-1]])
    return ticks if 2 * len(ticks) < len(values) else np.arange(len(values))
