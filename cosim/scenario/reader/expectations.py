"""Expectations: conditions for a run to pass."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from cosim.scenario.reader.element import Element, robots
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import Expectation


def expectations(groups: Iterable[Element], times: Times, followers: Mapping[str, object]) -> tuple[Expectation, ...]:
    """Read the expectations in <expect>: windows and robots; their kinds read the rest."""
    return tuple(_expectation(element, times, followers) for group in groups for element in group.inside)


def _expectation(element: Element, times: Times, followers: Mapping[str, object]) -> Expectation:
    start, stop = times.window(element, times.horizon)
    named = robots(element, followers) if "robots" in element else ()
    return Expectation(element.kind, element.attributes, element.where, element.folder, start, stop, named)
