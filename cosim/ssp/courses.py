"""Courses over time as an FMU: inputs of plants that a scenario states, and the motion of a leader on a given path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import plants
from cosim.errors import InputError
from cosim.team_fmu.courses import PLACE_OF, Courses
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
/* Courses over time, one an output. */
#include "model.h"

void model_start(const double *parameters, const int *integers, Memory *memory)
{
    (void)parameters;
    (void)integers;
    (void)memory;
}
"""
_TICK = """
const char *model_tick(long long tick, const double *inputs, const double *parameters, const int *integers,
                       Memory *memory, struct Tool *tool, double *outputs)
{
    (void)tick;
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
    found = Courses()
    values = [found.of(course.name, course.values) for course in courses]
    if found.count > MOST_VALUES:
        raise InputError(
            f"the courses over time are {found.count:,} numbers, and an FMU of them may have {MOST_VALUES:,}: shorten "
            "the run by --horizon, or lengthen its step"
        )
    last = len(courses[0].values) - 1
    lines = [f"    outputs[{place}] = {value};" for place, value in enumerate(values)]
    functions = [PLACE_OF] if any("place_of(" in value for value in values) else []
    model = Sampled(
        name=name,
        description=description,
        step=step,
        sources={
            "memory.h": _MEMORY,
            "courses.c": "\n".join([_HEAD, *functions, *found.tables, _TICK % "\n".join(lines)]),
        },
        last=last,
        stop=last * step,
        outputs=tuple(Port(course.name, course.unit, course.description, depends=()) for course in courses),
    )
    return plants.build(model)
