"""The numbers of all robots of a run at one tick, in arrays that are as wide as the kinds of vehicle need."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.vehicle.kind import Kind

Floats = NDArray[np.float64]


class TeamArrays:
    """Poses, velocities, commands and torques; row 0 is the leader's.

    A robot has its first entries in a row. Where it has fewer than another, the rest is NaN.

    Parameters
    ----------
    kinds
        That of each robot, the leader's first.

    Attributes
    ----------
    state, pose, velocity : ndarray
        Pose and pseudo-velocities (robots, entries); the other two are parts of it.
    measured : ndarray
        Measured poses (robots, entries); of the leader, the pose that followers are told.
    command, torque : ndarray
        Commands of the followers (followers, entries), and what acts on all robots (robots, entries).
    """

    def __init__(self, kinds: Sequence[Kind]) -> None:
        self.kinds = tuple(kinds)
        self._poses = max(len(kind.pose) for kind in kinds)
        width = self._poses + max(len(kind.velocity) for kind in kinds)
        self.state = np.full((len(kinds), width), np.nan)
        self.torque = np.full((len(kinds), max(len(kind.command) for kind in kinds)), np.nan)
        for row, kind in enumerate(kinds):
            self.state[row, self.columns_of(kind)] = 0.0
            self.torque[row, : len(kind.command)] = 0.0
        self.pose, self.velocity = self.state[:, : self._poses], self.state[:, self._poses :]
        self.measured = self.pose.copy()
        self.command = self.torque[1:].copy()

    def columns_of(self, kind: Kind) -> tuple[int, ...]:
        """Return in which columns of the state a kind has its pose and its velocities."""
        return (*range(len(kind.pose)), *range(self._poses, self._poses + len(kind.velocity)))

    def told_of_the_leader(self) -> Floats:
        """Return the leader's pose as followers are told and its velocities, one after the other."""
        poses, kind = len(self.kinds[0].pose), self.kinds[0]
        told = np.empty(poses + len(kind.velocity))
        told[:poses] = self.measured[0, :poses]
        told[poses:] = self.velocity[0, : len(kind.velocity)]
        return told

    def visible(self, row: int) -> tuple[Floats, Floats]:
        """Return the pose and the velocities of a robot, read only, as they are at any time."""
        view, kind = self.state.view(), self.kinds[row]
        view.flags.writeable = False
        return view[row, : len(kind.pose)], view[row, self._poses : self._poses + len(kind.velocity)]

    def padded(self, torques: Sequence[Floats]) -> Floats:
        """Return the torques (ticks, entries) of each robot in one array (ticks, robots, entries)."""
        found = np.full((len(torques[0]), *self.torque.shape), np.nan)
        for row, own in enumerate(torques):
            found[:, row, : own.shape[1]] = own
        return found


class Driving:
    """What the plants are given: of one plant after the other, its commands and its other inputs.

    Parameters
    ----------
    torque
        Of all robots (robots, entries).
    first
        The first row that is a plant.
    kinds, samples
        Of each plant its kind, and the values (ticks, inputs) of its other inputs.
    """

    def __init__(self, torque: Floats, first: int, kinds: Sequence[Kind], samples: Sequence[Floats]) -> None:
        driving = torque[first:].reshape(-1)  # a view
        width = torque.shape[1]
        self._driving = driving
        self._samples = np.concatenate(samples, axis=1)
        counts = [len(kind.command) for kind in kinds]
        self._is_command = np.concatenate(
            [np.arange(count + own.shape[1]) < count for count, own in zip(counts, samples, strict=True)]
        )
        places = [row * width + place for row, count in enumerate(counts) for place in range(count)]
        self._places = None if len(places) == len(driving) else np.array(places)
        self._given = np.zeros(len(self._is_command))

    def given(self, tick: int) -> Floats:
        """Return what holds from a tick to the next."""
        commands = self._driving if self._places is None else self._driving[self._places]
        if not self._samples.size:
            return commands
        self._given[self._is_command] = commands
        self._given[~self._is_command] = self._samples[tick]
        return self._given
