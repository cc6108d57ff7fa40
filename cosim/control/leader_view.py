"""The leader as followers of another vehicle are told of it."""

from __future__ import annotations

import math

import formation_controllers as fc
import numpy as np
from formation_controllers.vehicles import Vehicle, formation_of
from numpy.typing import NDArray


def as_seen_by(
    vehicle: Vehicle, leader: Vehicle, state: NDArray[np.float64], acceleration: NDArray[np.float64] | None
) -> fc.Leader:
    """Return the leader as if it were the follower's kind of vehicle, on the same path at the same speed.

    A follower's law reads the leader's steering angle, or the angle between tractor and trailer, by its own geometry.
    Position, heading, speed and curvature of the path, tan(steering angle) / length, are kept; so between equal
    vehicles everything is passed on as it is.

    Parameters
    ----------
    vehicle, leader
        The follower's vehicle and the leader's.
    state
        The leader's pose and pseudo-velocities (6,).
    acceleration
        Its pseudo-accelerations (2,), if they are known; between different vehicles they are not passed on.
    """
    if alike(vehicle, leader):
        return fc.Leader(state[:4], state[4:], acceleration)
    x, y, heading, angle, v, omega = state.tolist()
    trailer = isinstance(leader, fc.TractorTrailer)
    steering = angle - heading if trailer else angle
    curvature = math.tan(steering) / _length(leader)
    rate = omega - v * curvature if trailer else omega
    curvature_rate = rate / (math.cos(steering) ** 2 * _length(leader))
    slope = _length(vehicle) * curvature
    steering, rate = math.atan(slope), _length(vehicle) * curvature_rate / (1.0 + slope**2)
    if isinstance(vehicle, fc.TractorTrailer):
        steering, rate = heading + steering, rate + v * curvature
    return fc.Leader(np.array([x, y, heading, steering]), np.array([v, rate]))


def alike(vehicle: Vehicle, leader: Vehicle) -> bool:
    """Return whether a follower reads the leader's pose by its own geometry as the leader itself would."""
    return (type(vehicle), _length(vehicle)) == (type(leader), _length(leader))


def _length(vehicle: Vehicle) -> float:
    formation = formation_of(vehicle)
    if formation is None:
        raise TypeError(f"a {vehicle.kind} does not state how it sees a leader")
    return formation.length
