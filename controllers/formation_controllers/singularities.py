"""Singularities of a law of range and bearing: the distance of a robot, the bounds of the law, and its telemetry."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from formation_controllers.compiled import part
from formation_controllers.gains import Gains, gain
from formation_controllers.interface import Signal


@dataclass(frozen=True, kw_only=True)
class GuardGains(Gains):
    """Gains of every law about singularities."""

    guard: float = gain(
        0.0,
        "-",
        "1",
        "smallest magnitude of a divisor, such as det R; 0: the law as printed",
        at_least=0,
        below=1,
        reason="a cosine is at most 1",
    )


class Guard(NamedTuple):
    """The gain `guard`, and 1.0 where it bounds something, else 0.0."""

    least: float
    bounds: float


class Margins(NamedTuple):
    """Distance of a robot from each singularity, by the measured pose: zero is on it."""

    relative_range: float
    cos_bearing: float
    cos_steering: float
    drive_gain: float


NEAR: Final = 0.1
"""Magnitude below which range over length, a cosine and the drive gain are reported as near their singularity.

A quotient with such a divisor is more than tenfold there: less than a tenth of the wheelbase or hitch length from the
leader, less than 5.7 degrees from a bearing or steering angle of 90. At 5 rad/s an angle changes by less than that in
20 ms; a faster jump across still shows as a change of sign.
"""

TORQUE_SIGNALS: Final = (
    Signal("torque_command", "N.m", "torque before any saturation", ("tau_1", "tau_2")),
    Signal(
        "drive_gain",
        "1",
        "(1, 1) entry of B2, (3); of wheel torques: 1/cos_steering",
        singular_at_zero="the law is singular",
        singular_below=NEAR,
    ),
    Signal(
        "det_R", "1", "determinant of R, (8), (55), as the law uses it: cos_bearing over cos_steering unless guarded"
    ),
    Signal(
        "relative_range",
        "1",
        "range over wheelbase, hitch length or, of a differential-drive robot, half track",
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
        "cosine of the steering angle, of a tractor-trailer of theta_0 - theta_1; 1 where nothing steers",
        singular_at_zero="the vehicle's kinematics are singular",
        singular_below=NEAR,
    ),
    Signal("guarded", "1", "1 where the gain `guard` bounds something, else 0"),
)
"""Telemetry of every law."""


@part
def away_from_zero(number: float, least: float) -> float:
    """Return the number, or the least magnitude with its sign."""
    return math.copysign(least, number) if abs(number) < least else number
