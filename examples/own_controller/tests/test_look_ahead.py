"""The package is installed when these run: the law is found by name, as a scenario finds it."""

import numpy as np
import pytest
from formation_controllers import CarLike, Desired, GainError, Leader, Team, load
from formation_controllers.geometry import formation_rates, range_bearing
from formation_controllers.testing import check_controller

LookAhead = load("look-ahead")


def test_it_keeps_what_controllers_promise():
    check_controller(LookAhead)
    check_controller(LookAhead, [LookAhead.gains_type(K=k) for k in (5, 10, 20)])


def test_a_robot_in_its_place_at_rest_is_left_alone():
    team, pose, leader = Team(CarLike(1.2), 1, 0.02), np.zeros((1, 4)), Leader(np.array([5, 1, 0, 0.0]), np.zeros(2))
    desired = Desired(range_bearing(pose, leader.pose, team.vehicle), np.zeros((1, 2)), np.zeros((1, 2)))
    controller = LookAhead(team)
    controller.start(pose, leader, desired)
    np.testing.assert_allclose(controller.step(pose, leader, desired), 0, atol=1e-12)


def test_a_robot_goes_to_its_place_behind_a_leader_at_rest():
    """A plant of the simplest kind: pseudo-velocities that follow the torque with a lag."""
    vehicle = CarLike(1.2, "rear_wheel")
    controller = LookAhead(Team(vehicle, 1, 0.02))
    leader = Leader(np.array([8.0, 1.0, 0.0, 0.0]), np.zeros(2))
    desired = Desired(np.array([[3.0, 0.3]]), np.zeros((1, 2)), np.zeros((1, 2)))
    pose, velocity = np.zeros((1, 4)), np.zeros((1, 2))
    controller.start(pose, leader, desired)
    for _ in range(1000):
        torque = controller.step(pose, leader, desired)
        v, omega = velocity[0]
        rates = [v * np.cos(pose[0, 2]), v * np.sin(pose[0, 2]), v * np.tan(pose[0, 3]) / 1.2, omega]
        pose = pose + 0.02 * np.array([rates])
        velocity = velocity + 0.02 * (torque - 25 * velocity) / [30, 10]
    R, _ = formation_rates(pose, leader.pose, 0.0, vehicle)
    assert np.abs(range_bearing(pose, leader.pose, vehicle) - desired.q).max() < 0.01
    assert np.linalg.det(R[0]) > 0


def test_a_time_constant_of_zero_is_refused():
    with pytest.raises(GainError, match=r"'T' is 0: must be greater than 0 \(the filter divides by it\)"):
        LookAhead.gains_type(T=0)
