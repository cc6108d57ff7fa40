"""Events: changes of robots at a time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from cosim.scenario.reader.element import Element, robots, settings
from cosim.scenario.reader.entries import commands, driving
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import LEADER, Event


def events(element: Element, times: Times, among: Mapping[str, object]) -> Iterator[Event]:
    """Read an event as one event for each robot that it names, all of them among the known ones."""
    time = times.beginning(element, "at")
    named = robots(element, among)
    driven = driving(element)
    if len(stops := list(element.children("stop"))) > 1:
        raise stops[1].error("an event takes one <stop>: remove this second one")
    for given in element.children("input"):
        if "value" not in given or given.inside:
            raise given.error('an <input> of an event takes value="...", which holds from then on')
    if driven is not None and named != (LEADER,):
        raise driven.error(
            f'<{driven.kind}> needs robots="leader": a follower gets its {driven.kind}s from its controller'
        )
    parameters, inputs = settings(element, "parameter"), settings(element, "input")
    torque = None if driven is None else commands(driven)
    for robot in named:
        yield Event(
            time=time,
            robot=robot,
            parameters=parameters,
            inputs=inputs,
            torque=torque,
            stops=bool(stops),
            where=element.where,
        )
