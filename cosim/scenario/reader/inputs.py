"""What inputs of plants are given: sums of waves."""

from __future__ import annotations

import math

from cosim.scenario.reader.element import Element
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import InputSource, Wave


def inputs(element: Element, times: Times) -> tuple[InputSource, ...]:
    """Read the inputs in an element."""
    return tuple(_input(child, times) for child in element.children("input"))


def _input(element: Element, times: Times) -> InputSource:
    waves = tuple(_wave(wave, times) for wave in element.inside)
    if bool(waves) == ("value" in element):
        raise element.error("an <input> has either a value, which it keeps, or signals")
    return InputSource(element.get("name"), waves or (_constant(element),), element.where)


def _constant(element: Element) -> Wave:
    return Wave("constant", element.get("value"), 0.0, math.inf, 0.0, 0.0, 0.0, None, "", element.where)


def _wave(element: Element, times: Times) -> Wave:
    kind = element.kind
    start, stop = times.span(element) if kind in ("ramp", "pulse") else times.window(element)
    if kind == "step":
        start = times.beginning(element, "at")
    cutoff = element.positive("cutoff", "Hz") if kind == "random" else 0.0
    if cutoff >= 0.5 / times.step:
        raise element.error(
            f"the cutoff {cutoff:g} Hz is not below half of the ticks' frequency, {0.5 / times.step:g} Hz"
        )
    return Wave(
        kind=kind,
        value=element.get("value"),
        start=start,
        stop=stop,
        period=element.positive("period", "s") if kind == "sine" else 0.0,
        phase=element.quantity("phase", "rad") if "phase" in element else 0.0,
        cutoff=cutoff,
        file=element.path("file") if kind == "table" else None,
        column=element.get("column"),
        where=element.where,
    )
