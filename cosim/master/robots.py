"""From the robots that a scenario names to robots that are ready to be started."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache

import formation_controllers as fc
from formation_controllers.vehicles import Vehicle

from cosim.clock import tick_at
from cosim.errors import InputError, Location
from cosim.fmu.parameters import geometry
from cosim.fmu.vehicle import Fmu
from cosim.known import Known
from cosim.master.robot import RobotSetup
from cosim.master.robot_events import changes_of, stops
from cosim.master.robot_inputs import robot_inputs
from cosim.master.used_fmus import understood
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import (
    LEADER,
    EffectSource,
    Entries,
    Follower,
    InputSource,
    Leader,
    Scenario,
)
from cosim.signals import effects
from cosim.storage import Storage
from cosim.vehicle.kind import Kind, Role, names, units_of
from cosim.vehicle.kinds import vehicle_fault
from cosim.vehicle.outline import Outline, outline_fault


def leader_of(
    scenario: Scenario,
    fmus: Mapping[str, Fmu],
    storage: Storage,
    before: RobotSetup | None = None,
    known: Known | None = None,
) -> RobotSetup:
    """Return the leader.

    Parameters
    ----------
    scenario
        The scenario.
    fmus
        The FMU of each plant.
    storage
        Where its inputs over time lie.
    before
        The leader of another run with the same FMUs, which is taken if it comes to the same.
    known
        What is known of parameters and effects.

    Raises
    ------
    InputError
        Something in the scenario does not fit the leader's FMU, with the place in the scenario.
    """
    leader = scenario.leader
    origin = _origin(scenario, LEADER, leader, leader.inputs)
    if before is not None and before.origin == origin:
        return before
    kind = fmus[leader.plant].binding.kind
    torques = {0: (0.0,) * len(kind.command)}
    if leader.trajectory is None:
        torques[0] = _entries(leader.torque, kind, kind.command, missing=0.0)
    events = scenario.events_by_robot.get(LEADER, ())
    stopped = min((event.time for event in events if event.stops), default=math.inf)
    for event in events:
        if leader.trajectory is not None:
            raise InputError(
                "a leader with a <trajectory> takes no event: its motion follows from the path", event.where
            )
        if event.torque is not None:
            if stopped <= event.time:
                raise InputError(
                    "this torque comes after the <stop> of the leader, which is for good: to let the leader go on "
                    "later, give it torques of zero instead of a <stop>",
                    event.where,
                )
            start = tick_at(event.time, scenario.step)
            torques[start] = _entries(event.torque, kind, kind.command, missing=0.0)
    pose = None if leader.trajectory is not None else leader.pose
    known = known or Known()
    return _robot(
        scenario, fmus[leader.plant], LEADER, leader, origin, pose, (), torques, leader.inputs, storage, known
    )


def followers_of(
    scenario: Scenario,
    fmus: Mapping[str, Fmu],
    storage: Storage,
    before: Iterable[RobotSetup] = (),
    known: Known | None = None,
) -> tuple[RobotSetup, ...]:
    """Return the followers in the scenario's order; see `leader_of`."""
    earlier, known = {robot.name: robot for robot in before}, known or Known()
    robots = []
    for follower in scenario.followers:
        inputs = (*scenario.inputs, *follower.inputs)
        origin = _origin(scenario, follower.id, follower, inputs)
        robot, fmu = earlier.get(follower.id), fmus[follower.plant]
        if robot is None or robot.origin != origin:
            torques = {0: (0.0,) * len(fmu.binding.kind.command)}
            pose, actuator = follower.pose, follower.actuator
            robot = _robot(
                scenario, fmu, follower.id, follower, origin, pose, actuator, torques, inputs, storage, known
            )
        robots.append(robot)
    return tuple(robots)


def _origin(scenario: Scenario, name: str, about: Leader | Follower, inputs: Sequence[InputSource]) -> object:
    """Return everything in a scenario from which the set-up of a robot follows, to be compared."""
    seed = scenario.seed if inputs else None  # their noise
    return (
        about,
        scenario.plants[about.plant],
        tuple(inputs),
        scenario.events_by_robot.get(name, ()),
        scenario.clock,
        seed,
    )


def _robot(
    scenario: Scenario,
    fmu: Fmu,
    name: str,
    about: Leader | Follower,
    origin: object,
    pose: Entries | None,
    actuator: tuple[EffectSource, ...],
    torques: Mapping[int, tuple[float, ...]],
    inputs: Sequence[InputSource],
    storage: Storage,
    known: Known,
) -> RobotSetup:
    kind, where, source = fmu.binding.kind, about.where, scenario.plants[about.plant]
    own = understood(fmu, source, about.parameters, known)
    replaced = {value.variable.identity for value in own}
    named = {setting.name for setting in about.parameters}
    common = understood(fmu, source, [one for one in source.parameters if one.name not in named], known)
    parameters = (*(value for value in common if value.variable.identity not in replaced), *own)
    try:
        vehicle = kind.vehicle(**geometry(fmu, parameters, where))
    except fc.ControllerError as error:
        raise InputError(f"{name}: {error}", where) from None
    except Exception as error:  # whatever someone's function does
        problem = f"cannot make its vehicle: {type(error).__name__}: {error}"
        raise InputError(f"{name}: the kind of vehicle {kind.name!r} {problem}", where) from None
    if fault := vehicle_fault(kind, vehicle):
        raise InputError(f"{name}: the kind of vehicle {kind.name!r} {fault}", where)
    times = Times(scenario.step, scenario.ticks)
    poses, commands = f"the pose of {name}, a {kind.name},", f"the actuators of {name}, a {kind.name},"
    sensing = known.of((name, "sensor"), effects.understood, about.sensor, units_of(kind.pose), times, poses)
    acting = known.of((name, "actuator"), effects.understood, actuator, units_of(kind.command), times, commands)
    stopping = (event.time for event in scenario.events_by_robot.get(name, ()) if event.stops)
    stop = min(stopping, default=math.inf)
    given = robot_inputs(scenario, fmu, name, inputs, storage, torques, tick_at(stop, scenario.step))
    changes = changes_of(scenario, fmu, source, name, given)
    given.check_free(parameters)
    return RobotSetup(
        name=name,
        where=source.where,
        fmu=fmu,
        source=source,
        parameters=parameters,
        vehicle=vehicle,
        outline=outline_of(kind, vehicle, name, where),
        pose=(0.0,) * len(kind.pose) if pose is None else _entries(pose, kind, kind.pose),
        sensor=sensing,
        actuator=(*acting, *stops(scenario, name)),
        torque=given.torque,
        inputs=given.inputs,
        samples=given.samples,
        held=given.discrete.get(0, ()),
        changes=changes,
        origin=origin,
    )


def _entries(entries: Entries, kind: Kind, roles: Sequence[Role], missing: float | None = None) -> tuple[float, ...]:
    """Return entries in a kind's order; one that is left out is an error unless `missing` stands for it."""
    names = [role.name for role in roles]
    for name in entries.values:
        if name not in names:
            raise InputError(f"a {kind.name} vehicle has no {name!r}; it has {', '.join(names)}", entries.where)
    if missing is None and (lacking := [name for name in names if name not in entries.values]):
        raise InputError(f"the <pose> of a {kind.name} vehicle lacks {', '.join(lacking)}", entries.where)
    return tuple(entries.values.get(name, missing or 0.0) for name in names)


def outline_of(kind: Kind, vehicle: Vehicle, name: str, where: Location) -> Outline | None:
    """Return the outline of a robot; None if its kind states none.

    Raises
    ------
    InputError
        The kind states one that makes no sense.
    """
    outline, fault = _outline(kind, vehicle)
    if fault:
        raise InputError(f"{name}: the outline of the kind of vehicle {kind.name!r} {fault}", where)
    return outline


@lru_cache(64)
def _outline(kind: Kind, vehicle: Vehicle) -> tuple[Outline | None, str]:
    """Return the outline of a kind of vehicle with some geometry, and its fault."""
    if kind.outline is None:
        return None, ""
    try:
        outline = kind.outline(vehicle)
        return outline, outline_fault(outline, names(kind.pose))
    except Exception as error:  # whatever someone's function does
        return None, f"cannot be computed: {type(error).__name__}: {error}"
