"""Equations (4) to (8) and B2 of (3)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from formation_controllers import CarLike, ControllerError, DifferentialDrive, TractorTrailer, kinematics
from formation_controllers.geometry import (
    first_range_bearing,
    formation_courses,
    formation_rates,
    input_matrix,
    posture_error,
    posture_error_rates,
    range_bearing,
    unwrapped_bearing,
)
from hypothesis import given
from hypothesis import strategies as st

CAR = CarLike(1.2)
TRACTOR = TractorTrailer(hitch_length=1.5, wheel_radius=0.15, half_track=0.4)
DIFFERENTIAL = DifferentialDrive(wheel_radius=0.15, half_track=0.4)
VEHICLES = pytest.mark.parametrize("vehicle", [CAR, TRACTOR, DIFFERENTIAL], ids=lambda vehicle: vehicle.kind)


def random_poses(n, seed=0, vehicle=CAR):
    """Poses of followers and of leaders well away from the singularities."""
    random = np.random.default_rng(seed)
    pose = random.uniform([-5, -5, -7, -1], [5, 5, 7, 1], (n, 4))
    away = random.uniform(2, 10, n)
    angle = random.uniform(-math.pi, math.pi, n)
    leader = np.column_stack(
        [
            pose[:, 0] + away * np.cos(angle),
            pose[:, 1] + away * np.sin(angle),
            random.uniform(-7, 7, n),
            random.uniform(-1, 1, n),
        ]
    )
    if vehicle is TRACTOR:  # headings of both bodies instead of one and an angle between them
        pose[:, 3] += pose[:, 2]
        leader[:, 3] += leader[:, 2]
    entries = len(vehicle.pose)
    return pose[:, :entries], leader[:, :entries]


def steering(pose, vehicle):
    if vehicle is DIFFERENTIAL:
        return np.zeros(pose.shape[:-1])
    return pose[..., 3] - pose[..., 2] if vehicle is TRACTOR else pose[..., 3]


def motion_basis(pose, vehicle):
    """S of (2), shape (..., 4, 2); of a differential-drive robot (..., 3, 2)."""
    if vehicle is DIFFERENTIAL:
        zero, one = np.zeros(pose.shape[:-1]), np.ones(pose.shape[:-1])
        columns = [np.cos(pose[..., 2]), np.sin(pose[..., 2]), zero], [zero, zero, one]
        return np.stack([np.stack(column, axis=-1) for column in columns], axis=-1)
    length = vehicle.hitch_length if vehicle is TRACTOR else vehicle.wheelbase
    heading = pose[..., 2]
    turn = np.tan(steering(pose, vehicle)) / length
    first = np.stack([np.cos(heading), np.sin(heading), turn, np.zeros_like(heading)], axis=-1)
    return np.stack([first, np.broadcast_to([0.0, 0.0, 0.0, 1.0], first.shape)], axis=-1)


def test_posture_error_is_the_leader_in_the_followers_frame():
    # The follower looks along +y: the leader, 3 m further along y and 1 m along x, is ahead and to the right.
    e = posture_error([1.0, 2.0, math.pi / 2, 0.1], [2.0, 5.0, math.pi, 0.3])
    np.testing.assert_allclose(e, [3.0, -1.0, math.pi / 2, 0.2], atol=1e-15)


@VEHICLES
def test_rates_of_the_posture_error_are_its_time_derivative_and_5(vehicle):
    """(6) and (53) against differences of (4), and against (5) and (53) written out."""
    pose, leader = random_poses(200, vehicle=vehicle)
    random = np.random.default_rng(1)
    velocity, leader_velocity = random.uniform(-1, 1, (2, 200, 2))
    J, S = posture_error_rates(pose, leader, vehicle)
    e_dot = np.einsum("nij,nj->ni", J, velocity) + np.einsum("nij,nj->ni", S, leader_velocity)
    pose_dot = np.einsum("nij,nj->ni", motion_basis(pose, vehicle), velocity)
    leader_dot = np.einsum("nij,nj->ni", motion_basis(leader, vehicle), leader_velocity)
    h = 1e-5
    ahead = posture_error(pose + h * pose_dot, leader + h * leader_dot, vehicle)
    behind = posture_error(pose - h * pose_dot, leader - h * leader_dot, vehicle)
    np.testing.assert_allclose(e_dot, (ahead - behind) / (2 * h), atol=1e-8)

    length = 1.5 if vehicle is TRACTOR else 1.2
    e_1, e_2, e_3 = posture_error(pose, leader, vehicle).T[:3]
    (v, omega), (v_d, omega_d) = velocity.T, leader_velocity.T
    turn, turn_d = v / length * np.tan(steering(pose, vehicle)), v_d / length * np.tan(steering(leader, vehicle))
    if vehicle is DIFFERENTIAL:
        turn, turn_d = omega, omega_d
    printed = [-v + v_d * np.cos(e_3) + turn * e_2, -turn * e_1 + v_d * np.sin(e_3), turn_d - turn, omega_d - omega]
    np.testing.assert_allclose(e_dot, np.column_stack(printed[: len(vehicle.pose)]), rtol=1e-12, atol=1e-12)


def test_range_and_bearing_are_seen_from_the_front_axle_and_relative_to_the_steered_wheel():
    # Front axle at (1, 3.2); the leader is 4 m ahead of it and 4 m to the left.
    q = range_bearing([1.0, 2.0, math.pi / 2, 0.1], [-3.0, 7.2, 0.0, 0.0], CAR)
    np.testing.assert_allclose(q, [math.sqrt(32), math.pi / 4 - 0.1], rtol=1e-15)


def test_range_and_bearing_of_a_tractor_trailer_are_seen_from_the_tractor():
    # Trailer at (1, 2) heading along +y, tractor 1.5 m ahead of it, its axis 0.1 rad to the left: see the car's.
    q = range_bearing([1.0, 2.0, math.pi / 2, math.pi / 2 + 0.1], [-3.0, 7.5, 0.0, 0.0], TRACTOR)
    np.testing.assert_allclose(q, [math.sqrt(32), math.pi / 4 - 0.1], rtol=1e-15)


def test_range_and_bearing_of_a_differential_drive_are_seen_from_its_axle():
    # Heading along +y; the leader is 4 m ahead of the axle's midpoint and 4 m to the left.
    q = range_bearing([1.0, 2.0, math.pi / 2], [-3.0, 6.0, 0.0], DIFFERENTIAL)
    np.testing.assert_allclose(q, [math.sqrt(32), math.pi / 4], rtol=1e-15)


def test_a_differential_drive_is_a_tractor_without_its_trailer():
    """A tractor-trailer in line, seen by a robot at the tractor: the same range, bearing, R, delta and B2."""
    pose, leader = random_poses(50, vehicle=DIFFERENTIAL)
    trailer = np.column_stack([pose, pose[:, 2]])
    trailer[:, :2] -= 1.5 * np.column_stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])])
    behind, at_leader = trailer, np.column_stack([leader, leader[:, 2]])
    close = {"rtol": 1e-9, "atol": 1e-9}
    np.testing.assert_allclose(
        range_bearing(pose, leader, DIFFERENTIAL), range_bearing(behind, at_leader, TRACTOR), **close
    )
    own, others = formation_rates(pose, leader, 0.7, DIFFERENTIAL), formation_rates(behind, at_leader, 0.7, TRACTOR)
    for one, other in zip(own, others, strict=True):
        np.testing.assert_allclose(one, other, **close)
    np.testing.assert_allclose(input_matrix(pose, DIFFERENTIAL), input_matrix(behind, TRACTOR), **close)


@VEHICLES
def test_range_and_bearing_do_not_change_when_the_world_is_moved(vehicle):
    pose, leader = random_poses(100, vehicle=vehicle)
    c, s, n = math.cos(0.7), math.sin(0.7), len(vehicle.pose)
    move = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])[:n, :n]
    offset = np.array([3.0, -4.0, 0.7, 0.7 if vehicle is TRACTOR else 0.0])[:n]
    moved = range_bearing(pose @ move.T + offset, leader @ move.T + offset, vehicle)
    difference = moved - range_bearing(pose, leader, vehicle)
    np.testing.assert_allclose(difference[:, 0], 0, atol=1e-12)
    np.testing.assert_allclose(np.sin(difference[:, 1] / 2), 0, atol=1e-12)


@VEHICLES
def test_rates_are_the_time_derivative_of_range_and_bearing(vehicle):
    """(8) against differences of (7), (55) against differences of (54)."""
    pose, leader = random_poses(500, vehicle=vehicle)
    random = np.random.default_rng(1)
    velocity, leader_velocity = random.uniform(-1, 1, (2, 500, 2))
    pose_dot = np.einsum("nij,nj->ni", motion_basis(pose, vehicle), velocity)
    leader_dot = np.einsum("nij,nj->ni", motion_basis(leader, vehicle), leader_velocity)
    h = 1e-5
    ahead = range_bearing(pose + h * pose_dot, leader + h * leader_dot, vehicle)
    behind = range_bearing(pose - h * pose_dot, leader - h * leader_dot, vehicle)
    difference = ahead - behind
    difference[:, 1] = (difference[:, 1] + math.pi) % (2 * math.pi) - math.pi  # atan2 may jump in between
    R, delta = formation_rates(pose, leader, leader_velocity[:, 0], vehicle)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", R, velocity) + delta, difference / (2 * h), atol=1e-8)


@VEHICLES
def test_r_is_as_printed(vehicle):
    """Also that (55) rightly lacks the term -tan(h)/d that (8) has."""
    pose, leader = random_poses(50, vehicle=vehicle)
    rho, bearing = range_bearing(pose, leader, vehicle).T
    angle = steering(pose, vehicle)
    c, s, t = np.cos(bearing + angle), np.sin(bearing + angle), np.tan(angle)
    turn = t / vehicle.wheelbase if vehicle is CAR else 0.0
    R, _ = formation_rates(pose, leader, 0.0, vehicle)
    np.testing.assert_allclose(R[:, 0, 0], -c - s * t, atol=1e-12)
    np.testing.assert_allclose(R[:, 1, 0], (s - c * t) / rho - turn, atol=1e-12)
    np.testing.assert_array_equal(R[:, :, 1], np.broadcast_to([0.0, -1.0], (50, 2)))


@VEHICLES
def test_determinant_of_r_vanishes_with_the_cosine_of_the_bearing(vehicle):
    pose, leader = random_poses(200, vehicle=vehicle)
    R, _ = formation_rates(pose, leader, 0.0, vehicle)
    bearing = range_bearing(pose, leader, vehicle)[:, 1]
    expected = np.cos(bearing) / np.cos(steering(pose, vehicle))
    np.testing.assert_allclose(np.linalg.det(R), expected, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("drive", ["as_printed", "front_wheel", "rear_wheel"])
def test_input_matrix_is_the_motion_basis_times_b1(drive):
    pose, _ = random_poses(100)
    psi, gamma, zero = pose[:, 2], pose[:, 3], np.zeros(100)
    first = {
        "as_printed": [np.cos(psi), np.sin(psi), CAR.wheelbase * np.sin(psi), zero],
        "front_wheel": [np.cos(psi + gamma), np.sin(psi + gamma), CAR.wheelbase * np.sin(gamma), zero],
        "rear_wheel": [np.cos(psi), np.sin(psi), zero, zero],
    }[drive]
    B1 = np.stack([np.stack(first, axis=-1), np.broadcast_to([0.0, 0.0, 0.0, 1.0], (100, 4))], axis=-1)
    B2 = np.einsum("nki,nkj->nij", motion_basis(pose, CAR), B1)
    np.testing.assert_allclose(input_matrix(pose, CarLike(1.2, drive)), B2, rtol=1e-12, atol=1e-12)


def test_input_matrix_of_a_tractor_trailer_is_the_motion_basis_times_b1():
    """(57): the first column is the right wheel, which turns the tractor to the left."""
    pose, _ = random_poses(100, vehicle=TRACTOR)
    theta_0, h, b = pose[:, 3], steering(pose, TRACTOR), np.full(100, 0.4)
    rows = [np.cos(theta_0), np.sin(theta_0), 1.5 * np.sin(h)]
    B1 = np.stack([np.stack([*rows, b], axis=-1), np.stack([*rows, -b], axis=-1)], axis=-1) / 0.15
    B2 = np.einsum("nki,nkj->nij", motion_basis(pose, TRACTOR), B1)
    np.testing.assert_allclose(input_matrix(pose, TRACTOR), B2, rtol=1e-12, atol=1e-12)


def test_input_matrix_of_a_differential_drive_is_the_motion_basis_times_b1():
    """Both wheels push along the heading by tau/r; the right one turns the robot to the left by b tau/r."""
    pose, _ = random_poses(100, vehicle=DIFFERENTIAL)
    c, s, b = np.cos(pose[:, 2]), np.sin(pose[:, 2]), np.full(100, 0.4)
    B1 = np.stack([np.stack([c, s, b], axis=-1), np.stack([c, s, -b], axis=-1)], axis=-1) / 0.15
    B2 = np.einsum("nki,nkj->nij", motion_basis(pose, DIFFERENTIAL), B1)
    np.testing.assert_allclose(input_matrix(pose, DIFFERENTIAL), B2, rtol=1e-12, atol=1e-12)


@VEHICLES
def test_rates_of_r_and_delta_are_their_time_derivatives(vehicle):
    """Derivatives by hand in feedback linearisation and the formation model, against differences."""
    pose, leader = random_poses(100, seed=3, vehicle=vehicle)
    random, h = np.random.default_rng(4), 1e-6
    (v, omega), (v_d, omega_d) = random.uniform(-1, 1, (2, 2, 100))
    own_rate = np.einsum("nij,nj->ni", motion_basis(pose, vehicle), np.column_stack([v, omega]))
    leader_rate = np.einsum("nij,nj->ni", motion_basis(leader, vehicle), np.column_stack([v_d, omega_d]))
    ahead, behind = (
        formation_rates(pose + d * own_rate, leader + d * leader_rate, v_d + 0.3 * d, vehicle) for d in (h, -h)
    )
    R, delta = formation_rates(pose, leader, v_d, vehicle)
    car = kinematics.geometry_of(vehicle)
    for i in range(100):
        own, other = kinematics.pose_of(pose[i], car), kinematics.pose_of(leader[i], car)
        error = kinematics.posture_error(own, kinematics.direction_of(own.heading), other)
        rho, phi = kinematics.line_of_sight(error.e_1, error.e_2, car.ahead)
        steers, steers_d = (kinematics.steering_of(float(steering(at[i], vehicle))) for at in (pose, leader))
        rho_dot, bearing_dot = R[i] @ [v[i], omega[i]] + delta[i]
        turn = kinematics.body_turn(v[i], omega[i], steers, car)
        turn_d = kinematics.body_turn(v_d[i], omega_d[i], steers_d, car)
        assert turn == pytest.approx(own_rate[i, 2], rel=1e-12)
        h_dot = kinematics.steering_rate(omega[i], turn, car)
        moved = rho_dot, bearing_dot + h_dot
        sight, course = kinematics.direction_of(phi), kinematics.direction_of(error.e_3 - phi)
        column = kinematics.rate_matrix_dot(rho, sight, steers, *moved, h_dot, car)
        shift = kinematics.leader_rates_dot(rho, course, v_d[i], rho_dot, turn_d - turn - moved[1], 0.3)
        np.testing.assert_allclose(column, (ahead[0][i, :, 0] - behind[0][i, :, 0]) / (2 * h), rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(shift, (ahead[1][i] - behind[1][i]) / (2 * h), rtol=1e-5, atol=1e-6)


def test_leading_dimensions_broadcast():
    pose, leader = random_poses(6)
    q = range_bearing(pose.reshape(2, 3, 4), leader[0], CAR)
    assert q.shape == (2, 3, 2)
    np.testing.assert_array_equal(q[1, 2], range_bearing(pose[5], leader[0], CAR))
    R, delta = formation_rates(pose[:, None], leader[None, :3], np.arange(3.0), CAR)
    assert R.shape == (6, 3, 2, 2)
    assert delta.shape == (6, 3, 2)
    assert posture_error(np.zeros((0, 4)), leader[0]).shape == (0, 4)
    assert posture_error_rates(pose[:, None], leader[None, :3], CAR)[1].shape == (6, 3, 4, 2)


def test_rates_at_range_zero_are_not_a_number():
    R, delta = formation_rates([0.0, 0.0, 0.0, 0.0], [1.2, 0.0, 0.0, 0.0], 1.0, CAR)
    assert np.isnan(R).all()
    assert np.isnan(delta).all()


@given(angle=st.floats(-math.pi, math.pi), previous=st.floats(-100, 100))
def test_unwrapping_adds_whole_turns_and_stays_near(angle, previous):
    result = kinematics.unwrapped(angle, previous)
    turns = (result - angle) / (2 * math.pi)
    assert abs(turns - round(turns)) < 1e-12
    assert abs(result - previous) <= math.pi + 1e-12


def test_an_unwrapped_bearing_starts_near_the_desired_one_and_never_jumps():
    truth = np.linspace(3.0, 12.0, 200)[:, None] + np.array([0.0, 0.1, 2 * math.pi])
    jumping = np.arctan2(np.sin(truth), np.cos(truth))
    np.testing.assert_allclose(unwrapped_bearing(jumping, truth[0]), truth, atol=1e-12)
    np.testing.assert_array_equal(unwrapped_bearing(truth[:, 0], 3.0), truth[:, 0])  # nothing to do, no bit changed
    assert unwrapped_bearing(np.zeros((0, 3)), 1.0).shape == (0, 3)


def test_a_noisy_bearing_near_180_degrees_does_not_part_from_the_true_one():
    true, measured = np.full(5, math.pi - 1e-3), np.full(5, -math.pi + 1e-3)
    for desired in (2.0, -2.0):
        difference = unwrapped_bearing(true, desired) - unwrapped_bearing(measured, desired)
        np.testing.assert_allclose(difference, -2e-3, atol=1e-12)


@VEHICLES
@pytest.mark.parametrize("samples", [0, 1, 16, 53])
def test_courses_are_range_and_bearing_unwrapped_less_the_desired_place(vehicle, samples):
    random = np.random.default_rng(samples)
    pose = random.normal(size=(samples, 3, 1 + len(vehicle.pose)), scale=3.0)[..., : len(vehicle.pose)]
    leader, desired = random.normal(size=(samples, 5)), random.normal(size=(samples, 3, 2))
    pose[20:21, 1, 0], pose[30:31, 2, 2] = np.nan, 1e9  # beyond what is reduced in vectors
    whole = np.zeros((samples, 1, len(vehicle.pose)))
    whole[..., :3] = leader[:, None, :3]
    expected = range_bearing(pose, whole, vehicle)
    expected[..., 1] = unwrapped_bearing(expected[..., 1], desired[..., 1])
    courses = formation_courses(pose, leader, desired, vehicle)
    np.testing.assert_array_equal(courses[:2], expected.transpose(2, 1, 0))
    np.testing.assert_array_equal(courses[2:], (expected - desired).transpose(2, 1, 0))


def test_courses_of_other_shapes_are_refused():
    with pytest.raises(ControllerError, match=r"shapes \(5, 2, 4\), \(4, 4\), \(5, 2, 2\), which do not fit"):
        formation_courses(np.zeros((5, 2, 4)), np.zeros((4, 4)), np.zeros((5, 2, 2)), CAR)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"out": np.empty((4, 1, 1))}, r"out is float64 \(4, 1, 1\): expected an array of float64 \(4, 3, 5\)"),
        ({"out": np.empty((4, 5, 3))}, r"out is float64 \(4, 5, 3\)"),
        ({"out": np.empty((4, 3, 5), np.float32)}, r"out is float32 \(4, 3, 5\)"),
        ({"out": np.empty((4, 3, 5), ">f8")}, r"out is >f8 \(4, 3, 5\)"),
        ({"out": [[[0.0] * 5] * 3] * 4}, "out is list"),
        ({"out": np.broadcast_to(np.empty((4, 3, 1)), (4, 3, 5))}, "cannot be written to"),
        ({"before": np.zeros(1)}, r"before has shape \(1,\): expected \(3,\)"),
        ({"before": 0.0}, r"before has shape \(\): expected \(3,\)"),
        ({"before": ["0", "0", "0"]}, "before is not an array of numbers"),
        ({"pose": np.zeros((5, 3, 4), complex)}, "the pose is not an array of numbers"),
        ({"pose": 0.0}, "which do not fit"),
    ],
)
def test_arrays_that_compiled_code_would_leave_are_refused(given, message):
    arguments = {"pose": np.zeros((5, 3, 4)), "leader_pose": np.zeros((5, 4)), "desired": np.ones((5, 3, 2))}
    with pytest.raises(ControllerError, match=message):
        formation_courses(**arguments | given, vehicle=CAR)


def test_courses_are_filled_into_any_array_of_their_shape():
    pose, leader, desired = np.ones((5, 3, 4)), np.zeros((5, 4)), np.ones((5, 3, 2))
    expected = formation_courses(pose, leader, desired, CAR)
    for out in (np.zeros((4, 3, 5)), np.zeros((5, 3, 4)).T, np.zeros((8, 6, 10))[::-2, ::2, ::-2]):
        assert formation_courses(pose, leader, desired, CAR, out=out) is out
        np.testing.assert_array_equal(out, expected)
    lists = formation_courses(pose.tolist(), leader.tolist(), desired.tolist(), CAR, before=[0, 0, 0])
    np.testing.assert_array_equal(lists[0], expected[0])


def test_a_vehicle_whose_pose_is_too_short_for_its_formation_is_refused():
    class Short(CarLike):
        pose = CarLike.pose[:3]

    short, poses = Short(1.2), np.zeros((2, 3))
    for call in (
        lambda: posture_error(poses, poses, short),
        lambda: posture_error_rates(poses, poses, short),
        lambda: range_bearing(poses, poses, short),
        lambda: formation_rates(poses, poses, 0.0, short),
        lambda: input_matrix(poses, short),
    ):
        with pytest.raises(ControllerError, match="but its pose has no fourth entry"):
            call()


def test_all_that_a_vehicle_states_is_not_checked_at_each_call(monkeypatch):
    """Laws in Python call these functions at each tick, and that check takes longer than they do."""
    monkeypatch.setattr(kinematics, "vehicle_fault", None)
    assert range_bearing(np.zeros((2, 4)), np.zeros(4), CAR).shape == (2, 2)
    assert input_matrix(np.zeros((2, 4)), CAR).shape == (2, 2, 2)


def test_first_places_of_other_shapes_are_refused():
    for poses, desired in ((np.zeros((2, 4)), np.zeros(2)), (np.zeros(4), np.zeros((1, 2))), (np.zeros((2, 4)), 0.0)):
        with pytest.raises(ControllerError, match=r"expected \(N, 2\)"):
            first_range_bearing(poses, np.zeros(4), desired, CAR)


def test_bearings_without_time_or_with_another_shape_are_refused():
    with pytest.raises(ControllerError, match="the first one must be time"):
        unwrapped_bearing(1.0, 1.0)
    with pytest.raises(ControllerError, match=r"does not broadcast to \(5, 2\)"):
        unwrapped_bearing(np.zeros((5, 2)), np.zeros(3))


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(ControllerError, match=r"shape \(3,\): the last dimension must be 4"):
        posture_error(np.zeros(3), np.zeros(3))
    with pytest.raises(ControllerError, match=r"shape \(4,\): the last dimension must be 3"):
        range_bearing(np.zeros(4), np.zeros(4), DIFFERENTIAL)
    with pytest.raises(ControllerError, match="do not broadcast"):
        range_bearing(np.zeros((2, 4)), np.zeros((3, 4)), CAR)
    with pytest.raises(ControllerError, match="speed"):
        formation_rates(np.zeros((2, 4)), np.zeros(4), np.zeros(3), CAR)


@pytest.mark.parametrize("vehicle", [None, CarLike, "car_like"])
def test_a_vehicle_that_is_none_is_refused(vehicle):
    with pytest.raises(ControllerError, match=r"the vehicle is .*: expected one that states its formation"):
        range_bearing(np.zeros(4), np.zeros(4), vehicle)


@pytest.mark.parametrize("wheelbase", [0.0, -1.0, math.nan, math.inf])
def test_a_wheelbase_that_is_no_length_is_refused(wheelbase):
    with pytest.raises(ControllerError, match="wheelbase"):
        CarLike(wheelbase)


@pytest.mark.parametrize("lengths", [(0, 1, 1), (1, -1, 1), (1, 1, math.nan)])
def test_a_tractor_trailer_without_its_lengths_is_refused(lengths):
    with pytest.raises(ControllerError, match=r"the (hitch length|wheel radius|half track) is .* a positive length"):
        TractorTrailer(*lengths)


@pytest.mark.parametrize("lengths", [(0, 1), (1, -1), (math.inf, 1), (1, None)])
def test_a_differential_drive_without_its_lengths_is_refused(lengths):
    with pytest.raises(ControllerError, match=r"the (wheel radius|half track) is .* a positive length"):
        DifferentialDrive(*lengths)


def test_an_unknown_drive_is_refused_with_the_nearest():
    with pytest.raises(ControllerError, match=r"'front_weel'; did you mean 'front_wheel'"):
        CarLike(1.2, "front_weel")
