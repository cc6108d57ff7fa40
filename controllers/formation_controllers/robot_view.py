"""The formation as one robot sees it at a tick, with rates and forces there: shared by all laws."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from formation_controllers import kinematics
from formation_controllers.compiled import compiled
from formation_controllers.elementary import acos, cos, sin
from formation_controllers.interface import Floats
from formation_controllers.kinematics import Geometry, Matrix, PostureError, Steering
from formation_controllers.singularities import Guard, Margins, away_from_zero


class LineOfSight(NamedTuple):
    """Range and polar angle of the leader, (7) and (54), and the bearing that is left of the angle."""

    rho: float
    phi: float
    bearing: float  # phi less the steering angle, unwrapped


class FormationRates(NamedTuple):
    """R and delta of q_dot = R (v, omega) + delta, (8) and (55)."""

    R: Matrix
    delta_1: float
    delta_2: float


class RobotView(NamedTuple):
    """One robot and its leader, (4) to (8) and (53) to (55); rates and B2 with their singularities guarded.

    Attributes
    ----------
    error : PostureError
        Posture error, (4).
    sight : LineOfSight
        Range and bearing.
    steering : Steering
        Steering angle h; it keeps its guarded distance.
    rates : FormationRates
        R and delta.
    B2 : Matrix
        The effect of the torques, (3).
    margins : Margins
        How near the singularities are, unguarded.
    guard : Guard
        The bounds of the law near them.
    """

    error: PostureError
    sight: LineOfSight
    steering: Steering
    rates: FormationRates
    B2: Matrix
    margins: Margins
    guard: Guard


@compiled
def view_of(
    pose: Floats, leader_pose: Floats, v_d: float, last_bearing: float, vehicle: Geometry, guard: float
) -> RobotView:
    """Measure the formation from poses; range and steering angle keep their guarded distance in R, delta and B2."""
    error = kinematics.posture_error(pose, leader_pose, vehicle)
    rho, phi = kinematics.line_of_sight(error.e_1, error.e_2, vehicle.ahead)
    measured = kinematics.steering_of(kinematics.steering_angle(pose, vehicle))
    bearing = kinematics.unwrapped(phi - measured.angle, last_bearing)
    far, steering = rho, measured
    guarded = 0.0
    if rho < guard * vehicle.length:
        far, guarded = guard * vehicle.length, 1.0
    if abs(measured.cos) < guard:
        kept = math.copysign(acos(math.copysign(guard, measured.cos)), sin(measured.angle))
        steering = kinematics.steering_of(kept)
        guarded = 1.0
    R = kinematics.rate_matrix(far, phi, steering, vehicle)
    delta_1, delta_2 = kinematics.leader_rates(far, phi, error.e_3, v_d)
    B2 = kinematics.input_matrix(pose[2], steering, vehicle)
    drive_gain = B2.m_11 * vehicle.wheel_radius if vehicle.torques == kinematics.WHEELS else B2.m_11
    if abs(R.m_11) < guard or abs(drive_gain) < guard:
        guarded = 1.0
    return RobotView(
        error,
        LineOfSight(rho, phi, bearing),
        steering,
        FormationRates(R, delta_1, delta_2),
        B2,
        Margins(rho / vehicle.length, cos(bearing), measured.cos, drive_gain),
        Guard(guard, guarded),
    )


@compiled
def rates_of(view: RobotView, v: float, omega: float) -> tuple[float, float]:
    """Return q_dot = R (v, omega) + delta, (8)."""
    R, delta_1, delta_2 = view.rates
    return R.m_11 * v + R.m_12 * omega + delta_1, R.m_21 * v + R.m_22 * omega + delta_2


@compiled
def velocity(view: RobotView, q_1_dot: float, q_2_dot: float) -> tuple[float, float]:
    """Return (v, omega) = R^-1 (q_dot - delta), (8). NaN where R is singular and not guarded."""
    return from_rates(view, q_1_dot - view.rates.delta_1, q_2_dot - view.rates.delta_2)


@compiled
def from_rates(view: RobotView, y_1: float, y_2: float) -> tuple[float, float]:
    """Return R^-1 y. R has only its (1, 1) entry to divide by, -det R."""
    R = view.rates.R
    guarded = Matrix(away_from_zero(R.m_11, view.guard.least), R.m_12, R.m_21, R.m_22)
    return kinematics.solve_2x2(guarded, y_1, y_2)


@compiled
def along_velocities(view: RobotView, u_1: float, u_2: float) -> tuple[float, float]:
    """Return R' u: the force along (v, omega) that a force u along q is."""
    R = view.rates.R
    return R.m_11 * u_1 + R.m_21 * u_2, R.m_12 * u_1 + R.m_22 * u_2


@compiled
def torque_of(view: RobotView, f_1: float, f_2: float) -> tuple[float, float]:
    """Return the torques B2^-1 f that make a force f along (v, omega). NaN where B2 is singular and not guarded."""
    B2, least = view.B2, view.guard.least
    b_11 = math.copysign(least, B2.m_11) if abs(view.margins.drive_gain) < least else B2.m_11
    return kinematics.solve_2x2(Matrix(b_11, B2.m_12, B2.m_21, B2.m_22), f_1, f_2)


@compiled
def torque_of_formation_force(view: RobotView, u_1: float, u_2: float) -> tuple[float, float]:
    """Return the torques B2^-1 R' u that make a force u along q, (24)."""
    f_1, f_2 = along_velocities(view, u_1, u_2)
    return torque_of(view, f_1, f_2)


@compiled
def report(view: RobotView, tau_1: float, tau_2: float, out: np.void) -> None:
    """Write the `TORQUE_SIGNALS`."""
    R, margins = view.rates.R, view.margins
    out["torque_command"][0], out["torque_command"][1] = tau_1, tau_2
    out["drive_gain"] = margins.drive_gain
    out["det_R"] = R.m_11 * R.m_22 - R.m_12 * R.m_21
    out["relative_range"] = margins.relative_range
    out["cos_bearing"], out["cos_steering"] = margins.cos_bearing, margins.cos_steering
    out["guarded"] = view.guard.bounds
