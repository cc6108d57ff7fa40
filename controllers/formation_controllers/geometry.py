"""Formation geometry on arrays: the formulas of `kinematics` for any number of poses at once.

A pose has the components that its vehicle's `pose_components` name.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from formation_controllers import kinematics
from formation_controllers.compiled import compiled
from formation_controllers.errors import ControllerError
from formation_controllers.interface import Floats
from formation_controllers.kinematics import vehicle_record
from formation_controllers.vehicles import Vehicle


def posture_error(pose: ArrayLike, leader_pose: ArrayLike) -> Floats:
    """Posture error e in the follower's frame, (4); for the tractor-trailer in the trailer's.

    Parameters
    ----------
    pose, leader_pose
        Poses [m, m, rad, rad], shape (..., 4); leading dimensions broadcast.

    Returns
    -------
    ndarray
        Shape (..., 4).

    Raises
    ------
    ControllerError
        If the shapes do not fit.
    """
    poses, leaders, shape = _pairs(pose, leader_pose)
    e = np.empty((len(poses), 4))
    _posture_error(poses, leaders, e)
    return e.reshape(*shape, 4)


def posture_error_rates(pose: ArrayLike, leader_pose: ArrayLike, vehicle: Vehicle) -> tuple[Floats, Floats]:
    """J and S of (6) and (53): e_dot = J (v, omega) + S (v_d, omega_d), which is (5).

    Parameters
    ----------
    pose, leader_pose
        Poses [m, m, rad, rad], shape (..., 4); leading dimensions broadcast.
    vehicle
        The vehicle of followers and leader.

    Returns
    -------
    J, S : ndarray
        Shape (..., 4, 2).

    Raises
    ------
    ControllerError
        If the shapes do not fit.
    """
    poses, leaders, shape = _pairs(pose, leader_pose)
    j, s = np.zeros((2, len(poses), 4, 2))
    j[:, 3, 1], s[:, 3, 1] = -1.0, 1.0
    _posture_error_rates(poses, leaders, vehicle_record(vehicle), j, s)
    return j.reshape(*shape, 4, 2), s.reshape(*shape, 4, 2)


def range_bearing(pose: ArrayLike, leader_pose: ArrayLike, vehicle: Vehicle) -> Floats:
    """Virtual range [m] and bearing [rad] of followers with respect to the leader, q of (7) and (54).

    The bearing is atan2(e2, e1 - a) less the steering angle as it stands, so that it jumps where atan2 does: see
    `unwrapped_bearing`.

    Parameters
    ----------
    pose, leader_pose
        Poses [m, m, rad, rad], shape (..., 4); leading dimensions broadcast.
    vehicle
        The followers' vehicle.

    Returns
    -------
    ndarray
        Shape (..., 2).

    Raises
    ------
    ControllerError
        If the shapes do not fit.
    """
    poses, leaders, shape = _pairs(pose, leader_pose)
    q = np.empty((len(poses), 2))
    _range_bearing(poses, leaders, vehicle_record(vehicle), q)
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
    course = np.array(bearing, dtype=float, order="C")
    try:
        wanted = np.broadcast_to(np.asarray(desired, dtype=float), course.shape)
    except ValueError:
        raise ControllerError(f"the desired bearing does not broadcast to {course.shape}") from None
    if course.ndim == 0:
        raise ControllerError("the bearing has no dimension: the first one must be time")
    if course.size:
        _unwrap(course.reshape(len(course), -1), np.array(wanted[0]).ravel())
    return course


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
        If the shapes do not fit.
    """
    q = range_bearing(pose, leader_pose, vehicle)
    q[:, 1] = unwrapped_bearing(q[np.newaxis, :, 1], np.asarray(desired)[np.newaxis, :, 1])[0]
    return q


def formation_rates(
    pose: ArrayLike, leader_pose: ArrayLike, leader_speed: ArrayLike, vehicle: Vehicle
) -> tuple[Floats, Floats]:
    """R and delta of q_dot = R (v, omega) + delta, (8) and (55).

    Parameters
    ----------
    pose, leader_pose
        Poses [m, m, rad, rad], shape (..., 4); leading dimensions broadcast.
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
        If the shapes do not fit.
    """
    poses, leaders, shape = _pairs(pose, leader_pose)
    try:
        speeds = np.ascontiguousarray(np.broadcast_to(np.asarray(leader_speed, dtype=float), shape)).ravel()
    except ValueError:
        raise ControllerError(f"the leader's speed does not broadcast to {shape}") from None
    r, delta = np.empty((len(poses), 4)), np.empty((len(poses), 2))
    _formation_rates(poses, leaders, speeds, vehicle_record(vehicle), r, delta)
    return r.reshape(*shape, 2, 2), delta.reshape(*shape, 2)


def input_matrix(pose: ArrayLike, vehicle: Vehicle) -> Floats:
    """B2 = S' B1 of (3): what the torques do to (v, omega).

    Parameters
    ----------
    pose
        Poses [m, m, rad, rad], shape (..., 4).
    vehicle
        The vehicle, with its drive.

    Returns
    -------
    ndarray
        Shape (..., 2, 2).

    Raises
    ------
    ControllerError
        If the shape does not fit.
    """
    poses, _, shape = _pairs(pose, pose)
    b = np.empty((len(poses), 4))
    _input_matrix(poses, vehicle_record(vehicle), b)
    return b.reshape(*shape, 2, 2)


def _pairs(pose: ArrayLike, leader_pose: ArrayLike) -> tuple[Floats, Floats, tuple[int, ...]]:
    """Broadcast two arrays of poses; return them as (M, 4) and the leading shape."""
    a, b = np.asarray(pose, dtype=float), np.asarray(leader_pose, dtype=float)
    try:
        a, b = np.broadcast_arrays(a, b)
    except ValueError:
        raise ControllerError(f"poses of shapes {a.shape} and {b.shape} do not broadcast") from None
    if a.shape[-1:] != (4,):
        raise ControllerError(f"poses have shape {a.shape}: the last dimension must be 4")
    return a.reshape(-1, 4).copy(), b.reshape(-1, 4).copy(), a.shape[:-1]


@compiled
def _posture_error(pose: Floats, leader_pose: Floats, e: Floats) -> None:
    for i in range(len(pose)):
        e[i, 0], e[i, 1], e[i, 2], e[i, 3] = kinematics.posture_error(pose[i], leader_pose[i])


@compiled
def _posture_error_rates(pose: Floats, leader_pose: Floats, vehicle: NDArray[np.void], j: Floats, s: Floats) -> None:
    for i in range(len(pose)):
        e_1, e_2, e_3, _ = kinematics.posture_error(pose[i], leader_pose[i])
        h, h_d = kinematics.steering_angle(pose[i], vehicle[0]), kinematics.steering_angle(leader_pose[i], vehicle[0])
        j[i, 0, 0], j[i, 1, 0], j[i, 2, 0], s[i, 0, 0], s[i, 1, 0], s[i, 2, 0] = kinematics.posture_error_rates(
            e_1, e_2, e_3, h, h_d, vehicle[0]["length"]
        )


@compiled
def _range_bearing(pose: Floats, leader_pose: Floats, vehicle: NDArray[np.void], q: Floats) -> None:
    for i in range(len(pose)):
        e_1, e_2, _, _ = kinematics.posture_error(pose[i], leader_pose[i])
        rho, phi = kinematics.line_of_sight(e_1, e_2, vehicle[0]["length"])
        q[i, 0], q[i, 1] = rho, phi - kinematics.steering_angle(pose[i], vehicle[0])


@compiled
def _unwrap(bearing: Floats, desired: Floats) -> None:
    for i in range(bearing.shape[1]):
        before = desired[i]
        for k in range(bearing.shape[0]):
            bearing[k, i] = before = kinematics.unwrapped(bearing[k, i], before)


@compiled
def _formation_rates(
    pose: Floats, leader_pose: Floats, v_d: Floats, vehicle: NDArray[np.void], r: Floats, delta: Floats
) -> None:
    for i in range(len(pose)):
        e_1, e_2, e_3, _ = kinematics.posture_error(pose[i], leader_pose[i])
        rho, phi = kinematics.line_of_sight(e_1, e_2, vehicle[0]["length"])
        steering = kinematics.steering_angle(pose[i], vehicle[0])
        r[i, 0], r[i, 1], r[i, 2], r[i, 3] = kinematics.rate_matrix(rho, phi, steering, vehicle[0])
        delta[i, 0], delta[i, 1] = kinematics.leader_rates(rho, phi, e_3, v_d[i])


@compiled
def _input_matrix(pose: Floats, vehicle: NDArray[np.void], b: Floats) -> None:
    for i in range(len(pose)):
        steering = kinematics.steering_angle(pose[i], vehicle[0])
        b[i, 0], b[i, 1], b[i, 2], b[i, 3] = kinematics.input_matrix(pose[i, 2], steering, vehicle[0])
