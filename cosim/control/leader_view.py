"""The leader as followers of another kind of vehicle see it."""

from __future__ import annotations

import formation_controllers as fc
import numpy as np
from formation_controllers.vehicles import Vehicle
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.vehicle.kind import OnPath
from cosim.vehicle.kinds import kind_named


def as_seen_by(
    vehicle: Vehicle, leader: Vehicle, state: NDArray[np.float64], acceleration: NDArray[np.float64] | None
) -> fc.Leader:
    """Return the leader as if it were the follower's kind of vehicle, on the same path at the same speed.

    A follower's law reads the leader's steering angle, or the angle between tractor and trailer, by its own geometry.
    Position, heading, speed and curvature of the path are kept. Between equal vehicles the state stays unchanged.

    Parameters
    ----------
    vehicle, leader
        The follower's vehicle and the leader's.
    state
        The leader's pose and pseudo-velocities, one after the other.
    acceleration
        Its pseudo-accelerations, if known; between different vehicles they are left out.
    """
    if alike(vehicle, leader):
        return fc.Leader(state[: len(leader.pose)], state[len(leader.pose) :], acceleration)
    on_path, leads_on = _on_path(vehicle), _on_path(leader)
    seen = np.array(on_path.state(vehicle, leads_on.course(leader, state.tolist())))
    return fc.Leader(seen[: len(vehicle.pose)], seen[len(vehicle.pose) :])


def alike(vehicle: Vehicle, leader: Vehicle) -> bool:
    """Return whether a follower reads the leader's pose by its own geometry as the leader itself would."""
    if vehicle.kind != leader.kind:
        return False
    on_path = kind_named(vehicle.kind).on_path
    return on_path is None or on_path.steering_length(vehicle) == on_path.steering_length(leader)


def check_view(vehicle: Vehicle, leader: Vehicle) -> None:
    """Check that followers of one kind of vehicle can follow a leader of another.

    Raises
    ------
    InputError
        One of the two kinds states no motion along a path.
    """
    for one in (vehicle, leader) if not alike(vehicle, leader) else ():
        _on_path(one)


def _on_path(vehicle: Vehicle) -> OnPath:
    on_path = kind_named(vehicle.kind).on_path
    if on_path is None:
        raise InputError(
            f"the kind {vehicle.kind} states no motion along a path: its leader and followers must be "
            f"{vehicle.kind} vehicles, too"
        )
    return on_path
