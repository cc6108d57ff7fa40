"""From the elements <tune> and <search> of a study file to what they ask for; checks beyond the schema."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from cosim.errors import InputError, nearest
from cosim.scenario.reader.element import Element
from cosim.studies.read_measures import read_cost
from cosim.studies.study import Measured, Sample, Search, Tune, Vary
from cosim.studies.values import Count, Random

MOST_DRAWS = 100_000
"""Upper limit for the number of a draw."""


def read_tune(element: Element, vary: Sequence[Vary], measures: Sequence[Measured]) -> Tune:
    """Return what is tuned, and how.

    Raises
    ------
    InputError
        It makes no sense; with its place.
    """
    training, held_out = _draws(element, "training"), _draws(element, "held_out")
    both = sorted(set(training) & set(held_out))
    if both:
        raise element.error(f"draw {both[0]} is in training and in held_out, so it would not be held out")
    tune = Tune(
        values=_values(element, vary),
        costs=tuple(read_cost(child, measures) for child in element.children("cost")),
        method=element.get("method", "cma_es"),
        evaluations=int(element.get("evaluations")),
        restarts=int(element.get("restarts", "1")),
        batch=int(element.get("batch", "10")),
        seed=int(element.get("seed", "0")),
        training=training,
        held_out=held_out,
        confidence=_share(element, "confidence"),
        prune=_share(element, "prune") if "prune" in element else None,
        fails=element.get("fails"),
        where=element.where,
    )
    _check_sizes(element, tune)
    return tune


def read_search(element: Element, vary: Sequence[Vary]) -> Search:
    """Return how the worst case is searched; raises InputError with its place if it makes no sense."""
    for one in vary:
        if one.crossed:
            raise InputError(
                f"{one.name!r} is crossed, and a search chooses all values: leave cross=... out", one.where
            )
        if isinstance(one.values, Random) and not _has_ends(one.values):
            raise InputError(f"{one.name!r} has no end, where a search would go: give from=... and to=...", one.where)
    if all(isinstance(one.values, Count) for one in vary):
        raise InputError(f"{vary[0].name!r} grows from run to run, so nothing is left to search", vary[0].where)
    return Search(
        runs=int(element.get("runs")),
        batch=int(element.get("batch", "10")),
        seed=int(element.get("seed", "0")),
        early="stop" in element,
        fails=element.get("fails"),
        where=element.where,
    )


def draws_of(search: Tune | Search) -> Sample:
    """Return how the draws of what is not searched are chosen: independent of each other, which comparisons rely on."""
    runs = search.runs if isinstance(search, Search) else max(*search.training, *search.held_out)
    return Sample("random", runs, search.seed, search.where)


def _has_ends(values: Random) -> bool:
    return math.isfinite(values.least) and math.isfinite(values.greatest)


def _draws(element: Element, name: str) -> tuple[int, ...]:
    """Return numbers such as "1 to 4 9"."""
    found: list[int] = []
    for first, last in re.findall(r"(\d+)(?: to (\d+))?", element.get(name)):
        begin, end = int(first), int(last or first)
        if begin > end:
            raise element.error(f'{name}="{element.get(name)}" of <tune>: {begin} is after {end}: exchange them')
        if end > MOST_DRAWS:
            raise element.error(f'{name}="{element.get(name)}" of <tune>: draws have numbers up to {MOST_DRAWS}')
        found += range(begin, end + 1)
    twice = next((number for number in found if found.count(number) > 1), None) if len(found) <= 1000 else None
    if twice is not None:
        raise element.error(f'{name}="{element.get(name)}" of <tune> has draw {twice} twice')
    return tuple(dict.fromkeys(found))


def _values(element: Element, vary: Sequence[Vary]) -> tuple[int, ...]:
    names = [one.name for one in vary]
    found = []
    for name in element.get("values").split():
        if name not in names:
            raise element.error(f"nothing varies that is named {name!r}: {nearest(name, names)}")
        index = names.index(name)
        values = vary[index].values
        if not isinstance(values, Random) or not _has_ends(values):
            raise InputError(
                f"{name!r} cannot be tuned: a continuous range with two ends is needed, such as <uniform> or "
                "<log_uniform>",
                vary[index].where,
            )
        if values.least == values.greatest:
            raise InputError(f"{name!r} cannot be tuned: its range holds one value", vary[index].where)
        if index in found:
            raise element.error(f"{name!r} is given twice in values")
        found.append(index)
    for index, one in enumerate(vary):
        if one.cases and not one.crossed:
            raise InputError(f'each case of {one.name!r} is tuned by itself: add cross="yes" to it', one.where)
        if one.crossed and not one.cases:
            raise InputError(f"{one.name!r} is crossed, which a study that tunes has of cases alone", one.where)
        if one.case and index not in found:
            raise InputError(f"{one.name!r} is of one case and not tuned: draws are the same for all cases", one.where)
    return tuple(found)


def _share(element: Element, name: str) -> float:
    value = float(element.get(name))
    if not 0.0 < value < 1.0:
        raise element.error(f'{name}="{element.get(name)}" of <tune> is not between 0 and 1')
    return value


def _check_sizes(element: Element, tune: Tune) -> None:
    if tune.restarts * 2 > tune.evaluations:
        raise element.error(
            f"{tune.evaluations} evaluations are too few for {tune.restarts} restarts: each needs at least 2"
        )
