"""Formation geometry on arrays: the formulas of `kinematics` for any number of poses at once.

They serve every vehicle that states its `FormationGeometry`. A pose has the P entries of its vehicle's `pose`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from formation_controllers import kinematics
from formation_controllers.columns import BLOCK, columns, sin_cos_of
from formation_controllers.compiled import compiled, vectors_of_four
from formation_controllers.errors import ControllerError
from formation_controllers.input_checks import as_floats
from formation_controllers.interface import Floats
from formation_controllers.kinematics import UNKNOWN, Direction, Geometry, Pose, PostureError, geometry_of
from formation_controllers.vehicles import CarLike, Vehicle


def posture_error(pose: ArrayLike, leader_pose: ArrayLike, vehicle: Vehicle | None = None) -> Floats:
    """Posture error e in the follower's frame, (4); for the tractor-trailer in the trailer's.

    Parameters
    ----------
    pose, leader_pose
        Poses, shape (..., P); leading dimensions broadcast.
    vehicle
        The vehicle of followers and leader; if left out, one whose poses have four entries.

    Returns
    -------
    ndarray
        Shape (..., P).

    Raises
    ------
    ControllerError
        If the shapes do not fit, or the vehicle does not state its formation.
    """
    geometry = _FOUR if vehicle is None else geometry_of(vehicle)
    poses, leaders, shape = _pairs(pose, leader_pose, 4 if vehicle is None else len(vehicle.pose))
    e = np.zeros(poses.shape)
    _posture_error(poses, leaders, geometry, e)
    return e.reshape(*shape, poses.shape[-1])


def posture_error_rates(pose: ArrayLike, leader_pose: ArrayLike, vehicle: Vehicle) -> tuple[Floats, Floats]:
    """J and S of (6) and (53): e_dot = J (v, omega) + S (v_d, omega_d), which is (5).

    Parameters
    ----------
    pose, leader_pose
        Poses, shape (..., P); leading dimensions broadcast.
    vehicle
        The vehicle of followers and leader.

    Returns
    -------
    J, S : ndarray
        Shape (..., P, 2).

    Raises
    ------
    ControllerError
        If the shapes do not fit, or the vehicle does not state its formation.
    """
    geometry = geometry_of(vehicle)
    poses, leaders, shape = _pairs(pose, leader_pose, len(vehicle.pose))
    j, s = np.zeros((2, *poses.shape, 2))
    _posture_error_rates(poses, leaders, geometry, j, s)
    return j.reshape(*shape, -1, 2), s.reshape(*shape, -1, 2)


def range_bearing(pose: ArrayLike, leader_pose: ArrayLike, vehicle: Vehicle) -> Floats:
    """Virtual range [m] and bearing [rad] of followers with respect to the leader, q of (7) and (54).

    The bearing is atan2(e2, e1 - a) less the steering angle as it stands, so that it jumps where atan2 does: see
    `unwrapped_bearing`.

    Parameters
    ----------
    pose, leader_pose
        Poses, shape (..., P); leading dimensions broadcast.
    vehicle
        The followers' vehicle.

    Returns
    -------
    ndarray
        Shape (..., 2).

    Raises
    ------
    ControllerError
        If the shapes do not fit, or the vehicle does not state its formation.
    """
    geometry = geometry_of(vehicle)
    poses, leaders, shape = _pairs(pose, leader_pose, len(vehicle.pose))
    q = np.empty((len(poses), 2))
    _range_bearing(poses, leaders, geometry, q)
    return q.reshape(*shape, 2)


def unwrapped_bearing(bearing: ArrayLike, desired: ArrayLike) -> Floats:
    """Bearing without the jumps of atan2: a course in time to which whole turns are added.

    The first sample takes the turn nearest to the desired bearing, each other sample the turn nearest to the
    sample before it. Two courses of the same motion, one measured and one true, then differ by a turn only if
    the motion starts with a bearing error of 180 degrees, give or take the noise.

    Parameters
    ----------
    bearing
        Bearings (T, ...) [rad], the first dimension time.
    desired
        Desired bearings (T, ...) [rad], or anything that broadcasts to it; the first sample counts.

    Returns
    -------
    ndarray
        Shape (T, ...).

    Raises
    ------
    ControllerError
        If the shapes do not fit.
    """
    course = np.array(as_floats("the bearing", bearing), order="C")
    try:
        wanted = np.broadcast_to(as_floats("the desired bearing", desired), course.shape)
    except ValueError:
        raise ControllerError(f"the desired bearing does not broadcast to {course.shape}") from None
    if course.ndim == 0:
        raise ControllerError("the bearing has no dimension: the first one must be time")
    if course.size:
        _unwrap(course.reshape(len(course), -1), np.array(wanted[0]).ravel())
    return course


def formation_courses(
    pose: ArrayLike,
    leader_pose: ArrayLike,
    desired: ArrayLike,
    vehicle: Vehicle,
    before: ArrayLike | None = None,
    out: Floats | None = None,
) -> Floats:
    """Range, bearing and their errors of followers over time: `range_bearing`, unwrapped, less the desired place.

    Parameters
    ----------
    pose
        Poses (T, N, P) of the followers.
    leader_pose
        Position and heading (T, 3 or more) of the leader.
    desired
        Desired range and bearing (T, N, 2).
    vehicle
        The followers' vehicle.
    before
        Bearings (N,) at the sample before, for a later part of a course; without them the first bearings take the turns
        nearest to the desired ones.
    out
        Gets the courses: a writable array of doubles (4, N, T). Without it, a new array.

    Returns
    -------
    ndarray
        Shape (4, N, T): range [m], bearing [rad], their errors; the course of each is contiguous.

    Raises
    ------
    ControllerError
        If the shapes do not fit, `out` is no such array, or the vehicle does not state its formation.
    """
    geometry = geometry_of(vehicle)
    poses, leaders = as_floats("the pose", pose), as_floats("the leader's pose", leader_pose)
    places = as_floats("the desired place", desired)
    if (
        poses.shape != (*places.shape[:2], len(vehicle.pose))
        or places.shape[2:] != (2,)
        or leaders.ndim != 2
        or len(leaders) != len(poses)
        or leaders.shape[1] < 3
    ):
        shapes = ", ".join(str(array.shape) for array in (poses, leaders, places))
        raise ControllerError(f"poses, the leader's and desired places have shapes {shapes}, which do not fit")
    samples, size = poses.shape[:2]
    last = None if before is None else as_floats("before", before).copy()
    if last is not None and last.shape != (size,):
        raise ControllerError(f"before has shape {last.shape}: expected {(size,)}")
    courses = np.empty((4, size, samples)) if out is None else out
    if not (isinstance(courses, np.ndarray) and courses.dtype == float and courses.shape == (4, size, samples)):
        given = f"{courses.dtype} {courses.shape}" if isinstance(courses, np.ndarray) else type(courses).__name__
        raise ControllerError(f"out is {given}: expected an array of float64 {(4, size, samples)}")
    if not (courses.flags.writeable and courses.flags.aligned):
        raise ControllerError("out is an array that cannot be written to, or whose numbers are not aligned")
    if samples:
        last = places[0, :, 1].copy() if last is None else last
        _formation_courses(poses, leaders, places, last, geometry, columns(_COURSE)[0], courses)
    return courses


_COURSE = dict.fromkeys(
    ("x", "y", "heading", "other", "sin", "cos", "leader_x", "leader_y", "leader_heading", "range", "bearing"), ()
)
"""The columns of `_formation_courses`, samples side by side."""


def first_range_bearing(pose: ArrayLike, leader_pose: ArrayLike, desired: ArrayLike, vehicle: Vehicle) -> Floats:
    """Range [m] and bearing [rad] at time zero, the bearing on the turn nearest to the desired one.

    Parameters
    ----------
    pose, leader_pose, vehicle
        As for `range_bearing`.
    desired
        Desired range and bearing (N, 2).

    Returns
    -------
    ndarray
        Shape (N, 2).

    Raises
    ------
    ControllerError
        If the shapes do not fit, or the vehicle does not state its formation.
    """
    q = range_bearing(pose, leader_pose, vehicle)
    places = as_floats("the desired place", desired)
    if q.ndim != 2 or places.ndim != 2 or places.shape[1] != 2:
        raise ControllerError(
            f"range, bearing and desired places have shapes {q.shape}, {places.shape}: expected (N, 2)"
        )
    q[:, 1] = unwrapped_bearing(q[np.newaxis, :, 1], places[np.newaxis, :, 1])[0]
    return q


def formation_rates(
    pose: ArrayLike, leader_pose: ArrayLike, leader_speed: ArrayLike, vehicle: Vehicle
) -> tuple[Floats, Floats]:
    """R and delta of q_dot = R (v, omega) + delta, (8) and (55).

    Parameters
    ----------
    pose, leader_pose
        Poses, shape (..., P); leading dimensions broadcast.
    leader_speed
        v_d [m/s], broadcast to the leading dimensions.
    vehicle
        The followers' vehicle.

    Returns
    -------
    R : ndarray
        Shape (..., 2, 2); NaN where the range is zero.
    delta : ndarray
        Shape (..., 2); NaN where the range is zero.

    Raises
    ------
    ControllerError
        If the shapes do not fit, or the vehicle does not state its formation.
    """
    geometry = geometry_of(vehicle)
    poses, leaders, shape = _pairs(pose, leader_pose, len(vehicle.pose))
    try:
        speeds = np.ascontiguousarray(np.broadcast_to(as_floats("the leader's speed", leader_speed), shape)).ravel()
    except ValueError:
        raise ControllerError(f"the leader's speed does not broadcast to {shape}") from None
    r, delta = np.empty((len(poses), 4)), np.empty((len(poses), 2))
    _formation_rates(poses, leaders, speeds, geometry, r, delta)
    return r.reshape(*shape, 2, 2), delta.reshape(*shape, 2)


def input_matrix(pose: ArrayLike, vehicle: Vehicle) -> Floats:
    """B2 = S' B1 of (3): the effect of the torques on (v, omega).

    Parameters
    ----------
    pose
        Poses, shape (..., P).
    vehicle
        The vehicle, with its drive.

    Returns
    -------
    ndarray
        Shape (..., 2, 2).

    Raises
    ------
    ControllerError
        If the shape does not fit, or the vehicle does not state its `formation` and `torques`.
    """
    geometry = geometry_of(vehicle)
    if geometry.torques == UNKNOWN:
        raise ControllerError(f"the vehicle {vehicle!r} states no torques")
    poses, _, shape = _pairs(pose, pose, len(vehicle.pose))
    b = np.empty((len(poses), 4))
    _input_matrix(poses, geometry, b)
    return b.reshape(*shape, 2, 2)


_FOUR = geometry_of(CarLike(1.0))


def _pairs(pose: ArrayLike, leader_pose: ArrayLike, entries: int) -> tuple[Floats, Floats, tuple[int, ...]]:
    """Broadcast two arrays of poses; return them as (M, entries) and the leading shape."""
    a, b = as_floats("the pose", pose), as_floats("the leader's pose", leader_pose)
    try:
        a, b = np.broadcast_arrays(a, b)
    except ValueError:
        raise ControllerError(f"poses of shapes {a.shape} and {b.shape} do not broadcast") from None
    if a.shape[-1:] != (entries,):
        raise ControllerError(f"poses have shape {a.shape}: the last dimension must be {entries}")
    return a.reshape(-1, entries).copy(), b.reshape(-1, entries).copy(), a.shape[:-1]


@compiled
def _error(own: Pose, leader: Pose) -> PostureError:
    return kinematics.posture_error(own, kinematics.direction_of(own.heading), leader)


@compiled
def _posture_error(pose: Floats, leader_pose: Floats, vehicle: Geometry, e: Floats) -> None:
    for i in range(len(pose)):
        error = _error(kinematics.pose_of(pose[i], vehicle), kinematics.pose_of(leader_pose[i], vehicle))
        e[i, 0], e[i, 1], e[i, 2] = error.e_1, error.e_2, error.e_3
        if e.shape[1] > 3:
            e[i, 3] = error.e_4


@compiled
def _posture_error_rates(pose: Floats, leader_pose: Floats, vehicle: Geometry, j: Floats, s: Floats) -> None:
    for i in range(len(pose)):
        own, leader = kinematics.pose_of(pose[i], vehicle), kinematics.pose_of(leader_pose[i], vehicle)
        h = kinematics.steering_of(kinematics.steering_angle(own, vehicle))
        h_d = kinematics.steering_of(kinematics.steering_angle(leader, vehicle))
        kinematics.fill_posture_error_rates(_error(own, leader), h, h_d, vehicle, j[i], s[i])


@compiled
def _range_bearing(pose: Floats, leader_pose: Floats, vehicle: Geometry, q: Floats) -> None:
    for i in range(len(pose)):
        own = kinematics.pose_of(pose[i], vehicle)
        error = _error(own, kinematics.pose_of(leader_pose[i], vehicle))
        rho, phi = kinematics.line_of_sight(error.e_1, error.e_2, vehicle.ahead)
        q[i, 0], q[i, 1] = rho, phi - kinematics.steering_angle(own, vehicle)


@compiled
def _formation_courses(
    pose: Floats,
    leader_pose: Floats,
    desired: Floats,
    last: Floats,
    vehicle: Geometry,
    c: np.void,
    courses: Floats,
) -> None:
    vectors_of_four()
    for i in range(pose.shape[1]):
        before = last[i]
        for first in range(0, len(pose), BLOCK):
            count = min(BLOCK, len(pose) - first)
            for r in range(count):
                own = kinematics.pose_of(pose[first + r, i], vehicle)
                c["x"][r], c["y"][r], c["heading"][r], c["other"][r] = own
                c["leader_x"][r], c["leader_y"][r] = leader_pose[first + r, 0], leader_pose[first + r, 1]
                c["leader_heading"][r] = leader_pose[first + r, 2]
            sin_cos_of(c["heading"], c["sin"], c["cos"], count)
            for r in range(count):
                own = Pose(c["x"][r], c["y"][r], c["heading"][r], c["other"][r])
                leader = Pose(c["leader_x"][r], c["leader_y"][r], c["leader_heading"][r], 0.0)
                error = kinematics.posture_error(own, Direction(c["sin"][r], c["cos"][r]), leader)
                c["range"][r], phi = kinematics.line_of_sight(error.e_1, error.e_2, vehicle.ahead)
                c["bearing"][r] = phi - kinematics.steering_angle(own, vehicle)
            turns, previous = 0, before
            for r in range(count):
                ahead = c["bearing"][r] - previous + math.pi
                turns += not 0.0 <= ahead <= 6.28  # less than a turn
                previous = c["bearing"][r]
            if turns > 0:  # seldom, and one after the other
                previous = before
                for r in range(count):
                    previous = c["bearing"][r] = kinematics.unwrapped(c["bearing"][r], previous)
            before = previous
            for r in range(count):
                k = first + r
                courses[0, i, k], courses[1, i, k] = c["range"][r], c["bearing"][r]
                courses[2, i, k] = c["range"][r] - desired[k, i, 0]
                courses[3, i, k] = c["bearing"][r] - desired[k, i, 1]


@compiled
def _unwrap(bearing: Floats, desired: Floats) -> None:
    for i in range(bearing.shape[1]):
        before = desired[i]
        for k in range(bearing.shape[0]):
            bearing[k, i] = before = kinematics.unwrapped(bearing[k, i], before)


@compiled
def _formation_rates(
    pose: Floats, leader_pose: Floats, v_d: Floats, vehicle: Geometry, r: Floats, delta: Floats
) -> None:
    for i in range(len(pose)):
        own = kinematics.pose_of(pose[i], vehicle)
        error = _error(own, kinematics.pose_of(leader_pose[i], vehicle))
        rho, phi = kinematics.line_of_sight(error.e_1, error.e_2, vehicle.ahead)
        h = kinematics.steering_of(kinematics.steering_angle(own, vehicle))
        R = kinematics.rate_matrix(rho, kinematics.direction_of(phi), h, vehicle)
        r[i, 0], r[i, 1], r[i, 2], r[i, 3] = R.m_11, R.m_12, R.m_21, R.m_22
        delta[i, 0], delta[i, 1] = kinematics.leader_rates(rho, kinematics.direction_of(error.e_3 - phi), v_d[i])


@compiled
def _input_matrix(pose: Floats, vehicle: Geometry, b: Floats) -> None:
    for i in range(len(pose)):
        own = kinematics.pose_of(pose[i], vehicle)
        h = kinematics.steering_of(kinematics.steering_angle(own, vehicle))
        B2 = kinematics.input_matrix(kinematics.direction_of(own.heading), h, vehicle)
        b[i, 0], b[i, 1], b[i, 2], b[i, 3] = B2.m_11, B2.m_12, B2.m_21, B2.m_22
