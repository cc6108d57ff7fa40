"""From the elements <measure> of a study file to what is measured; checks beyond the schema."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from lxml import etree

from cosim.errors import Location, nearest
from cosim.scenario.reader.element import Element
from cosim.studies.study import Cost, Measured

_SIGNALS = {"rms", "peak", "final", "itae", "chatter", "effort", "least"}
_SUBTRACTED = ("minus", "minus_component", "minus_robot")
_KEPT = ("signal", "component", *_SUBTRACTED, "from", "to", "robots")
"""Attributes that an expectation has, too."""


def read_measures(elements: Iterable[Element]) -> tuple[list[Measured], list[tuple[etree._Element, Location]]]:
    """Return the measures of a study, and the expectations whose figures they are, each with its place.

    Raises
    ------
    InputError
        A measure makes no sense; with its place.
    """
    measures: list[Measured] = []
    expected: list[tuple[etree._Element, Location]] = []
    for element in elements:
        if any(True for _ in element.children("cost")):
            measures.append(_sum(element, measures))
        else:
            measured, own = _measured(element)
            measures.append(measured)
            expected.append((own, measured.where))
    return measures, expected


def read_cost(element: Element, measures: Sequence[Measured]) -> Cost:
    """Return a part of a sum of some measures; raises InputError with its place if it makes no sense."""
    name, names = element.get("of"), [measured.name for measured in measures]
    if name not in names:
        advice = nearest(name, names) if names else f"add <measure name={name!r} .../>"
        raise element.error(f"the study has no measure {name!r}: {advice}")
    measured = measures[names.index(name)]
    per = element.positive("per", measured.unit or "1") if "per" in element else 1.0
    return Cost(names.index(name), per if measured.greatest_is_worst else -per)


def _sum(element: Element, before: Sequence[Measured]) -> Measured:
    """Return a sum of measures that are before it."""
    for name in element.attributes:
        if name != "name":
            raise element.error(f"the <measure> {element.get('name')!r} is a sum of costs: leave {name}=... out")
    for child in element.children("cost"):
        if child.get("of") == element.get("name"):
            raise child.error(f"{child.get('of')!r} is the sum itself: name measures above it")
    parts = tuple(read_cost(child, before) for child in element.children("cost"))
    return Measured(element.get("name"), over="", greatest_is_worst=True, unit="", where=element.where, parts=parts)


def _measured(element: Element) -> tuple[Measured, etree._Element]:
    """Return a measure, and an expectation whose figure it is; the bound is of no account."""
    figure = element.get("figure")
    if not figure:
        raise element.error("<measure> needs figure=..., or <cost> elements that are added up")
    _check_attributes(element, figure)
    unit = element.get("unit", {"settling_time": "s", "distance": "m"}.get(figure, ""))
    if not unit:
        raise element.error(f'figure="{figure}" of <measure> needs unit=..., such as that of the signal')
    over = element.get("over", "worst")
    if over == "count" and figure != "settling_time":
        raise element.error(f'over="count" of <measure> counts followers that settle: figure="{figure}" has none')
    kept = {name: element.get(name) for name in _KEPT if name in element}
    bands = {"range": element.get("range", "0.1 m"), "bearing": element.get("bearing", "2 deg")}
    one = "1" if unit == "1" else f"1 {unit}"
    kind, bound = {
        "settling_time": ("settled", {"by": f"0 {unit}", **bands}),
        "distance": ("distance", {"above": one}),
        "least": ("least", {"above": one}),
    }.get(figure, (figure, {"below": one}))
    measured = Measured(
        name=element.get("name"),
        over=over,
        greatest_is_worst=figure not in ("least", "distance") and over != "count",
        unit="" if unit == "1" or over == "count" else unit,
        where=element.where,
    )
    return measured, etree.Element(kind, {**kept, **bound})


def _check_attributes(element: Element, figure: str) -> None:
    if figure in _SIGNALS and "signal" not in element:
        raise element.error(f'figure="{figure}" of <measure> needs signal=..., such as signal="range_error"')
    misplaced = {
        "signal": figure not in _SIGNALS,
        **dict.fromkeys(("component", *_SUBTRACTED), figure not in _SIGNALS),
        "from": figure == "settling_time",
        "to": figure == "settling_time",
        "range": figure != "settling_time",
        "bearing": figure != "settling_time",
    }
    for name, wrong in misplaced.items():
        if wrong and name in element:
            raise element.error(f'figure="{figure}" of <measure> has no {name}=...: leave it out')
