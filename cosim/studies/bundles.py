"""The courses of all runs of a study together, for each envelope and case: what their picture is drawn from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.studies.courses import Envelope
from cosim.studies.row import BROKEN, Row
from cosim.studies.store import Store
from cosim.studies.study import Study
from cosim.studies.values import Finite

_MOST = 20_000_000
"""Numbers of a bundle; of more runs than have so many, some are taken, evenly spaced."""


@dataclass(frozen=True, eq=False)
class Bundle:
    """The courses of the runs of one case.

    Attributes
    ----------
    title : str
        The case; empty if there is only one.
    envelope : Envelope
        What it is about.
    robots : tuple of str
        The robots.
    values : ndarray
        (runs, R, T, C): see `cosim.studies.courses.Course`.
    worst : int or None
        Which of the runs is the worst one; None if nothing says so.
    number : int or None
        The number of the worst run.
    ended, broken : int
        How many runs have reached their end, of which those with values may be some; and how many have not.
    """

    title: str
    envelope: Envelope
    robots: tuple[str, ...]
    values: NDArray[np.float32]
    worst: int | None
    number: int | None
    ended: int
    broken: int


def bundles_of(study: Study, rows: Sequence[Row], store: Store) -> tuple[Bundle, ...]:
    """Return the bundles of a study, those of an envelope one after another, from rows that a store keeps."""
    if not study.envelopes:
        return ()
    groups: dict[tuple[str | None, ...], list[Row]] = {}
    compared = [index for index, vary in enumerate(study.vary) if vary.cases or vary.crossed]
    for row in rows:
        groups.setdefault(tuple(row.values[index] for index in compared), []).append(row)
    return tuple(_bundles(study, groups.values(), compared, store))


def _bundles(study: Study, groups: Iterable[Sequence[Row]], compared: Sequence[int], store: Store) -> Iterator[Bundle]:
    for place, written in enumerate(study.envelopes):
        for group in groups:
            ended = [row for row in group if row.status != BROKEN]
            if not ended:
                continue
            envelope = Envelope(written, study.bases[_cases(study, group[0])])
            worst = _worst(study, ended)
            shown = _some(ended, worst, envelope.read(next(store.courses(ended))[place]).values.size)
            courses = [envelope.read(texts[place]) for texts in store.courses(shown)]
            robots = tuple(dict.fromkeys(robot for course in courses for robot in course.robots))
            values = np.full((len(shown), len(robots), *courses[0].values.shape[1:]), np.nan, dtype=np.float32)
            for own, course in zip(values, courses, strict=True):
                own[[robots.index(robot) for robot in course.robots]] = course.values
            yield Bundle(
                title=", ".join(f"{study.vary[index].name} {group[0].values[index]}" for index in compared),
                envelope=envelope,
                robots=robots,
                values=values,
                worst=None if worst is None else shown.index(worst),
                number=None if worst is None else worst.number,
                ended=len(ended),
                broken=len(group) - len(ended),
            )


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
