"""From the numbers of all robots to what the compiled loop needs: who takes which number from where."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from formation_controllers import Desired
from numpy.typing import NDArray

from cosim.control.compiled_teams import are_compiled, called, taken
from cosim.control.team import Team
from cosim.master.loop import Stage, Wiring
from cosim.master.moves import Spots, spots, spots_by_tick
from cosim.master.robot import RobotSetup
from cosim.master.team_arrays import TeamArrays
from cosim.vehicle.path import Motion

Floats = NDArray[np.float64]


def wire_laws(
    wiring: Wiring,
    teams: Sequence[Team],
    now: TeamArrays,
    desired: Desired,
    motion: Motion | None,
    records: Sequence[tuple[Floats, NDArray[np.int_]]],
) -> bool:
    """Let compiled code call the laws; return whether that is possible, and not one of them is called from Python.

    Parameters
    ----------
    wiring
        Gets the laws, what they take and where their commands and signals go.
    teams
        All teams.
    now
        The numbers of a tick.
    desired
        Places of all followers, each (ticks, followers, 2).
    motion
        The leader's, if it is given.
    records
        The place of each team's telemetry, and which of its numbers are recorded.
    """
    if not are_compiled(teams):
        return False
    command, acceleration = spots(now.command), np.zeros((0, 0)) if motion is None else motion.acceleration
    all_taken = taken(
        teams,
        state=spots(now.velocity).first,
        measured=spots(now.measured).first,
        desired=np.arange(now.command.shape[0] * 2).reshape(-1, 2),
        acceleration=spots_by_tick(acceleration).first,
    )
    laws = called(teams, all_taken.inputs)
    if laws is None:
        return False
    wiring.laws, wiring.elsewhere = laws.calls, laws.elsewhere
    numbers = spots(all_taken.numbers)
    for name, of in all_taken.of.items():
        source = Spots(of, acceleration.strides[0] if name == "acceleration" else 0)
        if name in desired._fields:
            places = spots_by_tick(getattr(desired, name))
            source = Spots(places.first.reshape(-1)[of], places.tick)
        wiring.move(Stage.TAKE, numbers[all_taken.to[name]], source, all_taken, acceleration, desired)
    for team, commands, signals, (store, recorded) in zip(teams, laws.commands, laws.signals, records, strict=True):
        wiring.move(Stage.COMMAND, command[team.commands], spots(commands), commands)
        wiring.move(Stage.SIGNALS, spots_by_tick(store), spots(signals)[recorded], store, signals)
    return True


def wire_acting(wiring: Wiring, now: TeamArrays, external: Floats) -> None:
    """Let commands act, and torques (ticks, robots, entries) besides: those of the leader alone, or of all robots."""
    besides = spots_by_tick(external)
    wiring.move(Stage.ACT, spots(now.torque[0]), besides[0], external)
    wiring.move(Stage.ACT, spots(now.torque[1:]), spots(now.command))
    if external.shape[1] > 1:
        wiring.move(Stage.BESIDES, spots(now.torque[1:]), besides[1:])


def wire_plants(wiring: Wiring, now: TeamArrays, first: int, robots: Sequence[RobotSetup]) -> None:
    """Give the plants what they are given: of one plant after the other, its commands and its other inputs.

    Parameters
    ----------
    wiring
        Gets where that comes from.
    now
        The numbers of a tick.
    first
        The first row that is a plant.
    robots
        Those that are plants.
    """
    commands = [len(robot.kind.command) for robot in robots]
    given = np.zeros(sum(commands) + sum(robot.samples.shape[1] for robot in robots))
    is_command = np.concatenate(
        [np.arange(own + robot.samples.shape[1]) < own for own, robot in zip(commands, robots, strict=True)]
    )
    acting = np.arange(now.torque.shape[1]) < np.array(commands)[:, np.newaxis]
    to, others = spots(given), np.flatnonzero(~is_command)
    wiring.move(Stage.GIVE, to[is_command], spots(now.torque[first : first + len(robots)])[acting], given)
    for robot in robots:
        own, others = np.split(others, [robot.samples.shape[1]])
        wiring.move(Stage.GIVE, to[own], spots_by_tick(robot.samples), robot.samples)
    wiring.given = given


def wire_path(wiring: Wiring, now: TeamArrays, leader: RobotSetup, motion: Motion | None) -> None:
    """Put a leader whose motion is given where it is."""
    if motion is not None:
        columns = list(now.columns_of(leader.kind))
        wiring.move(Stage.LEAD, spots(now.state[0])[columns], spots_by_tick(motion.state), motion)
