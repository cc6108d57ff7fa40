"""From the records of a run to the signals that somebody wants, and those that are computed from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from formation_controllers.geometry import formation_courses
from formation_controllers.vehicles import Vehicle, formation_of
from numpy.typing import NDArray

from cosim.control.team import Team
from cosim.master.recorder import Recorder
from cosim.master.setup import Setup
from cosim.master.who_is_who import texts
from cosim.results.expectations.recorded import DERIVED, units_by_component
from cosim.results.result import Result, Variable
from cosim.scenario.scenario import Scenario
from cosim.storage import blocks, is_constant

Floats = NDArray[np.float64]


def recorded_signals(
    scenario: Scenario, setup: Setup, recorder: Recorder, teams: Sequence[Team], before: Floats | None = None
) -> Result:
    """Return the signals of a run that are wanted, with times, followers and components, but without provenance.

    The dimensions are ``time`` [s], ``robot`` (the followers' ids) and one labelled dimension for the components of
    each vector. Range and bearing, (7), are those of the true poses; the bearing is unwrapped over time, from those of
    the followers `before` if they are given.
    """
    samples = recorder.recorded
    computed = [name for name in DERIVED if recorder.wants(name)]
    arrays = _in_columns(recorder.arrays(setup.storage), setup)
    times, every, first = setup.storage.empty((samples,)), recorder.ticks.step, recorder.ticks.start
    for block in blocks(samples):
        ticks = slice(first + every * block.start, first + every * block.stop, every)
        times[block] = scenario.clock.times_in(ticks)
    coordinates = {
        "time": Variable(("time",), times, {"units": "s", "long_name": "time"}),
        "robot": texts("robot", [follower.id for follower in scenario.followers], "follower"),
        **{along: texts(along, labels) for along, labels in setup.columns.labels.items()},
    }
    for team in teams:
        for signal in team.law.signals:
            if signal.components and recorder.wants(signal.name):
                dim = f"{signal.name}_component"
                coordinates[dim] = texts(dim, signal.components)
                parts = list(units_by_component(signal.components, signal.unit).values())
                coordinates[f"{dim}_units"] = texts(dim, parts, f"unit of each component of {signal.name}")
    variables = {
        name: Variable(("time", *variable.dims), arrays[name], variable.attributes)
        for name, variable in recorder.variables.items()
        if recorder.wants(name)
    }
    courses = _courses(arrays, recorder, setup, teams, before) if computed else {}
    for name in computed:
        units, long_name = DERIVED[name]
        variables[name] = Variable(("time", "robot"), courses[name], {"units": units, "long_name": long_name})
    return Result(variables, coordinates, {})


def _courses(
    arrays: Mapping[str, Floats], recorder: Recorder, setup: Setup, teams: Sequence[Team], first: Floats | None
) -> dict[str, Floats]:
    """Return the variables that are computed from recorded ones."""
    desired = setup.desired.q[recorder.ticks]
    found = recorder.room_for((len(DERIVED), desired.shape[1]))
    for block in blocks(len(desired), desired.shape[1]):
        before = found[1, :, block.start - 1] if block.start else first
        for team in teams:
            if formation_of(team.vehicle) is None:
                found[:, team.place, block] = np.nan
            else:
                own, pose = setup.columns.pose.of[team.view.kind.name], arrays["pose"][block, team.place]
                if own != tuple(range(pose.shape[-1])):
                    pose = pose[..., own]
                wanted = desired[block, team.place]
                room = found[:, team.place, block]  # itself, if it is one piece
                in_place = isinstance(team.place, slice) and room.flags.c_contiguous
                courses = formation_courses(
                    pose,
                    arrays["leader_pose"][block],
                    wanted if is_constant(wanted) else np.ascontiguousarray(wanted),
                    team.vehicle,
                    None if before is None else before[team.place],
                    room if in_place else None,
                )
                if not in_place:
                    found[:, team.place, block] = courses
    return dict(zip(("range", "bearing", "range_error", "bearing_error"), found.transpose(0, 2, 1), strict=True))


def courses_of_follower(
    pose: Floats, leader_pose: Floats, desired: Floats, vehicle: Vehicle, before: Floats | None = None
) -> Floats | None:
    """Return range, bearing and their errors of one follower (4, T), as those of a run are computed.

    Parameters
    ----------
    pose, leader_pose
        Poses (T, entries), without NaN.
    desired
        Desired range and bearing (T, 2).
    vehicle
        The follower's vehicle; if it states no formation, there are none.
    before
        The bearing (1,) at the sample before, for a later part of a course.
    """
    if formation_of(vehicle) is None:
        return None
    own, wanted = np.ascontiguousarray(pose[:, np.newaxis]), np.ascontiguousarray(desired[:, np.newaxis])
    found: Floats = formation_courses(own, leader_pose, wanted, vehicle, before)[:, 0]
    return found


def _in_columns(arrays: dict[str, Floats], setup: Setup) -> dict[str, Floats]:
    """Return what was recorded with the entries of every robot in the columns of the result."""
    columns, kinds = setup.columns, [robot.kind for robot in setup.followers]
    called = columns.commands
    for of, names in (
        (columns.pose, ("pose", "measured_pose", "leader_pose", "measured_leader_pose")),
        (columns.velocity, ("velocity", "leader_velocity")),
        (columns.command, (called, f"leader_{called}")),
    ):
        for name in names:
            if name not in arrays:
                continue
            if "leader" in name:
                arrays[name] = of.spread(arrays[name][:, np.newaxis], [setup.leader.kind], setup.storage)[:, 0]
            else:
                arrays[name] = of.spread(arrays[name], kinds, setup.storage)
    return arrays
