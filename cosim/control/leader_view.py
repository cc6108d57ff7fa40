"""The leader as followers of another kind of vehicle see it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import formation_controllers as fc
import numpy as np
from formation_controllers.vehicles import Vehicle
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.vehicle.kind import Kind, OnPath


@dataclass(frozen=True)
class LeaderView:
    """How followers of one kind and geometry see the leader.

    Attributes
    ----------
    kind, vehicle
        The followers' kind of vehicle, and their geometry.
    leader_kind, leader
        The leader's. Kinds of different names may make vehicles of the same class.
    """

    kind: Kind
    vehicle: Vehicle
    leader_kind: Kind
    leader: Vehicle

    @cached_property
    def alike(self) -> bool:
        """Whether a follower reads the leader's pose by its own geometry as the leader itself would."""
        own, its = self.vehicle, self.leader
        if (own.kind, own.pose, own.velocity) != (its.kind, its.pose, its.velocity):
            return False
        on_path = self.kind.on_path
        if on_path is None:
            return self.kind.name == self.leader_kind.name
        return on_path.steering_length(own) == on_path.steering_length(its)

    @property
    def on_paths(self) -> tuple[OnPath, OnPath]:
        """How the followers move along a path, and how the leader does.

        Raises
        ------
        InputError
            One of the two kinds states no motion along a path.
        """
        return _on_path(self.kind), _on_path(self.leader_kind)

    def check(self) -> None:
        """Check that the followers can follow the leader.

        Raises
        ------
        InputError
            They are not alike, and one of the two kinds states no motion along a path.
        """
        if not self.alike:
            _ = self.on_paths

    def seen(self, state: NDArray[np.float64], acceleration: NDArray[np.float64] | None) -> fc.Leader:
        """Return the leader as if it were the follower's kind of vehicle, on the same path at the same speed.

        A follower's law reads the leader's steering angle, or the angle between tractor and trailer, by its own
        geometry. Position, heading, speed and curvature of the path are kept. Between equal vehicles the state stays
        unchanged.

        Parameters
        ----------
        state
            The leader's pose and pseudo-velocities, one after the other.
        acceleration
            Its pseudo-accelerations, if known; between different vehicles they are left out.
        """
        if self.alike:
            return fc.Leader(state[: len(self.leader.pose)], state[len(self.leader.pose) :], acceleration)
        on_path, leads_on = self.on_paths
        seen = np.array(on_path.state(self.vehicle, leads_on.course(self.leader, state.tolist())))
        return fc.Leader(seen[: len(self.vehicle.pose)], seen[len(self.vehicle.pose) :])


def _on_path(kind: Kind) -> OnPath:
    if kind.on_path is None:
        raise InputError(
            f"the kind {kind.name} states no motion along a path: its leader and followers must be "
            f"{kind.name} vehicles, too"
        )
    return kind.on_path
