"""The law: range and bearing of each bicycle to the leader, by feedback linearisation.

This is the control of separation and bearing of J. P. Desai, J. Ostrowski and V. Kumar, "Controlling formations of
multiple mobile robots", IEEE International Conference on Robotics and Automation, 1998, with the bearing as the
follower sees it. Range and bearing q change with the forward velocity v and the turn rate omega of the follower,

    q' = R (v, omega) + delta,    R = [ -cos(bearing)         0 ]
                                      [ sin(bearing)/range   -1 ],

where delta is the leader's doing, so that (v, omega) = R^-1 (q_d' - K (q - q_d) - delta) leaves the error
e' = -K e. A bicycle turns at omega = v tan(gamma)/a: its front axle moves with (v, a omega), straight ahead and to the
left, and the front wheel has to point that way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, copysign, cos, hypot, pi, radians, sin

import numpy as np
from formation_controllers import Desired, Gains, Leader, Signal
from formation_controllers.controller import Controller
from formation_controllers.gains import gain
from formation_controllers.geometry import first_range_bearing, formation_rates, range_bearing, unwrapped_bearing

SMALLEST_DET = 0.1
"""Of R: nearer to a bearing of 90 degrees the law does not ask for more speed."""


@dataclass(frozen=True)
class FollowGains(Gains):
    """Gains and limits of `Follow`."""

    K: float | Sequence[float] = gain(0.8, "K", "1/s", "decay rate of the error", size=2, above=0)
    v_max: float = gain(3.0, "v_max", "m/s", "largest speed, forward or backward", above=0)
    gamma_max: float = gain(radians(35), "gamma_max", "rad", "largest steering angle", above=0, below=pi / 2)
    v_stop: float = gain(0.01, "v_stop", "m/s", "speed of the front axle below which it stands still", at_least=0)


class Follow(Controller[FollowGains]):
    """Speed and steering angle that bring range and bearing to what is desired, exponentially within the limits."""

    interface = "1.2"
    vehicles = ("kinematic_bicycle",)
    gains_type = FollowGains
    signals = (
        Signal("error", "m, rad", "error of range and bearing", ("range", "bearing")),
        Signal("wanted", "m/s, rad/s", "forward velocity and turn rate before the limits", ("v", "omega")),
        Signal(
            "det_R", "1", "determinant of R", (), "range and bearing cannot be steered", singular_below=SMALLEST_DET
        ),
    )

    def state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the one number that the law remembers: the bearing, to stay on its turn."""
        return {"bearing": ()}

    def on_start(self, pose: np.ndarray, leader: Leader, desired: Desired) -> None:
        """Start on the turn nearest to the desired bearing."""
        self._state["bearing"] = first_range_bearing(pose, leader.pose, desired.q, self.team.vehicle)[:, 1]

    def on_step(self, pose: np.ndarray, leader: Leader, desired: Desired) -> np.ndarray:
        """Return speed and steering angle of every bicycle."""
        vehicle = self.team.vehicle
        q = range_bearing(pose, leader.pose, vehicle)
        q[:, 1] = unwrapped_bearing(q[None, :, 1], self._state["bearing"])[0]
        R, delta = formation_rates(pose, leader.pose, leader.velocity[0], vehicle)
        K = np.array([gains.K for gains in self.robot_gains])
        error = q - desired.q
        rate = desired.q_dot - K * error - delta
        det = -R[:, 0, 0]  # cos(bearing), as R_22 is -1

        command = np.empty((self.team.size, 2))
        for i, gains in enumerate(self.robot_gains):
            v = -rate[i, 0] / copysign(max(abs(det[i]), SMALLEST_DET), det[i])
            omega = R[i, 1, 0] * v - rate[i, 1]
            command[i] = speed_and_steering(v, vehicle.wheelbase * omega, gains)
            self._telemetry["wanted"][i] = v, omega

        self._telemetry["error"], self._telemetry["det_R"] = error, det
        self._state["bearing"] = q[:, 1]
        return command


def speed_and_steering(ahead: float, left: float, gains: FollowGains) -> tuple[float, float]:
    """Return the speed and the steering angle that move the front axle as wanted, as nearly as the limits allow.

    Parameters
    ----------
    ahead, left
        The front axle's velocity [m/s], in the frame of the body.
    gains
        The limits.
    """
    if hypot(ahead, left) <= gains.v_stop:
        return 0.0, 0.0
    gamma = atan2(left, ahead) if ahead >= 0.0 else atan2(-left, -ahead)  # backwards, the wheel points to the rear
    gamma = min(max(gamma, -gains.gamma_max), gains.gamma_max)
    # Along the front wheel, as much of the wanted velocity as lies in its direction.
    along = ahead * cos(gamma) + left * sin(gamma)
    v = along * cos(gamma)
    return min(max(v, -gains.v_max), gains.v_max), gamma
