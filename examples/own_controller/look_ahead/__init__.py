"""A formation controller of one's own: proportional-derivative control of range and bearing, in plain NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from formation_controllers import OTHERS, Desired, Gains, Leader, Signal
from formation_controllers.controller import Controller
from formation_controllers.gains import gain
from formation_controllers.geometry import formation_rates, input_matrix, range_bearing, unwrapped_bearing


@dataclass(frozen=True)
class LookAheadGains(Gains):
    """Gains of `LookAhead`; names, units and bounds are checked when they are made."""

    K: float | Sequence[float] = gain(20.0, "K", "N/m", "feedback of the error", size=2, above=0)
    D: float | Sequence[float] = gain(20.0, "D", "N.s/m", "feedback of its rate", size=2, at_least=0)
    T: float = gain(0.1, "T", "s", "time constant of the rate's filter", above=0, reason="the filter divides by it")


class LookAhead(Controller[LookAheadGains]):
    """u = -K (q - q_d) - D (rate of the same, filtered), torque = B2^-1 R' u.

    The filter is of first order: the rate is (error - lag)/T, and the lag follows the error with that rate.
    """

    interface = "1.2"
    vehicles = ("car_like", "tractor_trailer", "differential_drive", OTHERS)
    gains_type = LookAheadGains
    signals = (
        Signal("error", "m, rad", "error of range and bearing", ("range", "bearing")),
        Signal("error_rate", "m/s, rad/s", "its filtered rate", ("range", "bearing")),
        Signal("det_R", "1", "determinant of R, (8)", (), "range and bearing cannot be steered", singular_below=0.1),
    )

    def state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Every number that changes, for each robot."""
        return {"bearing": (), "lag": (2,)}

    def on_start(self, pose: np.ndarray, leader: Leader, desired: Desired) -> None:
        """Start on the turn nearest to the desired bearing, with a rate of zero."""
        q = range_bearing(pose, leader.pose, self.team.vehicle)
        q[:, 1] = unwrapped_bearing(q[None, :, 1], desired.q[:, 1])[0]
        self._state["bearing"] = q[:, 1]
        self._state["lag"] = q - desired.q

    def on_step(self, pose: np.ndarray, leader: Leader, desired: Desired) -> np.ndarray:
        """Torques of this tick, then the state of the next."""
        K, D = (np.array([getattr(gains, name) for gains in self.robot_gains]) for name in ("K", "D"))
        T = np.array([[gains.T] for gains in self.robot_gains])

        q = range_bearing(pose, leader.pose, self.team.vehicle)
        q[:, 1] = unwrapped_bearing(q[None, :, 1], self._state["bearing"])[0]
        error = q - desired.q
        rate = (error - self._state["lag"]) / T
        R, _ = formation_rates(pose, leader.pose, leader.velocity[0], self.team.vehicle)
        force = np.einsum("nji,nj->ni", R, -K * error - D * rate)
        torque = np.linalg.solve(input_matrix(pose, self.team.vehicle), force[..., None])[..., 0]

        self._telemetry["error"], self._telemetry["error_rate"] = error, rate
        self._telemetry["det_R"] = R[:, 0, 0] * R[:, 1, 1]
        self._state["bearing"] = q[:, 1]
        self._state["lag"] += self.team.period * rate
        return torque
