"""The channels of a run, and the signals that expectations can name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from cosim.control.team import Law
from cosim.errors import InputError
from cosim.master.identity import is_taken
from cosim.results.channel import Channel
from cosim.results.expectations import Recorded, recorded
from cosim.scenario.scenario import Scenario
from cosim.vehicle.columns import RunColumns

RESERVED = ("time", "robot", "range", "bearing", "range_error", "bearing_error")
"""Names in a result that no channel can have: dimensions, and variables that are computed from channels."""


def channels_of(columns: RunColumns, n: int, told: bool, laws: Iterable[Law]) -> tuple[Channel, ...]:
    """Return the channels of a run.

    Parameters
    ----------
    columns
        Where the entries of the robots' kinds of vehicle stand.
    n
        How many followers there are.
    told
        Whether followers get another pose of the leader than the true one.
    laws
        The control laws, whose telemetry is recorded.

    Raises
    ------
    InputError
        A law's signal has the name of another.
    """
    pose, velocity, command, called = columns.pose, columns.velocity, columns.command, columns.commands
    poses, velocities, commands = (len(of.labels) for of in (pose, velocity, command))
    pose_units, velocity_units, command_units = (", ".join(of.units) for of in (pose, velocity, command))
    along = f"{called}_component"
    channels = {
        channel.name: channel
        for channel in (
            Channel("leader_pose", ("pose_component",), (poses,), pose_units, "pose of the virtual leader"),
            Channel(
                "leader_velocity",
                ("velocity_component",),
                (velocities,),
                velocity_units,
                "velocities of the virtual leader",
            ),
            Channel(
                f"leader_{called}", (along,), (commands,), command_units, f"{called} that drives the virtual leader"
            ),
            Channel("pose", ("robot", "pose_component"), (n, poses), pose_units, "pose"),
            Channel("velocity", ("robot", "velocity_component"), (n, velocities), velocity_units, "pseudo-velocities"),
            Channel("measured_pose", ("robot", "pose_component"), (n, poses), pose_units, "pose as measured"),
            Channel(called, ("robot", along), (n, commands), command_units, f"{called} as applied"),
            Channel("desired_range", ("robot",), (n,), "m", "desired range"),
            Channel("desired_bearing", ("robot",), (n,), "rad", "desired bearing"),
        )
    }
    if told:
        name = "measured_leader_pose"
        channels[name] = Channel(
            name, ("pose_component",), (poses,), pose_units, "pose of the virtual leader as followers are told"
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


def recorded_signals(
    scenario: Scenario, channels: Sequence[Channel], columns: RunColumns, laws: Mapping[str, Law]
) -> dict[str, Recorded]:
    """Return the signals that expectations can name, by name: channels and variables computed from them.

    Parameters
    ----------
    scenario
        The scenario.
    channels
        The channels of its run.
    columns
        Where the entries of the robots' kinds of vehicle stand.
    laws
        The control law of each controller that is used, by its id.
    """
    names = dict(columns.labels)
    owners: dict[str, list[str]] = {}
    for follower in scenario.followers:
        for signal in laws[follower.controller].controller_type.signals:
            names |= {f"{signal.name}_component": tuple(signal.components)} if signal.components else {}
            owners.setdefault(signal.name, []).append(follower.id)
    return recorded(channels, names, [follower.id for follower in scenario.followers], owners)
