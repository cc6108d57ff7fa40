"""The leader and the followers."""

from __future__ import annotations

from collections.abc import Mapping

from cosim.scenario.reader.effects import effects
from cosim.scenario.reader.element import Element, known, settings
from cosim.scenario.reader.entries import DRIVING, commands, driving, pose
from cosim.scenario.reader.inputs import inputs
from cosim.scenario.reader.places import changes, desired_place
from cosim.scenario.reader.times import Times
from cosim.scenario.reader.trajectory import trajectory
from cosim.scenario.scenario import EffectSource, Entries, Follower, Leader


def leader(element: Element, times: Times, plants: Mapping[str, object]) -> Leader:
    """Read the leader, given the ids of plants."""
    plant = known(element, "plant", plants)
    given, driven = element.find("trajectory"), driving(element)
    for tag in ("pose", *DRIVING, "input"):
        found = element.find(tag)
        if given is not None and found is not None:
            raise found.error(f"a leader with a <trajectory> has no <{tag}>: its motion follows from the path")
        if given is None and found is None and tag == "pose":
            raise element.error("the <leader> needs a <pose> to start from, or a <trajectory> to move along")
    return Leader(
        plant=plant,
        pose=pose(element),
        torque=Entries({}, element.where) if driven is None else commands(driven),
        trajectory=None if given is None else trajectory(given),
        parameters=settings(element, "parameter"),
        sensor=effects(element.children("sensor"), times),
        inputs=inputs(element.children("input"), times),
        where=element.where,
    )


def follower(
    element: Element,
    times: Times,
    plants: Mapping[str, object],
    controllers: Mapping[str, object],
    sensor: tuple[EffectSource, ...],
    actuator: tuple[EffectSource, ...],
) -> Follower:
    """Read a follower, given the ids of plants and controllers; common effects stand in for missing ones."""
    desired = element.child("desired")
    return Follower(
        id=element.get("id"),
        plant=known(element, "plant", plants),
        controller=known(element, "controller", controllers),
        pose=pose(element),
        desired=desired_place(desired),
        changes=changes(desired, times),
        parameters=settings(element, "parameter"),
        gains=settings(element, "gain"),
        sensor=sensor if element.find("sensor") is None else effects(element.children("sensor"), times),
        actuator=actuator if element.find("actuator") is None else effects(element.children("actuator"), times),
        inputs=inputs(element.children("input"), times),
        where=element.where,
    )
