"""Events: changes of robots at a time."""

from __future__ import annotations

from collections.abc import Iterator

from cosim.scenario.reader.element import Element, robots, settings
from cosim.scenario.reader.entries import commands
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import LEADER, Event


def events(element: Element, times: Times, followers: list[str]) -> Iterator[Event]:
    """Read an event, which is one for each robot that it happens to."""
    time = times.beginning(element, "at")
    named = robots(element, [LEADER, *followers])
    for tag in ("torque", "command", "stop"):
        if len(found := list(element.children(tag))) > 1:
            raise found[1].error(f"an event takes one <{tag}>: remove this second one")
    for given in element.children("input"):
        if "value" not in given or given.inside:
            raise given.error('an <input> of an event takes value="...", which holds from then on')
    driving = element.find("torque") or element.find("command")
    if driving is not None and named != (LEADER,):
        raise driving.error(
            f'<{driving.kind}> needs robots="leader": a follower gets its {driving.kind}s from its controller'
        )
    for robot in named:
        yield Event(
            time=time,
            robot=robot,
            parameters=settings(element, "parameter"),
            inputs=settings(element, "input"),
            torque=commands(element),
            stops=element.find("stop") is not None,
            where=element.where,
        )
