"""From the numbers of all robots to what the compiled loop needs: who takes which number from where."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from formation_controllers import Desired
from numpy.typing import NDArray

from cosim.compiled import address_of
from cosim.control.compiled_teams import compiled_ticks, taken
from cosim.control.team import Team
from cosim.master.loop import Commanding, Driving, LawCall, Path, Taking
from cosim.master.robot import RobotSetup
from cosim.master.team_arrays import TeamArrays
from cosim.vehicle.path import Motion

Floats = NDArray[np.float64]


def laws_of(
    teams: Sequence[Team], now: TeamArrays, desired: Desired, motion: Motion | None, records: Sequence[Floats]
) -> tuple[tuple[LawCall, ...], Taking, Commanding] | None:
    """Return the laws as compiled code calls them, what they take and where their commands go.

    None if one of them must be called from Python.

    Parameters
    ----------
    teams
        All teams.
    now
        The numbers of a tick.
    desired
        Places of all followers, each (ticks, followers, 2).
    motion
        The leader's, if it is given.
    records
        The place of each team's telemetry.
    """
    ticks = compiled_ticks(teams)
    if ticks is None:
        return None
    n, samples = len(now.command), len(desired.q)
    index, measured, command = (
        np.arange(array.size).reshape(array.shape) for array in (now.state, now.measured, now.command)
    )
    acceleration = np.zeros((0, 0)) if motion is None else np.ascontiguousarray(motion.acceleration)
    all_taken = taken(
        teams,
        state=index[:, now.pose.shape[1] :],
        measured=measured,
        desired=np.arange(2 * n).reshape(n, 2),
        acceleration=np.arange(acceleration.shape[1]),
    )
    q, q_dot, q_ddot = (np.ascontiguousarray(part).reshape(samples, -1) for part in desired)
    to, of = all_taken.to, all_taken.of
    taking = Taking(
        taken=all_taken.numbers,
        measured=now.measured.reshape(-1),
        to_measured=to["measured"],
        from_measured=of["measured"],
        state=now.state.reshape(-1),
        to_state=to["state"],
        from_state=of["state"],
        q=q,
        q_dot=q_dot,
        q_ddot=q_ddot,
        to_q=to["q"],
        to_q_dot=to["q_dot"],
        to_q_ddot=to["q_ddot"],
        from_q=of["q"],
        acceleration=acceleration,
        to_acceleration=to["acceleration"],
        from_acceleration=of["acceleration"],
    )
    places = [command[team.commands] for team in teams]
    firsts = np.cumsum([0, *(place.size for place in places)])
    given = np.zeros(firsts[-1])
    laws = []
    for team, tick, inputs, place, first, store in zip(
        teams, ticks, all_taken.inputs, places, firsts[:-1].tolist(), records, strict=True
    ):
        arguments = (inputs, tick.own, given[first : first + place.size].reshape(place.shape))
        signals = team.controller.telemetry_record.view(np.float64).reshape(-1)
        laws.append(LawCall(address_of(tick.function, *arguments), arguments, signals, store))
    own_places = np.concatenate([place.reshape(-1) for place in places])
    return tuple(laws), taking, Commanding(given, now.command.reshape(-1), own_places)


def driving_of(now: TeamArrays, first: int, robots: Sequence[RobotSetup]) -> Driving:
    """Return what the plants are given: of one plant after the other, its commands and its other inputs.

    Parameters
    ----------
    now
        The numbers of a tick.
    first
        The first row that is a plant.
    robots
        Those that are plants.
    """
    width, places, samples = now.torque.shape[1], [], 0
    for row, robot in enumerate(robots, start=first):
        others = robot.samples.shape[1]
        places += [row * width + entry for entry in range(len(robot.kind.command))]
        places += [-1 - sample for sample in range(samples, samples + others)]
        samples += others
    return Driving(
        given=np.zeros(len(places)),
        torque=now.torque.reshape(-1),
        samples=np.concatenate([robot.samples for robot in robots], axis=1),
        places=np.array(places, dtype=np.int64),
    )


def path_of(now: TeamArrays, leader: RobotSetup, motion: Motion | None) -> Path:
    """Return where a leader is whose motion is given; nothing for a leader that is driven."""
    if motion is None:
        return Path(np.zeros((0, 0)), np.zeros(0, dtype=np.int64))
    return Path(np.ascontiguousarray(motion.state), np.array(now.columns_of(leader.kind), dtype=np.int64))
