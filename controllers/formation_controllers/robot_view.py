"""The formation as robots see it at a tick, with rates and forces there: shared by all laws.

`see` looks at a block of followers and leaves what it finds in columns. `view_of` takes one robot out of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from formation_controllers import kinematics
from formation_controllers.columns import sin_cos_of, sin_cos_tan_of
from formation_controllers.compiled import borrowing, part, vectors_of_four
from formation_controllers.elementary import acos
from formation_controllers.interface import Floats, TickInputs
from formation_controllers.kinematics import Direction, Geometry, Matrix, Pose, PostureError, Steering
from formation_controllers.singularities import Guard, Margins, away_from_zero
from formation_controllers.team_records import TeamRecords


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
    heading, phi, course : Direction
        Directions of the pose's third entry, of the line of sight, and of the leader's heading seen along it.
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
    heading: Direction
    phi: Direction
    course: Direction
    steering: Steering
    rates: FormationRates
    B2: Matrix
    margins: Margins
    guard: Guard


SEEN: Final[Mapping[str, tuple[int, ...]]] = MappingProxyType(
    {"pose": (4,), "q": (2,), "angles": (3,), "sines": (3,), "cosines": (3,)}
    | dict.fromkeys(
        (
            *("sin_heading", "cos_heading"),
            *("e_1", "e_2", "e_3", "e_4", "last_bearing"),
            *("angle", "sin_angle", "cos_angle", "tan_angle", "steering", "tan_steering", "cos_steering"),
            *("R_11", "R_12", "R_21", "R_22", "delta_1", "delta_2", "B2_11", "B2_12", "B2_21", "B2_22"),
            *("relative_range", "drive_gain", "least", "bounds"),
        ),
        (),
    )
)
"""The columns in which `see` leaves what it finds, with their shapes for one robot."""

PHI: Final = 0
COURSE: Final = 1
BEARING: Final = 2
"""The rows of `angles`, `sines` and `cosines`."""


@part
def see(inputs: TickInputs, team: TeamRecords, first: int, count: int) -> None:
    """Measure the formation of a block of followers; range and steering angle are guarded in R, delta and B2."""
    c = team.seen[0]
    for r in range(count):
        i = first + r
        pose = kinematics.pose_of(inputs.pose[i], team.vehicle)
        c["pose"][0, r], c["pose"][1, r], c["pose"][2, r], c["pose"][3, r] = pose
        c["last_bearing"][r], c["least"][r] = team.state[i]["bearing"], team.gains[i]["guard"]
    _see(c, inputs.leader_pose, inputs.leader_velocity[0], team.vehicle, count)


@part
def first_sight(inputs: TickInputs, team: TeamRecords, i: int) -> tuple[float, float]:
    """Return range and bearing of a follower at time zero, the bearing on the turn nearest to the desired one."""
    pose, leader = (
        kinematics.pose_of(inputs.pose[i], team.vehicle),
        kinematics.pose_of(inputs.leader_pose, team.vehicle),
    )
    error = kinematics.posture_error(pose, kinematics.direction_of(pose.heading), leader)
    rho, phi = kinematics.line_of_sight(error.e_1, error.e_2, team.vehicle.ahead)
    return rho, kinematics.unwrapped(phi - kinematics.steering_angle(pose, team.vehicle), inputs.q_d[i, 1])


@borrowing
def begin(inputs: TickInputs, team: TeamRecords) -> None:
    """Set the bearing of a team at time zero, for a law whose other states start at zero."""
    for i in range(len(inputs.pose)):
        _, team.state[i]["bearing"] = first_sight(inputs, team, i)


@borrowing
def _see(c: np.void, leader_pose: Floats, v_d: float, vehicle: Geometry, count: int) -> None:
    """Measure the formation of a block, given pose, last bearing and guard: the same code for every law."""
    vectors_of_four()
    for r in range(count):
        pose = Pose(c["pose"][0, r], c["pose"][1, r], c["pose"][2, r], c["pose"][3, r])
        c["angle"][r] = kinematics.steering_angle(pose, vehicle)
    sin_cos_of(c["pose"][2], c["sin_heading"], c["cos_heading"], count)
    sin_cos_tan_of(c["angle"], c["sin_angle"], c["cos_angle"], c["tan_angle"], count)

    # Range and bearing, (4), (7), (54)
    leader = kinematics.pose_of(leader_pose, vehicle)
    for r in range(count):
        pose = Pose(c["pose"][0, r], c["pose"][1, r], c["pose"][2, r], c["pose"][3, r])
        error = kinematics.posture_error(pose, Direction(c["sin_heading"][r], c["cos_heading"][r]), leader)
        rho, phi = kinematics.line_of_sight(error.e_1, error.e_2, vehicle.ahead)
        c["e_1"][r], c["e_2"][r], c["e_3"][r], c["e_4"][r] = error
        c["q"][0, r], c["q"][1, r] = rho, kinematics.unwrapped(phi - c["angle"][r], c["last_bearing"][r])
        c["angles"][PHI, r], c["angles"][COURSE, r], c["angles"][BEARING, r] = phi, error.e_3 - phi, c["q"][1, r]
    for j in range(3):
        sin_cos_of(c["angles"][j], c["sines"][j], c["cosines"][j], count)

    # The steering angle at its guarded distance
    for r in range(count):
        angle = Steering(c["angle"][r], c["tan_angle"][r], c["cos_angle"][r])
        c["steering"][r], c["tan_steering"][r], c["cos_steering"][r] = angle
        c["bounds"][r] = 0.0
    for r in range(count):
        least, cosine = c["least"][r], c["cos_angle"][r]
        if abs(cosine) < least:
            kept = kinematics.steering_of(math.copysign(acos(math.copysign(least, cosine)), c["sin_angle"][r]))
            c["steering"][r], c["tan_steering"][r], c["cos_steering"][r] = kept
            c["bounds"][r] = 1.0

    # R and delta, (8), (55); B2, (3)
    for r in range(count):
        rho, least = c["q"][0, r], c["least"][r]
        is_near = rho < least * vehicle.length
        far = least * vehicle.length if is_near else rho
        steering = Steering(c["steering"][r], c["tan_steering"][r], c["cos_steering"][r])
        R = kinematics.rate_matrix(far, Direction(c["sines"][PHI, r], c["cosines"][PHI, r]), steering, vehicle)
        delta_1, delta_2 = kinematics.leader_rates(far, Direction(c["sines"][COURSE, r], c["cosines"][COURSE, r]), v_d)
        B2 = kinematics.input_matrix(Direction(c["sin_heading"][r], c["cos_heading"][r]), steering, vehicle)
        drive_gain = B2.m_11 * vehicle.wheel_radius if vehicle.torques == kinematics.WHEELS else B2.m_11
        if is_near or abs(R.m_11) < least or abs(drive_gain) < least:
            c["bounds"][r] = 1.0
        c["R_11"][r], c["R_12"][r], c["R_21"][r], c["R_22"][r] = R
        c["B2_11"][r], c["B2_12"][r], c["B2_21"][r], c["B2_22"][r] = B2
        c["delta_1"][r], c["delta_2"][r], c["drive_gain"][r] = delta_1, delta_2, drive_gain
        c["relative_range"][r] = rho / vehicle.length


@part
def view_of(c: np.void, r: int) -> RobotView:
    """Return one robot of the block."""
    return RobotView(
        PostureError(c["e_1"][r], c["e_2"][r], c["e_3"][r], c["e_4"][r]),
        LineOfSight(c["q"][0, r], c["angles"][PHI, r], c["q"][1, r]),
        Direction(c["sin_heading"][r], c["cos_heading"][r]),
        Direction(c["sines"][PHI, r], c["cosines"][PHI, r]),
        Direction(c["sines"][COURSE, r], c["cosines"][COURSE, r]),
        Steering(c["steering"][r], c["tan_steering"][r], c["cos_steering"][r]),
        FormationRates(
            Matrix(c["R_11"][r], c["R_12"][r], c["R_21"][r], c["R_22"][r]), c["delta_1"][r], c["delta_2"][r]
        ),
        Matrix(c["B2_11"][r], c["B2_12"][r], c["B2_21"][r], c["B2_22"][r]),
        Margins(c["relative_range"][r], c["cosines"][BEARING, r], c["cos_angle"][r], c["drive_gain"][r]),
        Guard(c["least"][r], c["bounds"][r]),
    )


@part
def rates_of(view: RobotView, v: float, omega: float) -> tuple[float, float]:
    """Return q_dot = R (v, omega) + delta, (8)."""
    R, delta_1, delta_2 = view.rates
    return R.m_11 * v + R.m_12 * omega + delta_1, R.m_21 * v + R.m_22 * omega + delta_2


@part
def velocity(view: RobotView, q_1_dot: float, q_2_dot: float) -> tuple[float, float]:
    """Return (v, omega) = R^-1 (q_dot - delta), (8). NaN where R is singular and not guarded."""
    return from_rates(view, q_1_dot - view.rates.delta_1, q_2_dot - view.rates.delta_2)


@part
def from_rates(view: RobotView, y_1: float, y_2: float) -> tuple[float, float]:
    """Return R^-1 y. R has only its (1, 1) entry to divide by, -det R."""
    R = view.rates.R
    guarded = Matrix(away_from_zero(R.m_11, view.guard.least), R.m_12, R.m_21, R.m_22)
    return kinematics.solve_2x2(guarded, y_1, y_2)


@part
def along_velocities(view: RobotView, u_1: float, u_2: float) -> tuple[float, float]:
    """Return R' u: the force along (v, omega) that a force u along q is."""
    R = view.rates.R
    return R.m_11 * u_1 + R.m_21 * u_2, R.m_12 * u_1 + R.m_22 * u_2


@part
def torque_of(view: RobotView, f_1: float, f_2: float) -> tuple[float, float]:
    """Return the torques B2^-1 f that make a force f along (v, omega). NaN where B2 is singular and not guarded."""
    B2, least = view.B2, view.guard.least
    b_11 = math.copysign(least, B2.m_11) if abs(view.margins.drive_gain) < least else B2.m_11
    return kinematics.solve_2x2(Matrix(b_11, B2.m_12, B2.m_21, B2.m_22), f_1, f_2)


@part
def torque_of_formation_force(view: RobotView, u_1: float, u_2: float) -> tuple[float, float]:
    """Return the torques B2^-1 R' u that make a force u along q, (24)."""
    f_1, f_2 = along_velocities(view, u_1, u_2)
    return torque_of(view, f_1, f_2)


@part
def report(view: RobotView, tau_1: float, tau_2: float, out: np.void) -> None:
    """Write the `TORQUE_SIGNALS`."""
    R, margins = view.rates.R, view.margins
    out["torque_command"][0], out["torque_command"][1] = tau_1, tau_2
    out["drive_gain"] = margins.drive_gain
    out["det_R"] = R.m_11 * R.m_22 - R.m_12 * R.m_21
    out["relative_range"] = margins.relative_range
    out["cos_bearing"], out["cos_steering"] = margins.cos_bearing, margins.cos_steering
    out["guarded"] = view.guard.bounds
