"""A scenario with everything that it names: found, checked and fitting together, and nothing started yet."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import formation_controllers as fc
import numpy as np
from numpy.typing import NDArray

import plants
from cosim.control.team import Law, find_law, gains_of
from cosim.errors import InputError, Location, UnboundVelocities
from cosim.fmu.binding import number_name
from cosim.fmu.package import Fmu, open_fmu
from cosim.fmu.parameters import ParameterValue, geometry, understand
from cosim.fmu.solver import check_solver, check_step
from cosim.master.common_effects import check_common_effects
from cosim.master.identity import is_taken
from cosim.master.robot import RobotSetup
from cosim.master.robot_inputs import RobotInputs, robot_inputs
from cosim.master.timing import timed
from cosim.results.channel import Channel
from cosim.results.expectations import Recorded, Recording, check, recorded
from cosim.scenario.reader import read_scenario
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import LEADER, EffectSource, Entries, Event, InputSource, PlantSource, Scenario, Setting
from cosim.signals.effects import Effect, tick_at, understood
from cosim.signals.places import desired_samples
from cosim.signals.trajectory import leader_motion
from cosim.vehicle.columns import columns
from cosim.vehicle.kind import Kind, Role, units_of
from cosim.vehicle.path import Motion

MAX_BYTES = 4 * 1024**3
"""Upper limit for the records of a run, and for the signals that drive it."""

RESERVED = ("time", "robot", "range", "bearing", "range_error", "bearing_error")
"""Names in a result that no channel can have: dimensions, and variables that are computed from channels."""


@dataclass(frozen=True)
class Setup:
    """Everything that a scenario is run with.

    Attributes
    ----------
    leader, followers
        The robots.
    motion : Motion or None
        How the leader moves, if that is given.
    desired : formation_controllers.Desired
        Place of every follower at every tick and two derivatives, each (ticks + 1, N, 2).
    fmus : dict
        The FMU of each plant that is used, by its id.
    laws : dict
        The control law of each controller that is used, by its id.
    gains : tuple
        Those of each follower.
    channels : tuple of Channel
        The channels to record.
    signals : dict
        The signals that expectations can name: channels and variables computed from them.
    others : dict
        Scenarios that this one is compared with, each with its own set-up, by file.
    """

    leader: RobotSetup
    followers: tuple[RobotSetup, ...]
    motion: Motion | None
    desired: fc.Desired
    fmus: Mapping[str, Fmu]
    laws: Mapping[str, Law]
    gains: tuple[Any, ...]
    channels: tuple[Channel, ...]
    signals: Mapping[str, Recorded]
    others: Mapping[Path, tuple[Scenario, Setup]]

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """The kinds of vehicle that there are."""
        return tuple({robot.kind.name: robot.kind for robot in (self.leader, *self.followers)}.values())


def set_up(scenario: Scenario, cleanup: ExitStack, timing: dict[str, float]) -> Setup:
    """Find and check everything that a scenario names. Built-in plants are built if they are not in the cache.

    Parameters
    ----------
    scenario
        The scenario.
    cleanup
        Receives the clean-up callbacks.
    timing
        Gets the seconds that were spent, by part.

    Raises
    ------
    InputError
        Something does not exist or does not fit, with the place in the scenario.
    """
    fmus = {}
    for source in scenario.plants.values():  # also one that no robot is, so that the whole file is checked
        with timed(timing, "build"):
            path = _fmu_path(source)
        with timed(timing, "load"):
            fmu = fmus[source.id] = open_fmu(path, source.where, source.binding, source.interface)
        cleanup.callback(fmu.close)
        _understood(fmu, source, source.parameters)
        check_solver(fmu, source)
        check_step(fmu, source, scenario.step)
    _check_size(scenario, 60 * (1 + len(scenario.followers)))  # before any array of that size is made
    with timed(timing, "signals"):
        leader = _leader(scenario, fmus)
        motion = None
        if scenario.leader.trajectory is not None:
            motion = leader_motion(scenario.leader.trajectory, leader.vehicle, _times(scenario))
        followers = _followers(scenario, fmus)
        check_common_effects(scenario, followers)
        desired = [desired_samples(follower, _times(scenario)) for follower in scenario.followers]
    with timed(timing, "controllers"):
        found = {name: find_law(source) for name, source in scenario.controllers.items()}
        controlling = {follower.controller for follower in scenario.followers}
        laws = {name: law for name, law in found.items() if name in controlling}
        gains = tuple(gains_of(laws[follower.controller], follower.gains) for follower in scenario.followers)
    _check_velocities(scenario, leader, followers, laws)
    channels = _channels(leader.kind, len(followers), bool(scenario.leader.sensor), laws.values())
    _check_size(scenario, sum(channel.bytes_per_sample for channel in channels))
    signals = _recorded(scenario, channels, (leader.kind, *(robot.kind for robot in followers)), laws)
    others: dict[Path, tuple[Scenario, Setup]] = {}

    def prepare(path: Path) -> Recording:
        """Read and set up a scenario to compare with, once; its own expectations are not read."""
        if path not in others:
            other = replace(read_scenario(path, untrusted=scenario.untrusted), expectations=())
            others[path] = other, set_up(other, cleanup, {})
        other, setup = others[path]
        return Recording(other, setup.signals)

    check(scenario, signals, prepare)
    return Setup(
        leader=leader,
        followers=followers,
        motion=motion,
        desired=fc.Desired(*(np.stack(parts, axis=1) for parts in zip(*desired, strict=True))),
        fmus={name: fmu for name, fmu in fmus.items() if name in _plants_of(scenario)},
        laws=laws,
        gains=gains,
        channels=channels,
        signals=signals,
        others=others,
    )


def _times(scenario: Scenario) -> NDArray[np.float64]:
    times: NDArray[np.float64] = scenario.step * np.arange(scenario.ticks + 1, dtype=np.float64)
    return times


def _check_size(scenario: Scenario, bytes_per_tick: int) -> None:
    size = (scenario.ticks + 1) * bytes_per_tick
    if size > MAX_BYTES:
        raise InputError(
            f"the scenario {scenario.name!r} would record {size / 1024**3:.1f} GiB, more than "
            f"{MAX_BYTES // 1024**3} GiB: shorten its horizon or lengthen its step"
        )


# Plants -----------------------------------------------------------------------------------------------------


def _fmu_path(source: PlantSource) -> Path:
    if source.fmu is not None:
        if source.fmu.name in plants.models() and not source.fmu.exists():
            raise InputError(f'a built-in model is no file: write model="{source.fmu.name}" for fmu=...', source.where)
        return source.fmu
    assert source.model is not None
    try:
        return plants.build(source.model)
    except plants.UnknownModel as error:
        hint = f'; a file is named by fmu="{source.model}"' if source.model.endswith(".fmu") else ""
        raise InputError(f"{error}{hint}", source.where) from None
    except plants.PlantError as error:
        raise InputError(str(error), source.where) from None


def _understood(fmu: Fmu, source: PlantSource, settings: Sequence[Setting]) -> tuple[ParameterValue, ...]:
    """Return the values of parameters; of an FMU that took the place of another, the message names the way out."""
    way_out = '"formation swap" writes a variant of a scenario without what an FMU lacks' if source.fmu else ""
    return understand(fmu, settings, way_out)


def _plants_of(scenario: Scenario) -> list[str]:
    return [scenario.leader.plant, *(follower.plant for follower in scenario.followers)]


# Robots -----------------------------------------------------------------------------------------------------


def _leader(scenario: Scenario, fmus: Mapping[str, Fmu]) -> RobotSetup:
    leader = scenario.leader
    kind = fmus[leader.plant].binding.kind
    torque = np.zeros((scenario.ticks + 1, len(kind.command)))
    if leader.trajectory is None:
        torque[:] = _entries(leader.torque, kind, kind.command, missing=0.0)
    for event in _events_of(scenario, LEADER):
        if leader.trajectory is not None:
            raise InputError(
                "a leader with a <trajectory> takes no event: its motion follows from the path", event.where
            )
        if event.torque is not None:
            if any(other.stops and other.time <= event.time for other in _events_of(scenario, LEADER)):
                raise InputError(
                    "the leader has stopped for good when this torque is to drive it: if it is to go on later, give it "
                    "torques of zero instead of a <stop>",
                    event.where,
                )
            start = tick_at(event.time, scenario.step)
            torque[start:] = _entries(event.torque, kind, kind.command, missing=0.0)
    return _robot(
        scenario,
        fmus[leader.plant],
        LEADER,
        leader.plant,
        leader.where,
        pose=None if leader.trajectory is not None else leader.pose,
        own=leader.parameters,
        sensor=leader.sensor,
        actuator=(),
        torque=torque,
        inputs=leader.inputs,
    )


def _followers(scenario: Scenario, fmus: Mapping[str, Fmu]) -> tuple[RobotSetup, ...]:
    return tuple(
        _robot(
            scenario,
            fmus[follower.plant],
            follower.id,
            follower.plant,
            follower.where,
            pose=follower.pose,
            own=follower.parameters,
            sensor=follower.sensor,
            actuator=follower.actuator,
            torque=np.zeros((scenario.ticks + 1, len(fmus[follower.plant].binding.kind.command))),
            inputs=(*scenario.inputs, *follower.inputs),
        )
        for follower in scenario.followers
    )


def _robot(
    scenario: Scenario,
    fmu: Fmu,
    name: str,
    plant: str,
    where: Location,
    *,
    pose: Entries | None,
    own: Sequence[Setting],
    sensor: tuple[EffectSource, ...],
    actuator: tuple[EffectSource, ...],
    torque: NDArray[np.float64],
    inputs: Sequence[InputSource],
) -> RobotSetup:
    kind = fmu.binding.kind
    named = {setting.name for setting in own}
    common = [setting for setting in scenario.plants[plant].parameters if setting.name not in named]
    source = scenario.plants[plant]
    parameters = _understood(fmu, source, [*common, *own])
    _check_free(fmu, parameters)
    try:
        vehicle = kind.vehicle(**geometry(fmu, parameters, where))
    except fc.ControllerError as error:
        raise InputError(f"{name}: {error}", where) from None
    times = Times(scenario.step, scenario.ticks)
    sensing = understood(sensor, units_of(kind.pose), times, f"the pose of {name}, a {kind.name},")
    acting = understood(actuator, units_of(kind.command), times, f"the actuators of {name}, a {kind.name},")
    given = robot_inputs(scenario, fmu, name, inputs, _times(scenario))
    changes = _changes(scenario, fmu, source, name, given)
    given.check_free(parameters)
    for column, samples in given.torque.items():
        torque[:, column] += samples
    for event in _events_of(scenario, name):
        if event.stops:
            torque[tick_at(event.time, scenario.step) :] = 0.0
    return RobotSetup(
        name=name,
        where=source.where,
        fmu=fmu,
        source=source,
        parameters=parameters,
        vehicle=vehicle,
        pose=(0.0,) * len(kind.pose) if pose is None else _entries(pose, kind, kind.pose),
        sensor=sensing,
        actuator=(*acting, *_stops(scenario, name)),
        torque=torque,
        inputs=tuple(bound for bound, _ in given.samples.values()),
        samples=np.column_stack(
            [np.zeros((scenario.ticks + 1, 0)), *(samples for _, samples in given.samples.values())]
        ),
        held=given.discrete.get(0, ()),
        changes=changes,
    )


def _entries(entries: Entries, kind: Kind, roles: Sequence[Role], missing: float | None = None) -> tuple[float, ...]:
    """Return entries in a kind's order; one that is left out is an error unless `missing` stands for it."""
    names = [role.name for role in roles]
    for name in entries.values:
        if name not in names:
            raise InputError(f"a {kind.name} vehicle has no {name!r}, but: {', '.join(names)}", entries.where)
    if missing is None and (lacking := [name for name in names if name not in entries.values]):
        raise InputError(f"the <pose> of a {kind.name} vehicle lacks {', '.join(lacking)}", entries.where)
    return tuple(entries.values.get(name, missing or 0.0) for name in names)


def _check_free(fmu: Fmu, parameters: Iterable[ParameterValue]) -> None:
    """Refuse a value for a parameter that gives the initial value of a pose entry."""
    for bound in fmu.binding.of(fmu.binding.kind.pose):
        for parameter in parameters:
            if bound is not None and bound.initial is not None and parameter.variable is bound.initial.variable:
                raise InputError(
                    f"the parameter {parameter.variable.name!r} of {fmu.path.name} follows from the <pose>: by the "
                    f"binding it gives the initial {bound.role.name!r}",
                    parameter.where,
                )


def _check_velocities(
    scenario: Scenario, leader: RobotSetup, followers: Sequence[RobotSetup], laws: Mapping[str, Law]
) -> None:
    """Refuse a robot whose velocities are needed and that does not offer them."""
    if scenario.leader.trajectory is None:
        _check_velocities_of(leader, "its followers need the leader's velocities")
    for follower, robot in zip(scenario.followers, followers, strict=True):
        law = laws[follower.controller]
        if "velocity" in law.controller_type.needs:
            _check_velocities_of(robot, f"the controller {law.source.name!r} needs the velocities of its robots")


def _check_velocities_of(robot: RobotSetup, why: str) -> None:
    bound = robot.fmu.binding.bound
    missing = [role.name for role in robot.kind.velocity if role.name not in bound]
    if missing:
        raise UnboundVelocities(
            f"the FMU {robot.fmu.path} offers no {' and no '.join(missing)}, but {why}: "
            f"give {robot.name} another plant",
            robot.where,
            fmu=str(robot.fmu.path),
            vehicle=robot.kind.name,
            roles=tuple(missing),
            played=tuple(number_name(b.played_by) for b in bound.values() if b.played_by is not None),
        )


# Events -----------------------------------------------------------------------------------------------------


def _events_of(scenario: Scenario, robot: str) -> Iterable[Event]:
    return (event for event in scenario.events if event.robot == robot)


def _stops(scenario: Scenario, robot: str) -> Iterable[Effect]:
    """Return the ends of a robot's actuators, as losses of all effectiveness."""
    return (
        Effect("effectiveness", 0.0, (), event.time, float("inf"), event.where)
        for event in _events_of(scenario, robot)
        if event.stops
    )


def _changes(
    scenario: Scenario,
    fmu: Fmu,
    source: PlantSource,
    robot: str,
    inputs: RobotInputs,
) -> dict[int, tuple[ParameterValue, ...]]:
    """Return the values that a robot's FMU is given in the course of the run, by tick: inputs, then parameters."""
    changes = {tick: values for tick, values in inputs.discrete.items() if tick > 0}
    for event in _events_of(scenario, robot):
        values = _understood(fmu, source, event.parameters)
        for value in values:
            if value.variable.variability != "tunable" and not value.is_input:
                raise InputError(
                    f"the parameter {value.variable.name!r} of {fmu.path.name} is {value.variable.variability}: only a "
                    "tunable one can change in the course of a run",
                    value.where,
                )
        inputs.check_free(values)
        tick = tick_at(event.time, scenario.step)
        changes[tick] = (*changes.get(tick, ()), *values)
    return changes


# Recording --------------------------------------------------------------------------------------------------


def _channels(kind: Kind, n: int, told: bool, laws: Iterable[Law]) -> tuple[Channel, ...]:
    pose, velocity, torque = (
        ", ".join(role.unit for role in roles) for roles in (kind.pose, kind.velocity, kind.command)
    )
    channels = {
        channel.name: channel
        for channel in (
            Channel("leader_pose", ("pose_component",), (4,), pose, "pose of the virtual leader"),
            Channel("leader_velocity", ("velocity_component",), (2,), velocity, "velocities of the virtual leader"),
            Channel("leader_torque", ("torque_component",), (2,), torque, "torque that drives the virtual leader"),
            Channel("pose", ("robot", "pose_component"), (n, 4), pose, "pose"),
            Channel("velocity", ("robot", "velocity_component"), (n, 2), velocity, "pseudo-velocities"),
            Channel("measured_pose", ("robot", "pose_component"), (n, 4), pose, "pose as measured"),
            Channel("torque", ("robot", "torque_component"), (n, 2), torque, "torque as applied"),
            Channel("desired_range", ("robot",), (n,), "m", "desired range"),
            Channel("desired_bearing", ("robot",), (n,), "rad", "desired bearing"),
        )
    }
    if told:
        name = "measured_leader_pose"
        channels[name] = Channel(
            name, ("pose_component",), (4,), pose, "pose of the virtual leader as followers are told"
        )
    taken = {*channels, *RESERVED, *(dim for channel in channels.values() for dim in channel.dims)}
    telemetry: dict[str, tuple[Any, Channel]] = {}
    for law in laws:
        for signal in law.controller_type.signals:
            parts = signal.components
            dims = ("robot", f"{signal.name}_component") if parts else ("robot",)
            shape = (n, len(parts)) if parts else (n,)
            if signal.name in taken or is_taken(signal.name) or telemetry.get(signal.name, (signal,))[0] != signal:
                raise InputError(
                    f"controller {law.source.id!r}: its signal {signal.name!r} has the name of another in the result",
                    law.source.where,
                )
            about = (signal.unit, signal.description, signal.singular_at_zero, float(signal.singular_below))
            telemetry[signal.name] = (signal, Channel(signal.name, dims, shape, *about))
    return (*channels.values(), *(channel for _, channel in telemetry.values()))


def _recorded(
    scenario: Scenario, channels: Sequence[Channel], kinds: Sequence[Kind], laws: Mapping[str, Law]
) -> dict[str, Recorded]:
    names = {
        "pose_component": columns(kinds, "pose").labels,
        "velocity_component": columns(kinds, "velocity").labels,
        "torque_component": columns(kinds, "command").labels,
    }
    owners: dict[str, list[str]] = {}
    for follower in scenario.followers:
        for signal in laws[follower.controller].controller_type.signals:
            names |= {f"{signal.name}_component": tuple(signal.components)} if signal.components else {}
            owners.setdefault(signal.name, []).append(follower.id)
    return recorded(channels, names, [follower.id for follower in scenario.followers], owners)
