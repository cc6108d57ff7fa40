"""Teams whose laws compiled code can call: where the numbers of a tick stand in the inputs of their laws."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from formation_controllers.interface import CompiledTick, TickInputs
from numpy.typing import NDArray

from cosim.control.exchange import Exchange, can_exchange
from cosim.control.team import Team
from cosim.control.team_elsewhere import TeamElsewhere
from cosim.control.team_here import TeamHere
from cosim.frames import Bound

Places = NDArray[np.int64]
SOURCES = ("measured", "state", "q", "q_dot", "q_ddot", "acceleration")
"""Arrays from which the inputs of laws come."""


class Taken(NamedTuple):
    """The inputs of all laws as parts of one flat array.

    Attributes
    ----------
    numbers : ndarray
        The array.
    inputs : list of TickInputs
        Its parts, team by team.
    to, of : dict
        For each source, the places in the array and, in the same order, those in the source, laid out flat.
    """

    numbers: NDArray[np.float64]
    inputs: list[TickInputs]
    to: dict[str, Places]
    of: dict[str, Places]


class Called(NamedTuple):
    """Laws that compiled code calls.

    Attributes
    ----------
    calls : list of Bound
        What it calls in a tick, one after the other: all hosts first, as that may have to be done once more.
    commands, signals : list of ndarray
        Of each team: its commands (n, entries), and the numbers of its telemetry.
    elsewhere : Exchange or None
        The exchange with hosts, if there are any.
    """

    calls: list[Bound]
    commands: list[NDArray[np.float64]]
    signals: list[NDArray[np.float64]]
    elsewhere: Exchange | None


def are_compiled(teams: Sequence[Team]) -> bool:
    """Return whether no law must be called from Python."""
    return all(
        team.alike and can_exchange() if isinstance(team, TeamElsewhere) else _tick_of(team) is not None
        for team in teams
    )


def called(teams: Sequence[Team], inputs: Sequence[TickInputs]) -> Called | None:
    """Return laws that `are_compiled`, with what each gets at a tick; None if one of them cannot be called after all.

    A law may have something of its own that is neither number nor array.
    """
    calls, commands, signals = [], [], []
    hosted = [(team, own) for team, own in zip(teams, inputs, strict=True) if isinstance(team, TeamElsewhere)]
    elsewhere = Exchange(*zip(*hosted, strict=True)) if hosted else None
    if elsewhere is not None:
        calls.append(elsewhere.call)
    for team, own in zip(teams, inputs, strict=True):
        if isinstance(team, TeamElsewhere):
            commands.append(team.commanded)
            signals.append(team.signals)
            continue
        tick = _tick_of(team)
        assert tick is not None
        commands.append(np.zeros((len(team.robots), len(team.vehicle.command))))
        signals.append(team.telemetry(0.0).reshape(-1))
        try:
            calls.append(Bound(tick.function, own, tick.own, commands[-1]))
        except TypeError:
            return None
    return Called(calls, commands, signals, elsewhere)


def _tick_of(team: Team) -> CompiledTick | None:
    return team.compiled_tick() if isinstance(team, TeamHere) else None


def taken(teams: Sequence[Team], state: Places, measured: Places, desired: Places, acceleration: Places) -> Taken:
    """Return the inputs of teams.

    Parameters
    ----------
    teams
        Teams that see the leader as it is.
    state, measured, desired, acceleration
        Each with its own flat index as its entries: velocities (robots, entries) in the state, measured poses (robots,
        entries), desired places (followers, 2), accelerations of the leader, empty if they are not known.
    """
    to: dict[str, list[Places]] = {name: [] for name in SOURCES}
    of: dict[str, list[Places]] = {name: [] for name in SOURCES}
    size = 0

    def part(source: str, places: Places) -> _Part:
        nonlocal size
        first, size = size, size + places.size
        to[source].append(np.arange(first, size))
        of[source].append(places.reshape(-1))
        return _Part(first, places.shape)

    parts = []
    for team in teams:
        poses, velocities = (len(entries) for entries in (team.vehicle.pose, team.vehicle.velocity))
        own, needed = 1 + team.rows, team.measured
        parts.append(
            (
                part("measured", measured[own, :poses]),
                part("state", state[own, :velocities]) if needed else np.full((len(own), velocities), np.nan),
                part("measured", measured[0, :poses]),
                part("state", state[0, :velocities]),
                part("acceleration", acceleration) if len(acceleration) else np.zeros(velocities),
                *(part(name, desired[team.rows]) for name in ("q", "q_dot", "q_ddot")),
            )
        )
    numbers = np.zeros(size)
    inputs = [TickInputs(*(own.of(numbers) if isinstance(own, _Part) else own for own in its)) for its in parts]
    return Taken(numbers, inputs, _joined(to), _joined(of))


class _Part(NamedTuple):
    """A part of a flat array: its first place, and its shape."""

    first: int
    shape: tuple[int, ...]

    def of(self, numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        return numbers[self.first : self.first + math.prod(self.shape)].reshape(self.shape)


def _joined(places: dict[str, list[Places]]) -> dict[str, Places]:
    return {name: np.concatenate([np.zeros(0, dtype=np.int64), *own]) for name, own in places.items()}
