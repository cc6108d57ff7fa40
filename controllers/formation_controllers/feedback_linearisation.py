"""Feedback linearisation of the formation model (10) with true velocities: what no output feedback beats easily."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from formation_controllers import dynamics, kinematics, robot_view
from formation_controllers.columns import BLOCK
from formation_controllers.compiled import borrowing
from formation_controllers.compiled_law import CompiledLaw, TeamRecords
from formation_controllers.dynamics import ModelGains
from formation_controllers.gains import gain
from formation_controllers.interface import Floats, Signal, TickInputs
from formation_controllers.singularities import TORQUE_SIGNALS, GuardGains


@dataclass(frozen=True)
class FeedbackLinearisationGains(ModelGains, GuardGains):
    """Gains of the error's second-order dynamics, and the model; see `ModelGains` for whose it is by default."""

    K_0: float | Sequence[float] = gain(1.0, "K_0", "1/s2", "feedback of the error", size=2, above=0)
    K_1: float | Sequence[float] = gain(2.0, "K_1", "1/s", "feedback of its rate", size=2, above=0)


@borrowing
def tick(inputs: TickInputs, team: TeamRecords, torque: Floats) -> None:
    """Fill the torques of a team at one tick, and its telemetry."""
    size, vehicle = len(inputs.pose), team.vehicle
    v_d, omega_d, v_d_dot = inputs.leader_velocity[0], inputs.leader_velocity[1], inputs.leader_acceleration[0]
    steering_d = kinematics.steering_angle(kinematics.pose_of(inputs.leader_pose, vehicle), vehicle)
    turn_d = kinematics.body_turn(v_d, omega_d, kinematics.steering_of(steering_d), vehicle)
    for first in range(0, size, BLOCK):
        count = min(BLOCK, size - first)
        robot_view.see(inputs, team, first, count)
        for r in range(count):
            i = first + r
            own, g, out = team.state[i], team.gains[i], team.telemetry[i]
            v, omega = inputs.velocity[i, 0], inputs.velocity[i, 1]
            view = robot_view.view_of(team.seen[0], r)
            rho = max(view.sight.rho, g["guard"] * vehicle.length)

            # Rates, (8)
            q_1_dot, q_2_dot = robot_view.rates_of(view, v, omega)
            turn = kinematics.body_turn(v, omega, view.steering, vehicle)
            steering_dot = kinematics.steering_rate(omega, turn, vehicle)
            phi_dot = q_2_dot + steering_dot
            r_11_dot, r_21_dot = kinematics.rate_matrix_dot(
                rho, view.phi, view.steering, q_1_dot, phi_dot, steering_dot, vehicle
            )
            delta_1_dot, delta_2_dot = kinematics.leader_rates_dot(
                rho, view.course, v_d, q_1_dot, turn_d - turn - phi_dot, v_d_dot
            )

            # Wanted q_ddot = R_dot (v, omega) + R (v_dot, omega_dot) + delta_dot, solved for (v_dot, omega_dot)
            q_1_ddot = (
                inputs.q_d_ddot[i, 0]
                - g["K_1"][0] * (q_1_dot - inputs.q_d_dot[i, 0])
                - g["K_0"][0] * (view.sight.rho - inputs.q_d[i, 0])
            )
            q_2_ddot = (
                inputs.q_d_ddot[i, 1]
                - g["K_1"][1] * (q_2_dot - inputs.q_d_dot[i, 1])
                - g["K_0"][1] * (view.sight.bearing - inputs.q_d[i, 1])
            )
            v_dot, omega_dot = robot_view.from_rates(
                view, q_1_ddot - r_11_dot * v - delta_1_dot, q_2_ddot - r_21_dot * v - delta_2_dot
            )

            # (3)
            M2 = dynamics.inertia(view.steering, vehicle, g)
            C2 = dynamics.coriolis(view.steering, v, omega, vehicle, g)
            d_1, d_2 = dynamics.damping(view.heading, view.steering, vehicle, g)
            tau_1, tau_2 = robot_view.torque_of(
                view,
                M2.m_11 * v_dot + M2.m_12 * omega_dot + C2.m_11 * v + C2.m_12 * omega + d_1 * v,
                M2.m_21 * v_dot + M2.m_22 * omega_dot + C2.m_21 * v + C2.m_22 * omega + d_2 * omega,
            )
            torque[i, 0], torque[i, 1] = tau_1, tau_2
            out["range_rate"], out["bearing_rate"] = q_1_dot, q_2_dot
            robot_view.report(view, tau_1, tau_2, out)
            own["bearing"] = view.sight.bearing


class FeedbackLinearisation(CompiledLaw[FeedbackLinearisationGains]):
    """Model-based feedback linearisation of (10): q_ddot = q_d_ddot - K_1 epsilon_dot - K_0 epsilon.

    It is computed along (9), of which (10) is a rearrangement: the pseudo-accelerations that give this q_ddot, then
    the torques of (3) that give these. It knows the robot's true velocity and its dynamics, and the leader's
    acceleration where it is told (else it takes it for zero). No integral: what the model does not say stays as an
    error.
    """

    tick = staticmethod(tick)
    begin = staticmethod(robot_view.begin)
    needs: ClassVar[tuple[str, ...]] = ("velocity",)
    gains_type = FeedbackLinearisationGains
    signals: ClassVar[tuple[Signal, ...]] = (
        Signal("range_rate", "m/s", "rate of the range, (8), (55)"),
        Signal("bearing_rate", "rad/s", "rate of the bearing, (8), (55)"),
        *TORQUE_SIGNALS,
    )

    def own_state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Return nothing: the law itself has no state."""
        return {}
