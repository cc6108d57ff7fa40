"""A run that goes on from a moment with another scenario: what the change comes to, and what cannot change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError, Location
from cosim.fmu.binding import BoundRole
from cosim.fmu.parameters import ParameterValue
from cosim.master.checkpoint import Start
from cosim.master.robot import RobotSetup
from cosim.master.robot_events import check_changeable
from cosim.master.robot_inputs import at_rest
from cosim.master.setup import Setup, set_up
from cosim.master.structure import structure
from cosim.master.teams import teams_of
from cosim.scenario.scenario import LEADER, Scenario
from cosim.storage import Storage, blocks, fill
from cosim.undisturbed import Ending


def check_branch(before: Scenario, scenario: Scenario, tick: int) -> None:
    """Refuse a scenario with which a run cannot go on.

    Parameters
    ----------
    before, scenario
        The scenarios up to a tick, and from there on.
    tick
        The tick.

    Raises
    ------
    InputError
        It has another structure, or ends before the tick, or later than the one before.
    """
    _check_equal(_shared(before), _shared(scenario))
    if scenario.ticks > before.ticks:
        raise InputError(
            f"the end of a run cannot be put off from {before.horizon:.12g} s to {scenario.horizon:.12g} s in its "
            "course, because its FMUs were told the end at the start: run the scenario from its start"
        )
    if tick > scenario.ticks:
        raise InputError(
            f"the run is at {tick * scenario.step:.12g} s, which is after its new end at {scenario.horizon:.12g} s"
        )


def branched(setup: Setup, scenario: Scenario, start: Start) -> Setup:
    """Return the set-up of a scenario with which a run goes on, with the values that change at once.

    Parameters that differ from those up to then, in the scenario and by its events, change at the tick as an event
    changes them. Gains, sensors, actuators, places and torques are those of the scenario from the tick on.

    Parameters
    ----------
    setup, scenario
        The scenario with its set-up.
    start
        From where it goes on.

    Raises
    ------
    InputError
        It has another structure, or a parameter differs that cannot change.
    """
    tick = start.state.tick
    if scenario.text == start.scenario.text or tick == 0:
        return setup
    check_branch(start.scenario, scenario, tick)
    with Ending() as cleanup:
        before = set_up(start.scenario, cleanup, {})
    _check_equal(_companions(start.scenario, before), _companions(scenario, setup))
    robots = [
        _changed(one, earlier, tick)
        for one, earlier in zip((setup.leader, *setup.followers), (before.leader, *before.followers), strict=True)
    ]
    courses = zip(setup.desired, before.desired, strict=True)
    desired = type(setup.desired)(*(_spliced(one, earlier, tick, setup.storage) for one, earlier in courses))
    return replace(setup, leader=robots[0], followers=tuple(robots[1:]), desired=desired)


def _shared(scenario: Scenario) -> dict[str, object]:
    """Return what scenarios must share of which one goes on from another."""
    plants = {name: replace(plant, contained=False) for name, plant in scenario.plants.items()}
    shared = structure(replace(scenario, plants=plants))
    del shared["the horizon"]
    laws = {name: (law.name, law.package) for name, law in scenario.controllers.items()}
    poses = {LEADER: scenario.leader.pose, **{one.id: one.pose for one in scenario.followers}}
    path = scenario.leader.trajectory
    return {
        **shared,
        **{f"the controller of {one.id}": laws.get(one.controller) for one in scenario.followers},
        **{f"the initial pose of {name}": pose.values for name, pose in poses.items()},
        "the leader's <trajectory>": None if path is None else replace(path, where=Location("")),
    }


def _companions(scenario: Scenario, setup: Setup) -> dict[str, object]:
    """Return who is in one team with each follower: the state of a law is that of its whole team."""
    names = [robot.name for robot in setup.followers]
    teams = [[names[row] for row in rows] for _, _, _, rows, *_ in teams_of(scenario, setup)]
    return {f"who shares a controller with {name}": team for team in teams for name in team}


def _check_equal(before: Mapping[str, object], now: Mapping[str, object]) -> None:
    for what in dict.fromkeys((*before, *now)):
        if before.get(what) != now.get(what):
            raise InputError(f"{what} cannot change in the course of a run: run the scenario from its start")


def _spliced(
    course: NDArray[np.float64], before: NDArray[np.float64], tick: int, storage: Storage
) -> NDArray[np.float64]:
    """Return a course (ticks + 1, ...) with the values of another one before a tick."""
    if all(np.array_equal(course[block], before[block]) for block in blocks(tick, course[:1].size)):
        return course
    found = storage.empty(course.shape)
    fill(found[:tick], before[:tick])
    fill(found[tick:], course[tick:])
    return found


def _changed(robot: RobotSetup, before: RobotSetup, tick: int) -> RobotSetup:
    """Return a robot whose changes at a tick lead from the values of another scenario to its own."""
    there, here = _values(before, tick), _values(robot, tick)
    for number, value in there.items():
        if number not in here:
            raise InputError(
                f"{robot.name} has the value of {value.variable.name!r} from earlier in the run: give it another one "
                "rather than none",
                value.where,
            )
    kept = _given(robot)
    for place, (bound, course) in _given(before).items():
        if place not in kept and place[0] not in here and course[tick - 1] != at_rest(bound):
            raise InputError(
                f"{robot.name} has the value of the input {bound.role.name!r} from earlier in the run: give it another "
                "one rather than none",
                before.where,
            )
    found = [value for number, value in here.items() if number not in there or there[number].value != value.value]
    check_changeable(robot.fmu, found)
    own = robot.changes.get(tick, ())
    return replace(robot, changes={**robot.changes, tick: (*found, *own)}) if found else robot


def _values(robot: RobotSetup, tick: int) -> dict[tuple[str, int], ParameterValue]:
    """Return the values that were set of a robot's FMU before a tick, by the variables' identities."""
    values = [*robot.parameters, *robot.held]
    for when in sorted(robot.changes):
        values += robot.changes[when] if when < tick else ()
    return {value.variable.identity: value for value in values}


def _given(robot: RobotSetup) -> dict[tuple[tuple[str, int], int], tuple[BoundRole, NDArray[np.float64]]]:
    """Return the real inputs that get values besides the commands, with the values, by what they are."""
    return {
        (bound.played_by.variable.identity, bound.played_by.element): (bound, course)
        for bound, course in zip(robot.inputs, robot.samples.T, strict=True)
        if bound.played_by is not None
    }
