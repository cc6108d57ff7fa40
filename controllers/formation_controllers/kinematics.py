"""Posture error, range and bearing and their rates for one robot: equations (4) to (8), compiled.

Everything that depends on the kind of vehicle is here. The steering angle of the laws is gamma for a car-like
robot.

Sketch of (7), seen from above; the robot's rear axle is at the origin of its body frame, the leader at (e1,
e2)::

        y_B                    leader
         |                   *
         |        rho   *
         |         *   ) phi           bearing = phi - gamma
       rear ------ front ------ x_B
             a
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from formation_controllers.compiled import compiled
from formation_controllers.interface import Floats
from formation_controllers.vehicles import DRIVES, Vehicle

VEHICLE: Final = np.dtype([("length", float), ("drive", np.int64)])
"""A vehicle as compiled code sees it: wheelbase a [m] and index into `DRIVES`."""

AS_PRINTED: Final = DRIVES.index("as_printed")
FRONT_WHEEL: Final = DRIVES.index("front_wheel")


def vehicle_record(vehicle: Vehicle) -> NDArray[np.void]:
    """Return a vehicle as a `VEHICLE` array of length 1."""
    return np.array([(vehicle.wheelbase, DRIVES.index(vehicle.drive))], dtype=VEHICLE)


@compiled
def steering_angle(pose: Floats) -> float:
    """Return gamma [rad] of a pose (x, y, psi, gamma)."""
    return pose[3]  # type: ignore[no-any-return]


@compiled
def posture_error(pose: Floats, leader_pose: Floats) -> tuple[float, float, float, float]:
    """Posture error e in the robot's frame, (4)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = leader_pose[0] - pose[0], leader_pose[1] - pose[1]
    return c * dx + s * dy, c * dy - s * dx, leader_pose[2] - pose[2], leader_pose[3] - pose[3]


@compiled
def line_of_sight(e_1: float, e_2: float, length: float) -> tuple[float, float]:
    """Range rho and polar angle phi of the leader, seen from the front axle, (7); bearing: phi - gamma."""
    ahead = e_1 - length
    return math.sqrt(ahead * ahead + e_2 * e_2), math.atan2(e_2, ahead)


@compiled
def unwrapped(angle: float, previous: float) -> float:
    """Return the angle plus the multiple of 2 pi that brings it within pi of the previous one."""
    return angle - 2 * math.pi * math.floor((angle - previous + math.pi) / (2 * math.pi))


@compiled
def rate_matrix(rho: float, phi: float, steering: float, length: float) -> tuple[float, float, float, float]:
    """R of (8), row by row: what the pseudo-velocities (v, omega) do to range and bearing. NaN at range zero.

    Its determinant is cos(phi - gamma) / cos(gamma): singular at a bearing of 90 degrees.
    """
    if rho == 0.0:
        return math.nan, math.nan, math.nan, math.nan
    c, s, t = math.cos(phi), math.sin(phi), math.tan(steering)
    return -c - s * t, 0.0, (s - c * t) / rho - t / length, -1.0


@compiled
def leader_rates(rho: float, phi: float, e_3: float, v_d: float) -> tuple[float, float]:
    """Delta of (8): what the leader's motion does to range and bearing. NaN at range zero."""
    if rho == 0.0:
        return math.nan, math.nan
    return v_d * math.cos(e_3 - phi), v_d * math.sin(e_3 - phi) / rho


@compiled
def input_matrix(pose: Floats, vehicle: np.void) -> tuple[float, float, float, float]:
    """B2 = S' B1 of (3) and (56), row by row: what the torques do to (v, omega).

    Its (1, 1) entry is 1 + tan(gamma) sin(psi) as printed, 1 / cos(gamma) with front-wheel drive, 1 with
    rear-wheel.
    """
    psi, gamma = pose[2], pose[3]
    if vehicle["drive"] == AS_PRINTED:
        return 1.0 + math.tan(gamma) * math.sin(psi), 0.0, 0.0, 1.0
    if vehicle["drive"] == FRONT_WHEEL:
        return 1.0 / math.cos(gamma), 0.0, 0.0, 1.0
    return 1.0, 0.0, 0.0, 1.0


@compiled
def solve_2x2(a_11: float, a_12: float, a_21: float, a_22: float, b_1: float, b_2: float) -> tuple[float, float]:
    """Solve A x = b by Cramer's rule; NaN if A is singular."""
    det = a_11 * a_22 - a_12 * a_21
    if det == 0.0:
        return math.nan, math.nan
    return (a_22 * b_1 - a_12 * b_2) / det, (a_11 * b_2 - a_21 * b_1) / det
