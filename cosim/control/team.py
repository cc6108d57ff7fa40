"""The followers that share a control law, as the master sees them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import formation_controllers as fc
import numpy as np
from numpy.typing import NDArray

from cosim.control.host import shapes_of, stated, telemetry_type
from cosim.control.law import Law, LawGains
from cosim.control.leader_view import LeaderView
from cosim.errors import SimulationError


class Team(ABC):
    """One controller with the followers that it serves.

    Legal call order: in each tick of control `give` and then `step`, the first time with ``first``; then `telemetry`.

    Parameters
    ----------
    law
        The control law.
    gains
        Those of each follower.
    robots, rows
        The followers' names, and their rows in the arrays of all followers.
    view
        Their kind of vehicle and geometry, and the leader's.
    period
        Sample period [s].

    Attributes
    ----------
    place : slice or ndarray
        The rows as an index; a slice, which NumPy takes in a fifth of the time, where they are neighbours.
    poses, velocities, commands : tuple
        Their entries in the arrays of all followers as an index: the first ones of each row.
    vehicle, leader : Vehicle
        The followers' geometry, and the leader's.
    telemetry_type : numpy.dtype
        The record of the signals that the law states.
    alike : bool
        Whether followers read the leader's pose by their own geometry as the leader itself would.
    measured : bool
        Whether the law needs velocities.
    """

    def __init__(
        self,
        law: Law,
        gains: Sequence[LawGains],
        robots: Sequence[str],
        rows: Sequence[int],
        view: LeaderView,
        period: float,
    ) -> None:
        self.made_of = (law, tuple(gains), tuple(robots), tuple(rows), view, period)
        self.law = law
        self.gains = tuple(gains)
        self.robots = tuple(robots)
        self.rows = np.asarray(rows)
        self.period = period
        first, last = int(rows[0]), int(rows[-1])
        neighbours = list(rows) == list(range(first, last + 1))
        self.place: slice | NDArray[np.int_] = slice(first, last + 1) if neighbours else self.rows
        self.view, self.vehicle, self.leader = view, view.vehicle, view.leader
        self.poses = self._index(len(self.vehicle.pose))
        self.velocities = self._index(len(self.vehicle.velocity))
        self.commands = self._index(len(self.vehicle.command))
        self.alike = view.alike
        self.measured = "velocity" in law.needs
        self.telemetry_type: np.dtype[np.void] = telemetry_type(law.signals)
        self._make()

    @abstractmethod
    def _make(self) -> None:
        """Make what a team of this kind has besides."""

    @property
    def shares_gains(self) -> bool:
        """Whether all followers have the same gains."""
        return all(own is self.gains[0] for own in self.gains)

    @property
    def shapes(self) -> list[tuple[int, ...]]:
        """The shapes of its inputs, commands and telemetry, as a host has them."""
        pose, velocity, command = map(len, (self.vehicle.pose, self.vehicle.velocity, self.vehicle.command))
        return shapes_of(len(self.robots), pose, velocity, command, self.telemetry_type.itemsize // 8)

    def for_host(self, accelerates: bool) -> dict[str, Any]:
        """Return what a host is told of it besides its gains, given whether the leader's accelerations are known."""
        return {
            "shared": self.shares_gains,
            "vehicle": stated(self.vehicle),
            "size": len(self.robots),
            "period": self.period,
            "accelerates": accelerates and self.alike,
        }

    def _index(self, entries: int) -> tuple[slice | NDArray[np.int_], slice]:
        return self.place, slice(0, entries)

    @abstractmethod
    def give(
        self,
        pose: NDArray[np.float64],
        velocity: NDArray[np.float64],
        leader: NDArray[np.float64],
        acceleration: NDArray[np.float64] | None,
        desired: fc.Desired,
    ) -> None:
        """Give the law what it gets at a tick.

        Poses and velocities (N, entries) belong to all followers, the desired places to this team. Poses are
        those measured; a law that needs velocities is given the true ones, and no other law any. The leader is its pose
        and pseudo-velocities, one after the other, and its accelerations where they are known. Others read
        these arrays, too: a law gets copies.
        """

    @abstractmethod
    def step(self, time: float, *, first: bool) -> NDArray[np.float64]:
        """Return the commands (n, entries) of this team's followers, torques [N.m] if their vehicle takes torques.

        Raises
        ------
        SimulationError
            The controller refused its input, failed, or returned something other than finite torques.
        """

    @abstractmethod
    def telemetry(self, time: float) -> NDArray[np.float64]:
        """Return the controller's signals at the last step: the numbers of one record a follower, one after the other.

        Raises
        ------
        SimulationError
            The controller failed, or returned other signals than it has stated.
        """

    @abstractmethod
    def restart(self, *made_of: object) -> bool:
        """Lead the law back to before its start, for a team that is made of some arguments.

        Returns
        -------
        bool
            Whether that makes it a team as good as new: it is made of the same, and the law states its compiled tick,
            so that all of its numbers are in its records.
        """

    @abstractmethod
    def not_finite(self, command: NDArray[np.float64], time: float) -> SimulationError:
        """Return the failure of a controller that returned commands (n, entries) which are not finite."""

    @abstractmethod
    def to_bytes(self, time: float) -> bytes:
        """Return the state of the law at a communication point, after its start.

        Raises
        ------
        SimulationError
            The controller failed.
        """

    @abstractmethod
    def from_bytes(self, state: bytes, time: float) -> None:
        """Let the law go on from a state that `to_bytes` has returned of a team that was made of the same.

        Raises
        ------
        SimulationError
            The controller refuses it.
        """

    def _failure(self, row: int | None, said: str, time: float, variable: str = "") -> SimulationError:
        robot = self.robots[row] if row is not None else " and ".join(self.robots)
        return SimulationError(robot, time, f"the controller {self.law.source.name!r} {said}", variable)


MadeOf = tuple[Law, tuple[LawGains, ...], tuple[str, ...], tuple[int, ...], LeaderView, float]
"""The arguments of a team."""
