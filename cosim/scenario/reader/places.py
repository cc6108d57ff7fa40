"""The places of followers in the formation, and how they change."""

from __future__ import annotations

from cosim.scenario.reader.element import Element
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import PlaceChange


def desired_place(element: Element) -> tuple[float, float]:
    """Read the range [m] and the bearing [rad] at the start."""
    return element.positive("range", "m"), element.quantity("bearing", "rad")


def changes(desired: Element, times: Times) -> tuple[PlaceChange, ...]:
    """Read the changes of a place, one after the other."""
    found: list[PlaceChange] = []
    place = desired_place(desired)
    before = 0.0
    for element in desired.children("change"):
        start, stop = times.span(element, exact=False)
        if start < before:
            raise element.error(
                f"the change from {start:.12g} s begins before {before:.12g} s, when the one before it ends"
            )
        if "range" not in element and "bearing" not in element:
            raise element.error("the <change> has neither a range nor a bearing: nothing changes")
        place = (
            element.positive("range", "m") if "range" in element else place[0],
            element.quantity("bearing", "rad") if "bearing" in element else place[1],
        )
        found.append(PlaceChange(start, stop, *place, element.where))
        before = stop
    return tuple(found)
