"""Posture error, range and bearing and their rates for one robot: equations (4) to (8) and (53) to (55), compiled.

Everything that depends on the kind of vehicle is here and in `dynamics`. The *steering angle* of the laws is
gamma for a car-like robot and theta_0 - theta_1 for a tractor-trailer; the *length* is the wheelbase a or the
hitch length d.

Sketch of (7) and (54), seen from above; the body that the pose's third entry is the heading of, with its axle at
the origin of its frame and the leader at (e1, e2)::

        y_B                    leader
         |                   *
         |        rho   *
         |         *   ) phi           bearing = phi - steering angle
        axle ----- + ------- x_B       +: front axle of the car-like robot,
           length                         axle of the tractor
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from formation_controllers.compiled import compiled
from formation_controllers.errors import ControllerError
from formation_controllers.interface import Floats
from formation_controllers.vehicles import DRIVES, CarLike, TractorTrailer, Vehicle

VEHICLE: Final = np.dtype(
    [("kind", np.int64), ("drive", np.int64), ("length", float), ("wheel_radius", float), ("half_track", float)]
)
"""A vehicle as compiled code sees it: kind, index into `DRIVES`, lengths [m]."""

CAR_LIKE: Final = 0
TRACTOR_TRAILER: Final = 1

AS_PRINTED: Final = DRIVES.index("as_printed")
FRONT_WHEEL: Final = DRIVES.index("front_wheel")


def vehicle_record(vehicle: Vehicle) -> NDArray[np.void]:
    """Return a vehicle as a `VEHICLE` array of length 1; what is none is refused."""
    if isinstance(vehicle, TractorTrailer):
        record = (TRACTOR_TRAILER, 0, vehicle.hitch_length, vehicle.wheel_radius, vehicle.half_track)
    elif isinstance(vehicle, CarLike):
        record = (CAR_LIKE, DRIVES.index(vehicle.drive), vehicle.wheelbase, 0.0, 0.0)
    else:
        raise ControllerError(f"the vehicle is {vehicle!r}: expected a CarLike or a TractorTrailer")
    return np.array([record], dtype=VEHICLE)


@compiled
def steering_angle(pose: Floats, vehicle: np.void) -> float:
    """Return gamma of a car-like robot's pose, theta_0 - theta_1 of a tractor-trailer's [rad]."""
    if vehicle["kind"] == TRACTOR_TRAILER:
        return pose[3] - pose[2]  # type: ignore[no-any-return]
    return pose[3]  # type: ignore[no-any-return]


@compiled
def posture_error(pose: Floats, leader_pose: Floats) -> tuple[float, float, float, float]:
    """Posture error e in the robot's frame, (4)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = leader_pose[0] - pose[0], leader_pose[1] - pose[1]
    return c * dx + s * dy, c * dy - s * dx, leader_pose[2] - pose[2], leader_pose[3] - pose[3]


@compiled
def posture_error_rates(
    e_1: float, e_2: float, e_3: float, steering: float, leader_steering: float, length: float
) -> tuple[float, float, float, float, float, float]:
    """J and S of (6) and (53), e_dot = J (v, omega) + S (v_d, omega_d): upper three of their first columns.

    The fourth of these is zero; the second columns are (0, 0, 0, -1) and (0, 0, 0, 1).
    """
    t, t_d = math.tan(steering) / length, math.tan(leader_steering) / length
    return -1.0 + e_2 * t, -e_1 * t, -t, math.cos(e_3), math.sin(e_3), t_d


@compiled
def line_of_sight(e_1: float, e_2: float, length: float) -> tuple[float, float]:
    """Range rho and polar angle phi of the leader, (7) and (54); the bearing is phi less the steering angle."""
    ahead = e_1 - length
    return math.sqrt(ahead * ahead + e_2 * e_2), math.atan2(e_2, ahead)


@compiled
def unwrapped(angle: float, previous: float) -> float:
    """Return the angle plus the multiple of 2 pi that brings it within pi of the previous one."""
    return angle - 2 * math.pi * math.floor((angle - previous + math.pi) / (2 * math.pi))


@compiled
def rate_matrix(rho: float, phi: float, steering: float, vehicle: np.void) -> tuple[float, float, float, float]:
    """R of (8) or (55), row by row: what (v, omega) do to range and bearing. NaN at range zero.

    The body turns with v tan(steering)/length, by which phi falls. The car-like robot's bearing falls with it:
    gamma is steered against the body. The tractor-trailer's does not: as theta_1 grows by as much as phi falls,
    phi + theta_1 - theta_0 stays, and (55) has rightly no such term.

    The determinant is cos(bearing)/cos(steering) for both: singular at a bearing of 90 degrees.
    """
    if rho == 0.0:
        return math.nan, math.nan, math.nan, math.nan
    c, s, t = math.cos(phi), math.sin(phi), math.tan(steering)
    turn = t / vehicle["length"] if vehicle["kind"] == CAR_LIKE else 0.0
    return -c - s * t, 0.0, (s - c * t) / rho - turn, -1.0


@compiled
def rate_matrix_dot(
    rho: float, phi: float, steering: float, rho_dot: float, phi_dot: float, steering_dot: float, vehicle: np.void
) -> tuple[float, float]:
    """Time derivative of the first column of R, (8) or (55); the second column is constant. NaN at range zero."""
    if rho == 0.0:
        return math.nan, math.nan
    c, s, t = math.cos(phi), math.sin(phi), math.tan(steering)
    t_dot = steering_dot * (1.0 + t * t)
    turn_dot = t_dot / vehicle["length"] if vehicle["kind"] == CAR_LIKE else 0.0
    return (
        (s - c * t) * phi_dot - s * t_dot,
        ((c + s * t) * phi_dot - c * t_dot - (s - c * t) / rho * rho_dot) / rho - turn_dot,
    )


@compiled
def leader_rates(rho: float, phi: float, e_3: float, v_d: float) -> tuple[float, float]:
    """Delta of (8) and (55): what the leader's motion does to range and bearing. NaN at range zero."""
    if rho == 0.0:
        return math.nan, math.nan
    return v_d * math.cos(e_3 - phi), v_d * math.sin(e_3 - phi) / rho


@compiled
def leader_rates_dot(
    rho: float, phi: float, e_3: float, v_d: float, rho_dot: float, phi_dot: float, e_3_dot: float, v_d_dot: float
) -> tuple[float, float]:
    """Time derivative of delta, (8) and (55). NaN at range zero."""
    if rho == 0.0:
        return math.nan, math.nan
    c, s, turn = math.cos(e_3 - phi), math.sin(e_3 - phi), e_3_dot - phi_dot
    return v_d_dot * c - v_d * s * turn, (v_d_dot * s + v_d * c * turn - v_d * s / rho * rho_dot) / rho


@compiled
def input_matrix(heading: float, steering: float, vehicle: np.void) -> tuple[float, float, float, float]:
    """B2 = S' B1 of (3), row by row: what the torques do to (v, omega). The heading is the pose's third entry.

    For the car-like robot, (56), it is diagonal, with 1 + tan(gamma) sin(psi) as printed, 1/cos(gamma) with
    front-wheel drive and 1 with rear-wheel drive as its (1, 1) entry. For the tractor-trailer, (57), the columns are
    the right and the left wheel.
    """
    if vehicle["kind"] == TRACTOR_TRAILER:
        r = vehicle["wheel_radius"]
        pull, turn = 1.0 / (r * math.cos(steering)), vehicle["half_track"] / r
        return pull, pull, turn, -turn
    if vehicle["drive"] == AS_PRINTED:
        return 1.0 + math.tan(steering) * math.sin(heading), 0.0, 0.0, 1.0
    if vehicle["drive"] == FRONT_WHEEL:
        return 1.0 / math.cos(steering), 0.0, 0.0, 1.0
    return 1.0, 0.0, 0.0, 1.0


@compiled
def solve_2x2(a_11: float, a_12: float, a_21: float, a_22: float, b_1: float, b_2: float) -> tuple[float, float]:
    """Solve A x = b by Cramer's rule; NaN if A is singular."""
    det = a_11 * a_22 - a_12 * a_21
    if det == 0.0:
        return math.nan, math.nan
    return (a_22 * b_1 - a_12 * b_2) / det, (a_11 * b_2 - a_21 * b_1) / det
