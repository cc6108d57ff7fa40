"""Whose full results are kept: from the element <keep> of a study file, or an option in its words; and checks."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from cosim.errors import InputError, Location, nearest, shown
from cosim.scenario.edits import as_setting
from cosim.scenario.reader.element import Element
from cosim.studies.study import Keep, Measured, Study

_RUNS = re.compile(r"(all|worst|median)|(\d{1,7})(?: to (\d{1,7}))?")


def read_keep(element: Element, measures: Sequence[Measured]) -> Keep:
    """Return which runs an element ``<keep>`` is about; raises InputError with its place if it makes no sense."""
    name, names = element.get("of"), [measured.name for measured in measures]
    if name and name not in names:
        raise element.error(f"the study has no measure {name!r}: {nearest(name, names) if names else 'add it'}")
    return _keep(element.get("runs"), element.where, names.index(name) if name else None)


def keeping(study: Study, text: str, option: str) -> Study:
    """Return a study that keeps the full results of other runs, too, as an option asks for them; empty for none."""
    return replace(study, keep=(*study.keep, _keep(text, Location(option)))) if text else study


def _keep(text: str, where: Location, of: int | None = None) -> Keep:
    """Return which runs a text such as ``worst 3 to 5`` is about."""
    parts = list(_RUNS.finditer(text := " ".join(text.split())))
    if not parts or " ".join(part.group() for part in parts) != text:
        raise InputError(
            f'{shown(text)!r} names no runs: expected all, worst, median or numbers such as "3" or "5 to 9"', where
        )
    words = frozenset(part[1] for part in parts if part[1])
    ranges = tuple((int(part[2]), int(part[3] or part[2])) for part in parts if part[2])
    for first, last in ranges:
        if not 1 <= first <= last:
            raise InputError(f"there are no runs {first} to {last}: the first run is number 1", where)
    if of is not None and not words & {"worst", "median"}:
        raise InputError("of=... says which run is worst: leave it out, or ask for worst or median", where)
    return Keep(words, ranges, of, where)


def check_keep(study: Study, planned: int) -> None:
    """Check that a study has the runs whose full results are kept.

    Raises
    ------
    InputError
        It has fewer runs, none of them is worst, or no file can state its changes.
    """
    for change in study.changes if study.keep else ():
        as_setting(change)
    measures = {measured.where for measured in study.measures}
    expecting = all(any(one.where not in measures for one in base.expectations) for base in study.bases.values())
    for keep in study.keep:
        for _, last in keep.ranges:
            if last > planned:
                raise InputError(f"the study has {planned} runs, so there is no run {last}", keep.where)
        if keep.words & {"worst", "median"} and keep.of is None and not expecting:
            raise InputError(
                "a scenario of the study expects nothing, so no run has a least margin: name a measure, "
                '<keep runs="worst" of="..."/>',
                keep.where,
            )
