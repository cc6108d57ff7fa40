"""Followers see a leader of another kind as one of their own kind on the same path."""

import math

import numpy as np
import pytest
from formation_controllers import CarLike, TractorTrailer
from formation_controllers.vehicles import Vehicle
from numpy.typing import NDArray

from cosim.control.leader_view import as_seen_by

CAR, LONG_CAR = CarLike(1.2), CarLike(2.0)
TRUCK = TractorTrailer(1.5, 0.15, 0.4)
STATES = [np.array([1.0, 2.0, 0.4, 0.7, 0.8, -0.3]), np.array([0.0, 0.0, -2.0, -2.5, -0.5, 0.2])]


def path_rates(vehicle: Vehicle, pose: NDArray[np.float64], velocity: NDArray[np.float64]) -> tuple[float, float]:
    """Return the rate of the heading and the rate of the path's curvature, by the kinematics of (2) and section 4."""
    if isinstance(vehicle, TractorTrailer):
        length, angle = vehicle.hitch_length, pose[3] - pose[2]
        heading_rate = velocity[0] * math.tan(angle) / length
        angle_rate = velocity[1] - heading_rate
    else:
        length, angle = vehicle.wheelbase, pose[3]
        heading_rate = velocity[0] * math.tan(angle) / length
        angle_rate = velocity[1]
    return heading_rate, angle_rate / (length * math.cos(angle) ** 2)


@pytest.mark.parametrize("state", STATES)
def test_an_equal_vehicle_is_told_as_it_is(state: NDArray[np.float64]) -> None:
    acceleration = np.array([0.1, 0.2])
    leader = as_seen_by(CAR, CarLike(1.2, "rear_wheel"), state, acceleration)
    assert np.array_equal(leader.pose, state[:4])
    assert np.array_equal(leader.velocity, state[4:])
    assert leader.acceleration is acceleration


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize(("follower", "leader"), [(TRUCK, CAR), (CAR, TRUCK), (LONG_CAR, CAR)])
def test_path_and_speed_are_kept(follower: Vehicle, leader: Vehicle, state: NDArray[np.float64]) -> None:
    if isinstance(leader, CarLike):
        state = state.copy()
        state[3] = 0.5
    seen = as_seen_by(follower, leader, state, np.zeros(2))
    assert np.array_equal(seen.pose[:3], state[:3])
    assert seen.velocity[0] == state[4]
    assert path_rates(follower, seen.pose, seen.velocity) == pytest.approx(
        path_rates(leader, state[:4], state[4:]), rel=1e-12
    )
    assert seen.acceleration is None
