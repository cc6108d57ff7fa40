"""What one robot knows of the formation at a tick, and what becomes of a generalised force: shared by all laws."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from formation_controllers import kinematics
from formation_controllers.compiled import compiled
from formation_controllers.gains import Gains, gain
from formation_controllers.interface import Floats, Signal


@dataclass(frozen=True, kw_only=True)
class GuardGains(Gains):
    """What every law can be told about singularities."""

    guard: float = gain(
        0.0,
        "-",
        "1",
        "smallest magnitude of det R, drive gain, cosine of the steering angle and range over length that the law "
        "divides by; zero leaves the law as printed",
        at_least=0,
        below=1,
        reason="a cosine is at most 1",
    )


@dataclass(frozen=True, kw_only=True)
class LimitGains(GuardGains):
    """What a law with integrals or adaptation can be told about actuators."""

    torque_limit: float = gain(
        math.inf,
        "-",
        "N.m",
        "integrals and adaptation are held at ticks at which a torque is beyond it; infinity never holds them",
        above=0,
        finite=False,
    )


NEAR: Final = 0.1
"""Magnitude below which range over length, a cosine and the drive gain are reported as near their singularity.

What the law divides by them grows more than tenfold there: less than a tenth of the wheelbase or hitch length from the
leader, less than 5.7 degrees from a bearing or steering angle of 90. At 5 rad/s an angle does not jump over that much,
20 ms apart; if it does, the change of sign is left.
"""

TORQUE_SIGNALS: Final = (
    Signal("torque_command", "N.m", "torque before any saturation", ("tau_1", "tau_2")),
    Signal(
        "drive_gain",
        "1",
        "(1, 1) entry of B2, (3), of a tractor-trailer times the wheel radius: 1/cos(theta_0 - theta_1), never zero",
        singular_at_zero="the law is singular",
        singular_below=NEAR,
    ),
    Signal("det_R", "1", "determinant of R, (8), (55): cos_bearing over cos_steering"),
    Signal(
        "relative_range",
        "1",
        "range over wheelbase or hitch length",
        singular_at_zero="the bearing is undefined",
        singular_below=NEAR,
    ),
    Signal(
        "cos_bearing",
        "1",
        "cosine of the virtual bearing, (7), (54)",
        singular_at_zero="the formation model is singular",
        singular_below=NEAR,
    ),
    Signal(
        "cos_steering",
        "1",
        "cosine of the steering angle, of a tractor-trailer of theta_0 - theta_1",
        singular_at_zero="the vehicle's kinematics are singular",
        singular_below=NEAR,
    ),
    Signal("guarded", "1", "1 where the gain `guard` bounds something, else 0"),
)
"""Telemetry of every law."""

HELD_SIGNAL: Final = Signal("held", "1", "1 where the gain `torque_limit` held integrals and adaptation, else 0")
"""Telemetry of every law that has a `torque_limit`."""


class Sight(NamedTuple):
    """Geometry of one robot and its leader, (4) to (8) and (53) to (55), with singularities guarded."""

    e_1: float
    e_2: float
    e_3: float
    e_4: float
    rho: float
    phi: float
    steering: float
    bearing: float  # unwrapped
    relative_range: float
    cos_bearing: float
    cos_steering: float  # of the angle as measured; that of `steering` keeps its guarded distance
    r_11: float
    r_12: float
    r_21: float
    r_22: float
    delta_1: float
    delta_2: float
    b_11: float
    b_12: float
    b_21: float
    b_22: float
    drive_gain: float
    guard: float
    guarded: float


@compiled
def away_from_zero(number: float, least: float) -> float:
    """Return the number, or that of the least magnitude with its sign."""
    return math.copysign(least, number) if abs(number) < least else number


@compiled
def look(pose: Floats, leader_pose: Floats, v_d: float, last_bearing: float, vehicle: np.void, guard: float) -> Sight:
    """Measure the formation from poses; range and steering angle keep their guarded distance in R, delta and B2."""
    length = vehicle["length"]
    e_1, e_2, e_3, e_4 = kinematics.posture_error(pose, leader_pose)
    rho, phi = kinematics.line_of_sight(e_1, e_2, length)
    steering = kinematics.steering_angle(pose, vehicle)
    bearing = kinematics.unwrapped(phi - steering, last_bearing)
    cos_steering = math.cos(steering)
    far, steered = rho, steering
    guarded = 0.0
    if rho < guard * length:
        far, guarded = guard * length, 1.0
    if abs(cos_steering) < guard:
        steered = math.copysign(math.acos(math.copysign(guard, cos_steering)), math.sin(steering))
        guarded = 1.0
    r_11, r_12, r_21, r_22 = kinematics.rate_matrix(far, phi, steered, vehicle)
    delta_1, delta_2 = kinematics.leader_rates(far, phi, e_3, v_d)
    b_11, b_12, b_21, b_22 = kinematics.input_matrix(pose[2], steered, vehicle)
    drive_gain = b_11 * vehicle["wheel_radius"] if vehicle["kind"] == kinematics.TRACTOR_TRAILER else b_11
    if abs(r_11) < guard or abs(drive_gain) < guard:
        guarded = 1.0
    return Sight(
        e_1,
        e_2,
        e_3,
        e_4,
        rho,
        phi,
        steered,
        bearing,
        rho / length,
        math.cos(bearing),
        cos_steering,
        r_11,
        r_12,
        r_21,
        r_22,
        delta_1,
        delta_2,
        b_11,
        b_12,
        b_21,
        b_22,
        drive_gain,
        guard,
        guarded,
    )


@compiled
def velocity(sight: Sight, q_1_dot: float, q_2_dot: float) -> tuple[float, float]:
    """Return (v, omega) = R^-1 (q_dot - delta), (8). NaN where R is singular and not guarded."""
    return from_rates(sight, q_1_dot - sight.delta_1, q_2_dot - sight.delta_2)


@compiled
def from_rates(sight: Sight, y_1: float, y_2: float) -> tuple[float, float]:
    """Return R^-1 y. R has only r_11 to divide by, -det R."""
    r_11 = away_from_zero(sight.r_11, sight.guard)
    return kinematics.solve_2x2(r_11, sight.r_12, sight.r_21, sight.r_22, y_1, y_2)


@compiled
def torque_of(sight: Sight, f_1: float, f_2: float) -> tuple[float, float]:
    """Return the torques B2^-1 f that make a force f along (v, omega). NaN where B2 is singular and not guarded."""
    b_11 = math.copysign(sight.guard, sight.b_11) if abs(sight.drive_gain) < sight.guard else sight.b_11
    return kinematics.solve_2x2(b_11, sight.b_12, sight.b_21, sight.b_22, f_1, f_2)


@compiled
def torque_of_formation_force(sight: Sight, u_1: float, u_2: float) -> tuple[float, float]:
    """Return the torques B2^-1 R' u that make a force u along q, (24)."""
    return torque_of(sight, sight.r_11 * u_1 + sight.r_21 * u_2, sight.r_12 * u_1 + sight.r_22 * u_2)


@compiled
def report(sight: Sight, tau_1: float, tau_2: float, out: np.void) -> None:
    """Write the `TORQUE_SIGNALS`."""
    out["torque_command"][0], out["torque_command"][1] = tau_1, tau_2
    out["drive_gain"] = sight.drive_gain
    out["det_R"] = sight.r_11 * sight.r_22 - sight.r_12 * sight.r_21
    out["relative_range"] = sight.relative_range
    out["cos_bearing"], out["cos_steering"] = sight.cos_bearing, sight.cos_steering
    out["guarded"] = sight.guarded


@compiled
def beyond(tau_1: float, tau_2: float, limit: float) -> bool:
    """Tell whether a torque is beyond the limit of the actuators."""
    return abs(tau_1) > limit or abs(tau_2) > limit
