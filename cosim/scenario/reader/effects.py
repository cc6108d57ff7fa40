"""Effects of sensors and actuators."""

from __future__ import annotations

from collections.abc import Iterable

from cosim.scenario.reader.element import Element
from cosim.scenario.reader.entries import check_names
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import EffectSource

_OF_ENTRIES = ("noise", "bias", "quantisation")
"""Effects whose attributes are entries of a pose, besides a window."""
_WINDOW = ("from", "to")


def effects(elements: Iterable[Element], times: Times) -> tuple[EffectSource, ...]:
    """Read the effects in a <sensor> or an <actuator>, if there is one; the amounts are read for a robot."""
    return tuple(_effect(child, times) for own in elements for child in own.inside)


def _effect(element: Element, times: Times) -> EffectSource:
    start, stop = times.span(element, exact=True)
    if element.kind in _OF_ENTRIES:
        check_names(element, "pose", _WINDOW)
    return EffectSource(element.kind, element.attributes, element.where, element.folder, start, stop)
