"""The events of a run, as its scenarios state them."""

from __future__ import annotations

import json
import math

from cosim.errors import InputError
from cosim.results.provenance import Part
from cosim.results.result import Result
from cosim.scenario.reader import read_events
from cosim.scenario.scenario import Event


def events_of(result: Result) -> tuple[Event, ...]:
    """Return the events of a run in the order of time; of a branch, each from the scenario that it had at that time.

    They are those of the scenario: a run that ended early did not come to all of them. A scenario whose text this
    version cannot read has none, and neither has a recorded drive, to which nobody has done what the scenario states.
    """
    told, step = result.attrs, float(result.attrs["step"])
    if "recording" in told:
        return ()
    texts = [(math.inf, str(told["scenario"]))]  # each with its end [ticks], the last one first
    for part in reversed([Part.of(data) for data in json.loads(told.get("parts", "[]"))]):
        texts.append((round(part.until / step), part.scenario or texts[-1][1]))
    found: list[Event] = []
    begin = 0.0
    for end, text in reversed(texts):
        try:
            events = read_events(text, told.get("scenario_file") or told["scenario_name"])
        except InputError:
            events = ()
        found += (event for event in events if begin <= round(event.time / step) < end)
        begin = end
    return tuple(found)
