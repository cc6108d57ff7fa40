"""What must hold for a run to pass."""

from __future__ import annotations

import math
from pathlib import Path

from cosim.quantity import split
from cosim.scenario.reader.element import Element, robots
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import Expectation


def expectations(
    root: Element, times: Times, followers: list[str], untrusted: tuple[Path, ...]
) -> tuple[Expectation, ...]:
    """Read what a scenario expects."""
    return tuple(
        _expectation(element, times, followers, untrusted)
        for group in root.children("expect")
        for element in group.inside
    )


def _expectation(element: Element, times: Times, followers: list[str], untrusted: tuple[Path, ...]) -> Expectation:
    kind, horizon = element.kind, times.horizon
    start, stop = times.window(element, horizon)
    if not start < stop <= horizon and kind != "final":
        raise element.error(f"the window from {start:g} s to {stop:g} s is not within the run of {horizon:g} s")
    bound, unit = 0.0, "1"
    if kind == "settled":
        bound, unit = split(element.get("by"))
        if not 0 <= (by := element.quantity("by", "s")) < horizon:
            raise element.error(f"{by:g} s is not within the run of {horizon:g} s")
    elif kind == "compare":
        bound = float(element.get("factor", "nan"))
        if bound <= 0:
            raise element.error(f'factor="{element.get("factor")}" of <compare> must be greater than zero')
    elif kind != "regular":
        bound, unit = split(element.get("above" if kind in ("least", "distance") else "below"))
    return Expectation(
        kind=kind,
        signal=element.get("signal"),
        component=element.get("component"),
        bound=bound,
        unit=unit,
        start=start,
        stop=stop,
        range_band=element.positive("range", "m") if kind == "settled" else math.inf,
        bearing_band=element.positive("bearing", "rad") if kind == "settled" else math.inf,
        measure=element.get("measure"),
        scenario=element.path("scenario") if kind == "compare" else None,
        robots=robots(element, followers) if "robots" in element else (),
        fails=element.get("fails"),
        where=element.where,
        untrusted=untrusted,
    )
