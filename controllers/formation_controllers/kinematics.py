"""Posture error, range and bearing and their rates for one robot: equations (4) to (8) and (53) to (55), compiled.

The formulas take a vehicle's facts from its `Geometry`; no kind is named. The *steering angle* h of the laws is gamma
for a car-like robot, theta_0 - theta_1 for a tractor-trailer, and zero for a differential-drive robot; the *length* is
the wheelbase a or the hitch length d.

Sketch of (7) and (54), seen from above; the body that the pose's third entry is the heading of, with its axle at
the origin of its frame and the leader at (e1, e2)::

        y_B                    leader
         |                   *
         |        rho   *
         |         *   ) phi           bearing = phi - steering angle
        axle ----- + ------- x_B       +: front axle of the car-like robot,
           length                         axle of the tractor

A differential-drive robot sees the leader from its axle (+ is at the origin), and its body turns with omega itself:
e1' = -v + e2 omega + v_d cos e3, e2' = -e1 omega + v_d sin e3, e3' = omega_d - omega. So with bearing = phi

    rho'     = -v cos(phi) + v_d cos(e3 - phi)
    bearing' = (v sin(phi) + v_d sin(e3 - phi))/rho - omega

which is (55) with a steering angle of zero, and det R = cos(bearing).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from formation_controllers.compiled import part
from formation_controllers.elementary import atan2, floor, sin_cos, sin_cos_tan, sqrt
from formation_controllers.errors import ControllerError
from formation_controllers.interface import Floats
from formation_controllers.vehicles import STEERINGS, TORQUE_FORMS, Vehicle, formation_of, torques_of, vehicle_fault

STEERS_NOT: Final = STEERINGS.index("none")
BY_ANGLE: Final = STEERINGS.index("angle")
BY_HEADING: Final = STEERINGS.index("heading")
"""How a vehicle steers."""

UNKNOWN: Final = -1
AS_PRINTED: Final = TORQUE_FORMS.index("as_printed")
FRONT_WHEEL: Final = TORQUE_FORMS.index("front_wheel")
REAR_WHEEL: Final = TORQUE_FORMS.index("rear_wheel")
WHEELS: Final = TORQUE_FORMS.index("wheels")
"""Which torques a vehicle takes."""


class Geometry(NamedTuple):
    """A vehicle for compiled code.

    Attributes
    ----------
    steering : int
        Index into `STEERINGS`.
    length : float
        Wheelbase, hitch length or another length that a range is compared with [m].
    ahead : float
        Distance from the reference point ahead to where range and bearing are measured from [m].
    torques : int
        Index into `TORQUE_FORMS`; `UNKNOWN` if the vehicle does not state their effect.
    wheel_radius, half_track : float
        Of the wheels [m].
    """

    steering: int
    length: float
    ahead: float
    torques: int
    wheel_radius: float
    half_track: float


class Pose(NamedTuple):
    """A pose; its fourth entry, gamma or theta_0, is zero where nothing steers."""

    x: float
    y: float
    heading: float
    other: float


class Direction(NamedTuple):
    """Sine and cosine of an angle: worked out once, as they cost more than the rest of a formula."""

    sin: float
    cos: float


class PostureError(NamedTuple):
    """Posture error e in the robot's frame, (4); the fourth entry is zero where a pose has none."""

    e_1: float
    e_2: float
    e_3: float
    e_4: float


class Steering(NamedTuple):
    """A steering angle h, its tangent and its cosine."""

    angle: float
    tan: float
    cos: float


class Matrix(NamedTuple):
    """A 2 x 2 matrix, row by row."""

    m_11: float
    m_12: float
    m_21: float
    m_22: float


def geometry_of(vehicle: Vehicle) -> Geometry:
    """Return a vehicle for compiled code; refuse one that does not state its formation."""
    formation, torques = formation_of(vehicle), torques_of(vehicle)
    if isinstance(vehicle, type) or formation is None:
        raise ControllerError(f"the vehicle is {vehicle!r}: expected one that states its formation, such as a CarLike")
    # Compiled code reads as many entries of a pose as the formation needs. All that a vehicle states costs too much
    # to check for a law in Python, which asks at each tick.
    pose = getattr(vehicle, "pose", None)
    if not isinstance(pose, tuple) or len(pose) < (3 if formation.steering == "none" else 4):
        raise ControllerError(f"the vehicle is {vehicle!r}: {vehicle_fault(vehicle)}")
    length = float(formation.length)
    return Geometry(
        STEERINGS.index(formation.steering),
        length,
        0.0 if formation.steering == "none" else length,
        UNKNOWN if torques is None else TORQUE_FORMS.index(torques.form),
        1.0 if torques is None else float(torques.wheel_radius),
        1.0 if torques is None else float(torques.half_track),
    )


@part
def pose_of(pose: Floats, vehicle: Geometry) -> Pose:
    """Return a pose that is given as an array."""
    return Pose(pose[0], pose[1], pose[2], 0.0 if vehicle.steering == STEERS_NOT else pose[3])


@part
def direction_of(angle: float) -> Direction:
    """Return an angle's sine and cosine."""
    s, c = sin_cos(angle)
    return Direction(s, c)


@part
def steering_angle(pose: Pose, vehicle: Geometry) -> float:
    """Return h of a pose: gamma of a car-like robot, theta_0 - theta_1 of a tractor-trailer [rad]."""
    if vehicle.steering == BY_HEADING:
        return pose.other - pose.heading
    return pose.other


@part
def steering_of(angle: float) -> Steering:
    """Return a steering angle with its tangent and cosine."""
    _, c, t = sin_cos_tan(angle)
    return Steering(angle, t, c)


@part
def body_turn(v: float, omega: float, h: Steering, vehicle: Geometry) -> float:
    """Return the rate of the pose's third entry, the body's heading [rad/s]."""
    if vehicle.steering == STEERS_NOT:
        return omega
    return v * h.tan / vehicle.length


@part
def steering_rate(omega: float, turn: float, vehicle: Geometry) -> float:
    """Return the rate of the steering angle h, given the body's turn [rad/s]."""
    if vehicle.steering == BY_ANGLE:
        return omega
    return omega - turn


@part
def posture_error(pose: Pose, heading: Direction, leader: Pose) -> PostureError:
    """Posture error e in the robot's frame, (4)."""
    s, c = heading
    dx, dy = leader.x - pose.x, leader.y - pose.y
    return PostureError(c * dx + s * dy, c * dy - s * dx, leader.heading - pose.heading, leader.other - pose.other)


@part
def fill_posture_error_rates(
    error: PostureError, h: Steering, leader_h: Steering, vehicle: Geometry, J: Floats, S: Floats
) -> None:
    """Fill J and S of (6) and (53), e_dot = J (v, omega) + S (v_d, omega_d); other entries stay zero."""
    J[0, 0] = -1.0
    S[1, 0], S[0, 0] = sin_cos(error.e_3)
    if vehicle.steering == STEERS_NOT:
        J[0, 1], J[1, 1], J[2, 1] = error.e_2, -error.e_1, -1.0
        S[2, 1] = 1.0
        return
    t, t_d = h.tan / vehicle.length, leader_h.tan / vehicle.length
    J[0, 0], J[1, 0], J[2, 0], J[3, 1] = -1.0 + error.e_2 * t, -error.e_1 * t, -t, -1.0
    S[2, 0], S[3, 1] = t_d, 1.0


@part
def line_of_sight(e_1: float, e_2: float, ahead: float) -> tuple[float, float]:
    """Range rho and polar angle phi of the leader, (7) and (54); the bearing is phi less the steering angle."""
    forward = e_1 - ahead
    return sqrt(forward * forward + e_2 * e_2), atan2(e_2, forward)


@part
def unwrapped(angle: float, previous: float) -> float:
    """Return the angle plus the multiple of 2 pi that brings it within pi of the previous one."""
    return angle - 2 * math.pi * floor((angle - previous + math.pi) / (2 * math.pi))


@part
def rate_matrix(rho: float, phi: Direction, h: Steering, vehicle: Geometry) -> Matrix:
    """R of (8) or (55): the effect of (v, omega) on range and bearing. NaN at range zero.

    The body turns with v tan(steering)/length, by which phi falls. The car-like robot's bearing falls with it:
    gamma is steered against the body. The tractor-trailer's does not: as theta_1 grows by as much as phi falls,
    phi + theta_1 - theta_0 stays, and (55) has rightly no such term.

    The determinant is cos(bearing)/cos(steering) for all vehicles: singular at a bearing of 90 degrees.
    """
    if rho == 0.0:
        return Matrix(math.nan, math.nan, math.nan, math.nan)
    s, c = phi
    t = h.tan
    turn = t / vehicle.length if vehicle.steering == BY_ANGLE else 0.0
    return Matrix(-c - s * t, 0.0, (s - c * t) / rho - turn, -1.0)


@part
def rate_matrix_dot(
    rho: float, phi: Direction, h: Steering, rho_dot: float, phi_dot: float, steering_dot: float, vehicle: Geometry
) -> tuple[float, float]:
    """Time derivative of the first column of R, (8) or (55); the second column is constant. NaN at range zero."""
    if rho == 0.0:
        return math.nan, math.nan
    s, c = phi
    t = h.tan
    t_dot = steering_dot * (1.0 + t * t)
    turn_dot = t_dot / vehicle.length if vehicle.steering == BY_ANGLE else 0.0
    return (
        (s - c * t) * phi_dot - s * t_dot,
        ((c + s * t) * phi_dot - c * t_dot - (s - c * t) / rho * rho_dot) / rho - turn_dot,
    )


@part
def leader_rates(rho: float, course: Direction, v_d: float) -> tuple[float, float]:
    """Delta of (8) and (55): the effect of the leader's motion on range and bearing. NaN at range zero.

    The course is e_3 - phi, the leader's heading seen along the line of sight.
    """
    if rho == 0.0:
        return math.nan, math.nan
    s, c = course
    return v_d * c, v_d * s / rho


@part
def leader_rates_dot(
    rho: float, course: Direction, v_d: float, rho_dot: float, course_dot: float, v_d_dot: float
) -> tuple[float, float]:
    """Time derivative of delta, (8) and (55). NaN at range zero."""
    if rho == 0.0:
        return math.nan, math.nan
    s, c = course
    return (
        v_d_dot * c - v_d * s * course_dot,
        (v_d_dot * s + v_d * c * course_dot - v_d * s / rho * rho_dot) / rho,
    )


@part
def input_matrix(heading: Direction, h: Steering, vehicle: Geometry) -> Matrix:
    """B2 = S' B1 of (3): torques on (v, omega). The heading is the pose's third entry. NaN if not stated.

    For the car-like robot, (56), it is diagonal, with 1 + tan(gamma) sin(psi) as printed, 1/cos(gamma) with
    front-wheel drive and 1 with rear-wheel drive as its (1, 1) entry. For the tractor-trailer, (57), and for the
    differential-drive robot, whose steering angle is zero, the columns are the right and the left wheel.
    """
    if vehicle.torques == WHEELS:
        r = vehicle.wheel_radius
        pull, turn = 1.0 / (r * h.cos), vehicle.half_track / r
        return Matrix(pull, pull, turn, -turn)
    if vehicle.torques == AS_PRINTED:
        return Matrix(1.0 + h.tan * heading.sin, 0.0, 0.0, 1.0)
    if vehicle.torques == FRONT_WHEEL:
        return Matrix(1.0 / h.cos, 0.0, 0.0, 1.0)
    if vehicle.torques == REAR_WHEEL:
        return Matrix(1.0, 0.0, 0.0, 1.0)
    return Matrix(math.nan, math.nan, math.nan, math.nan)


@part
def solve_2x2(a: Matrix, b_1: float, b_2: float) -> tuple[float, float]:
    """Solve A x = b by Cramer's rule; NaN if A is singular."""
    det = a.m_11 * a.m_22 - a.m_12 * a.m_21
    if det == 0.0:
        return math.nan, math.nan
    return (a.m_22 * b_1 - a.m_12 * b_2) / det, (a.m_11 * b_2 - a.m_21 * b_1) / det
