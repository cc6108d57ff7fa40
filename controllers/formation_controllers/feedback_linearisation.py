"""Feedback linearisation of the formation model (10) with true velocities: what no output feedback beats easily."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from formation_controllers import dynamics, kinematics, sight
from formation_controllers.compiled import compiled
from formation_controllers.controller import Controller
from formation_controllers.dynamics import ModelGains
from formation_controllers.gains import gain, gain_records
from formation_controllers.geometry import first_range_bearing
from formation_controllers.interface import Desired, Floats, Leader, Signal, Team
from formation_controllers.kinematics import TRACTOR_TRAILER, vehicle_record
from formation_controllers.sight import TORQUE_SIGNALS, GuardGains


@dataclass(frozen=True)
class FeedbackLinearisationGains(ModelGains, GuardGains):
    """Gains of the error's second-order dynamics, and the model; see `ModelGains` for whose it is by default."""

    K_0: float | Sequence[float] = gain(1.0, "K_0", "1/s2", "feedback of the error", size=2, above=0)
    K_1: float | Sequence[float] = gain(2.0, "K_1", "1/s", "feedback of its rate", size=2, above=0)


class FeedbackLinearisation(Controller[FeedbackLinearisationGains]):
    """Model-based feedback linearisation of (10): q_ddot = q_d_ddot - K_1 epsilon_dot - K_0 epsilon.

    It is computed along (9), of which (10) is a rearrangement: the pseudo-accelerations that give this q_ddot, then
    the torques of (3) that give these. It knows the robot's true velocity and its dynamics, and the leader's
    acceleration where it is told (else it takes it for zero). No integral: what the model does not say stays as an
    error.
    """

    interface: ClassVar[str] = "1.1"
    vehicles: ClassVar[tuple[str, ...]] = ("car_like", "tractor_trailer")
    needs: ClassVar[tuple[str, ...]] = ("velocity",)
    gains_type = FeedbackLinearisationGains
    signals: ClassVar[tuple[Signal, ...]] = (
        Signal("range_rate", "m/s", "rate of the range, (8), (55)"),
        Signal("bearing_rate", "rad/s", "rate of the bearing, (8), (55)"),
        *TORQUE_SIGNALS,
    )

    def __init__(
        self, team: Team, gains: FeedbackLinearisationGains | Sequence[FeedbackLinearisationGains] | None = None
    ) -> None:
        super().__init__(team, gains)
        self._gains = gain_records(self.robot_gains)
        self._vehicle = vehicle_record(team.vehicle)

    def state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the bearing of the last tick, to unwrap the next one: the law itself has no state."""
        return {"bearing": ()}

    def on_start(self, pose: Floats, leader: Leader, desired: Desired) -> None:
        """Choose the turn of the bearing."""
        self._state["bearing"] = first_range_bearing(pose, leader.pose, desired.q, self.team.vehicle)[:, 1]

    def on_step(self, pose: Floats, leader: Leader, desired: Desired) -> Floats:
        """Return the torques."""
        torque = np.empty((self.team.size, 2))
        tick(
            pose,
            self._velocity,
            leader.pose,
            leader.velocity,
            0.0 if leader.acceleration is None else leader.acceleration[0],
            desired.q,
            desired.q_dot,
            desired.q_ddot,
            self._vehicle,
            self._gains,
            self._state,
            self._telemetry,
            torque,
        )
        return torque


@compiled
def tick(
    pose: Floats,
    velocity: Floats,
    leader_pose: Floats,
    leader_velocity: Floats,
    v_d_dot: float,
    q_d: Floats,
    q_d_dot: Floats,
    q_d_ddot: Floats,
    vehicle: NDArray[np.void],
    gains: NDArray[np.void],
    state: NDArray[np.void],
    telemetry: NDArray[np.void],
    torque: Floats,
) -> None:
    """Fill the torques of a team at one tick, and its telemetry."""
    car, v_d = vehicle[0], leader_velocity[0]
    turn_d = v_d * math.tan(kinematics.steering_angle(leader_pose, car)) / car["length"]
    for i in range(len(pose)):
        own, g, out = state[i], gains[i], telemetry[i]
        v, omega = velocity[i, 0], velocity[i, 1]
        seen = sight.look(pose[i], leader_pose, v_d, own["bearing"], car, g["guard"])
        rho = max(seen.rho, g["guard"] * car["length"])

        # Rates, (8)
        q_1_dot = seen.r_11 * v + seen.r_12 * omega + seen.delta_1
        q_2_dot = seen.r_21 * v + seen.r_22 * omega + seen.delta_2
        turn = v * math.tan(seen.steering) / car["length"]
        steering_dot = omega - turn if car["kind"] == TRACTOR_TRAILER else omega
        phi_dot = q_2_dot + steering_dot
        r_11_dot, r_21_dot = kinematics.rate_matrix_dot(
            rho, seen.phi, seen.steering, q_1_dot, phi_dot, steering_dot, car
        )
        delta_1_dot, delta_2_dot = kinematics.leader_rates_dot(
            rho, seen.phi, seen.e_3, v_d, q_1_dot, phi_dot, turn_d - turn, v_d_dot
        )

        # Wanted q_ddot = R_dot (v, omega) + R (v_dot, omega_dot) + delta_dot, solved for (v_dot, omega_dot)
        q_1_ddot = q_d_ddot[i, 0] - g["K_1"][0] * (q_1_dot - q_d_dot[i, 0]) - g["K_0"][0] * (seen.rho - q_d[i, 0])
        q_2_ddot = q_d_ddot[i, 1] - g["K_1"][1] * (q_2_dot - q_d_dot[i, 1]) - g["K_0"][1] * (seen.bearing - q_d[i, 1])
        v_dot, omega_dot = sight.from_rates(
            seen, q_1_ddot - r_11_dot * v - delta_1_dot, q_2_ddot - r_21_dot * v - delta_2_dot
        )

        # (3)
        m_11, m_12, m_22 = dynamics.inertia(seen.steering, car, g)
        c_11, c_12, c_21, c_22 = dynamics.coriolis(seen.steering, v, omega, car, g)
        d_1, d_2 = dynamics.damping(pose[i, 2], seen.steering, car, g)
        tau_1, tau_2 = sight.torque_of(
            seen,
            m_11 * v_dot + m_12 * omega_dot + c_11 * v + c_12 * omega + d_1 * v,
            m_12 * v_dot + m_22 * omega_dot + c_21 * v + c_22 * omega + d_2 * omega,
        )
        torque[i, 0], torque[i, 1] = tau_1, tau_2
        out["range_rate"], out["bearing_rate"] = q_1_dot, q_2_dot
        sight.report(seen, tau_1, tau_2, out)
        own["bearing"] = seen.bearing
