"""The numbers of all robots of a run at one tick, in arrays that are as wide as the kinds of vehicle need."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.storage import Storage, blocks, constant, is_constant
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
        self.state: Floats = np.empty((len(kinds), width))
        self.torque: Floats = np.empty((len(kinds), max(len(kind.command) for kind in kinds)))
        self.pose, self.velocity = self.state[:, : self._poses], self.state[:, self._poses :]
        self.measured: Floats = np.empty(self.pose.shape)
        self.command: Floats = np.empty(self.torque[1:].shape)
        self.clear()

    def clear(self) -> None:
        """Forget the numbers of a run: what a robot has is zero, the rest NaN."""
        self.state[:], self.torque[:] = np.nan, np.nan
        for row, kind in enumerate(self.kinds):
            self.state[row, self.columns_of(kind)] = 0.0
            self.torque[row, : len(kind.command)] = 0.0
        self.measured[:], self.command[:] = self.pose, self.torque[1:]

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

    def padded(self, torques: Sequence[Floats], storage: Storage) -> Floats:
        """Return the torques (ticks, entries) of the first robots in one array (ticks, robots, entries)."""
        samples, shape = len(torques[0]), (len(torques), self.torque.shape[1])
        if all(is_constant(own) for own in torques):
            at_once = np.full(shape, np.nan)
            for row, own in enumerate(torques):
                at_once[row, : own.shape[1]] = own[0]
            return constant(at_once, samples)
        found = storage.empty((samples, *shape))
        for block in blocks(samples, self.torque.size):
            found[block] = np.nan
            for row, own in enumerate(torques):
                found[block, row, : own.shape[1]] = own[block]
        return found
