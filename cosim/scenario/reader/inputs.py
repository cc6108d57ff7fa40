"""Values of the inputs of plants: sums of waves."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from dataclasses import replace

from cosim.scenario.reader.element import Element
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import InputSource, WaveSource


def inputs(elements: Iterable[Element], times: Times) -> tuple[InputSource, ...]:
    """Read inputs."""
    return tuple(_input(element, times) for element in elements)


def _input(element: Element, times: Times) -> InputSource:
    times = replace(times, ticks=sys.maxsize) if "later" in element else times
    waves = tuple(_wave(wave, times) for wave in element.inside)
    if bool(waves) == ("value" in element):
        raise element.error('an <input> takes either value="..." or signals within it')
    return InputSource(element.get("name"), waves or (_constant(element),), element.where)


def _constant(element: Element) -> WaveSource:
    return WaveSource("constant", {"value": element.get("value")}, element.where, element.folder, 0.0, math.inf)


def _wave(element: Element, times: Times) -> WaveSource:
    start, stop = times.span(element, exact=element.kind != "ramp")
    if "at" in element:
        start = times.beginning(element, "at")
    return WaveSource(element.kind, element.attributes, element.where, element.folder, start, stop)
