"""The variables that a result holds, and the signals that expectations can name."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from cosim.control.law import Law
from cosim.errors import InputError
from cosim.master.who_is_who import is_taken
from cosim.results.expectations import Recorded, recorded
from cosim.results.result_variable import ResultVariable
from cosim.vehicle.columns import RunColumns

RESERVED = ("time", "robot", "range", "bearing", "range_error", "bearing_error")
"""Names that no recorded variable can have: the dimensions, and the variables that are computed from recorded ones."""


def result_variables_of(
    columns: RunColumns, followers: Sequence[tuple[str, Law]], leader_measured: bool, laws: Iterable[Law]
) -> tuple[ResultVariable, ...]:
    """Return the variables that a run records.

    Parameters
    ----------
    columns
        The columns of the arrays, by the robots' kinds of vehicle.
    followers
        The followers' ids, each with its control law.
    leader_measured
        Whether the followers receive a measured pose of the leader instead of the true one.
    laws
        The control laws, whose telemetry is recorded.

    Raises
    ------
    InputError
        A law's signal has a name that is taken.
    """
    pose, velocity, command, called = columns.pose, columns.velocity, columns.command, columns.commands
    n = len(followers)
    poses, velocities, commands = (len(of.labels) for of in (pose, velocity, command))
    pose_units, velocity_units, command_units = (", ".join(of.units) for of in (pose, velocity, command))
    along = f"{called}_component"
    variables = {
        variable.name: variable
        for variable in (
            ResultVariable("leader_pose", ("pose_component",), (poses,), pose_units, "pose of the virtual leader"),
            ResultVariable(
                "leader_velocity",
                ("velocity_component",),
                (velocities,),
                velocity_units,
                "velocities of the virtual leader",
            ),
            ResultVariable(
                f"leader_{called}", (along,), (commands,), command_units, f"{called} that drives the virtual leader"
            ),
            ResultVariable("pose", ("robot", "pose_component"), (n, poses), pose_units, "pose"),
            ResultVariable(
                "velocity", ("robot", "velocity_component"), (n, velocities), velocity_units, "pseudo-velocities"
            ),
            ResultVariable("measured_pose", ("robot", "pose_component"), (n, poses), pose_units, "pose as measured"),
            ResultVariable(called, ("robot", along), (n, commands), command_units, f"{called} as applied"),
            ResultVariable("desired_range", ("robot",), (n,), "m", "desired range"),
            ResultVariable("desired_bearing", ("robot",), (n,), "rad", "desired bearing"),
        )
    }
    if leader_measured:
        name = "measured_leader_pose"
        variables[name] = ResultVariable(
            name, ("pose_component",), (poses,), pose_units, "pose of the virtual leader as followers are told"
        )
    taken = {*variables, *RESERVED, *(dim for variable in variables.values() for dim in variable.dims)}
    telemetry: dict[str, tuple[object, ResultVariable]] = {}
    owners: dict[str, list[str]] = {}
    for follower, its in followers:
        for signal in its.signals:
            owners.setdefault(signal.name, []).append(follower)
    for law in laws:
        for signal in law.signals:
            parts = signal.components
            dims = ("robot", f"{signal.name}_component") if parts else ("robot",)
            shape = (n, len(parts)) if parts else (n,)
            if signal.name in taken or is_taken(signal.name) or telemetry.get(signal.name, (signal,))[0] != signal:
                raise InputError(
                    f"controller {law.source.id!r}: its signal {signal.name!r} has the name of another in the result",
                    law.source.where,
                )
            about = (signal.unit, signal.description, signal.singular_at_zero, float(signal.singular_below))
            having = tuple(owners[signal.name])
            telemetry[signal.name] = (signal, ResultVariable(signal.name, dims, shape, *about, having))
    return (*variables.values(), *(variable for _, variable in telemetry.values()))


def recorded_signals(
    variables: Sequence[ResultVariable], columns: RunColumns, followers: Sequence[tuple[str, Law]]
) -> dict[str, Recorded]:
    """Return the signals that expectations can name, by name: recorded variables, and those computed from them.

    Parameters
    ----------
    variables
        The variables that a run records.
    columns
        The columns of the arrays, by the robots' kinds of vehicle.
    followers
        The followers' ids, each with its control law.
    """
    names = dict(columns.labels)
    for _, law in followers:
        for signal in law.signals:
            names |= {f"{signal.name}_component": tuple(signal.components)} if signal.components else {}
    return recorded(variables, names, [follower for follower, _ in followers])
