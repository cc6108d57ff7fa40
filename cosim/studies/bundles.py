"""The courses of all runs of a study together, for each envelope and case: what their picture is drawn from.

An envelope that compares two cases has the differences of their courses, one for each draw.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.studies.compared_cases import ComparedCases, compared_cases
from cosim.studies.courses import Course, Envelope
from cosim.studies.row import BROKEN, Row
from cosim.studies.store import Store
from cosim.studies.study import Study
from cosim.studies.values import Finite

_MOST = 20_000_000
"""Numbers of a bundle; of more runs than have so many, some are taken, evenly spaced."""


@dataclass(frozen=True, eq=False)
class Bundle:
    """The courses of the runs of one case, or differences between those of two.

    Attributes
    ----------
    title : str
        The case; empty if there is only one.
    place : int
        The index of the envelope in the study.
    envelope : Envelope
        What it is about.
    robots : tuple of str
        The robots.
    values : ndarray
        (runs, R, T, C): see `cosim.studies.courses.Course`.
    runs : tuple of int
        The numbers of these runs; of pairs, those of the first ones.
    worst : int or None
        Which of the runs is the worst one; None if nothing says so.
    number : int or None
        The number of the worst run.
    ended, broken : int
        How many runs have reached their end, of which those with values may be some; and how many have not.
    of : str
        What these are: runs, or pairs of runs.
    """

    title: str
    place: int
    envelope: Envelope
    robots: tuple[str, ...]
    values: NDArray[np.float32] | NDArray[np.float64]
    runs: tuple[int, ...]
    worst: int | None
    number: int | None
    ended: int
    broken: int
    of: str = "runs"


def bundles_of(study: Study, rows: Sequence[Row], store: Store) -> tuple[Bundle, ...]:
    """Return the bundles of a study, those of an envelope one after another, from rows that a store keeps."""
    if not study.envelopes:
        return ()
    compared = [index for index, vary in enumerate(study.vary) if vary.cases or vary.crossed]
    found: list[Bundle] = []
    for place, written in enumerate(study.envelopes):
        if (cases := compared_cases(study, written)) is None:
            found += _of_cases(study, place, _groups(rows, compared), compared, store)
        else:
            others = [index for index in compared if index != cases.place]
            found += _of_pairs(study, place, _groups(rows, others), others, cases, store)
    return tuple(found)


def _groups(rows: Iterable[Row], by: Sequence[int]) -> Iterable[list[Row]]:
    """Return the rows with equal values of some that vary, together."""
    groups: dict[tuple[str | None, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row.values[index] for index in by), []).append(row)
    return groups.values()


def _of_cases(
    study: Study, place: int, groups: Iterable[Sequence[Row]], compared: Sequence[int], store: Store
) -> Iterator[Bundle]:
    for group in groups:
        ended = [row for row in group if row.status != BROKEN]
        if not ended:
            continue
        envelope = Envelope(study.envelopes[place], study.bases[_cases(study, group[0])])
        worst = _worst(study, ended)
        shown = _some(ended, worst, envelope.read(next(store.courses(ended))[place]).values.size)
        robots, values = _stacked([envelope.read(texts[place]) for texts in store.courses(shown)])
        yield Bundle(
            title=_title(study, group[0], compared),
            place=place,
            envelope=envelope,
            robots=robots,
            values=values,
            runs=tuple(row.number for row in shown),
            worst=None if worst is None else shown.index(worst),
            number=None if worst is None else worst.number,
            ended=len(ended),
            broken=len(group) - len(ended),
        )


def _of_pairs(
    study: Study,
    place: int,
    groups: Iterable[Sequence[Row]],
    others: Sequence[int],
    cases: ComparedCases,
    store: Store,
) -> Iterator[Bundle]:
    for group in groups:
        one, other = (
            {row.draw: row for row in group if row.values[cases.place] == text} for text in (cases.case, cases.than)
        )
        draws = sorted(one.keys() & other.keys())
        ended = [draw for draw in draws if BROKEN not in (one[draw].status, other[draw].status)]
        if not ended:
            continue
        envelope = Envelope(study.envelopes[place], study.bases[_cases(study, one[ended[0]])])
        size = envelope.read(next(store.courses([one[ended[0]]]))[place]).values.size
        shown = _some([one[draw] for draw in ended], None, size)
        pairs = zip(store.courses(shown), store.courses([other[row.draw] for row in shown]), strict=True)
        robots, values = _stacked([_less(*(envelope.read(texts[place]) for texts in pair)) for pair in pairs])
        titles = f"{study.vary[cases.place].name} {cases}", _title(study, group[0], others)
        yield Bundle(
            title=", ".join(filter(None, titles)),
            place=place,
            envelope=envelope,
            robots=robots,
            values=values,
            runs=tuple(row.number for row in shown),
            worst=None,
            number=None,
            ended=len(ended),
            broken=len(draws) - len(ended),
            of="pairs of runs",
        )


def _less(one: Course, other: Course) -> Course:
    """Return a course less another, of the robots that both have."""
    both = [robot for robot in one.robots if robot in other.robots]
    rows, its = ([course.robots.index(robot) for robot in both] for course in (one, other))
    return Course(tuple(both), one.values[rows] - other.values[its])


def _stacked(courses: Sequence[Course]) -> tuple[tuple[str, ...], NDArray[np.float32] | NDArray[np.float64]]:
    """Return the robots of all courses, and the values (runs, R, T, C); NaN of a robot that a run has not."""
    robots = tuple(dict.fromkeys(robot for course in courses for robot in course.robots))
    precision = np.result_type(*{course.values.dtype for course in courses})
    values = np.full((len(courses), len(robots), *courses[0].values.shape[1:]), np.nan, precision)
    for own, course in zip(values, courses, strict=True):
        own[[robots.index(robot) for robot in course.robots]] = course.values
    return robots, values


def _title(study: Study, row: Row, named: Sequence[int]) -> str:
    return ", ".join(f"{study.vary[index].name} {row.values[index]}" for index in named)


def _cases(study: Study, row: Row) -> tuple[int, ...]:
    """Return which scenario of a study a run has; see `Study.bases`."""
    return tuple(
        list(vary.values.texts).index(value)
        for vary, value in zip(study.vary, row.values, strict=True)
        if vary.cases and isinstance(vary.values, Finite) and value is not None
    )


def _worst(study: Study, rows: Sequence[Row]) -> Row | None:
    """Return the run with the least margin; where nothing is expected, the one with the worst first measure."""
    worst = min(rows, key=lambda row: row.least)
    if worst.least < math.inf:
        return worst
    if not study.measures:
        return None
    sign = 1.0 if study.measures[0].greatest_is_worst else -1.0
    return max(rows, key=lambda row: sign * row.measures[0])


def _some(rows: Sequence[Row], worst: Row | None, numbers: int) -> list[Row]:
    """Return as many runs with so many numbers as may be drawn, the worst one among them."""
    most = max(_MOST // numbers, 2)
    if len(rows) <= most:
        return list(rows)
    chosen = [rows[index] for index in np.linspace(0, len(rows) - 1, most - 1).round().astype(int)]
    return chosen if worst is None or worst in chosen else [*chosen, worst]
