"""The paper's controller: observer-based neural adaptive PID without velocity measurements, (24) to (34)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from formation_controllers import network, observer_pid, projection, robot_view, saturation
from formation_controllers.columns import BLOCK
from formation_controllers.compiled import borrowing, part, vectors_of_four
from formation_controllers.compiled_law import TeamRecords
from formation_controllers.gains import gain
from formation_controllers.interface import Floats, Signal, TickInputs
from formation_controllers.kinematics import STEERS_NOT, Geometry, PostureError, geometry_of, pose_of, steering_angle
from formation_controllers.network import NetworkGains
from formation_controllers.observer_pid import OBSERVER_SIGNALS, ObserverPid, ObserverPidGains
from formation_controllers.saturation import HELD_SIGNAL
from formation_controllers.singularities import TORQUE_SIGNALS


@dataclass(frozen=True)
class NeuralAdaptivePidGains(NetworkGains, ObserverPidGains):
    """Gains of the paper's law; the defaults are those printed for the first simulation (section 5.1)."""

    epsilon_t: float = gain(
        10.0,
        "ε_t",
        "N.m/s",
        "smoothing of the robust term, (24)",
        above=0,
        reason="the robust term divides by it",
    )
    gamma_theta: float = gain(
        0.5, "γ_θ", "N/m", "adaptation gain of the robust gain, (28)", at_least=0, reason="zero switches it off"
    )
    theta_m: float = gain(10.0, "θ_m", "N", "bound of the robust gain, (30)", at_least=0, reason="zero switches it off")
    gamma_w: float = gain(
        10.0,
        "γ_w",
        "N/m",
        "adaptation gain of the network's weights, (28)",
        at_least=0,
        reason="zero switches it off",
    )
    W_m: float = gain(1000.0, "W_m", "N2", "bound of tr(W'W), (29)", above=0, reason="it is a squared norm")


@part
def network_inputs(vehicle: Geometry) -> int:
    """Return how many numbers the network sees: two less, e_4 and gamma_d, where nothing steers."""
    return 11 if vehicle.steering == STEERS_NOT else 13


@part
def network_input(
    x: Floats,
    error: PostureError,
    leader_steering: float,
    leader_velocity: Floats,
    q_hat_dot: Floats,
    q_d_dot: Floats,
    q_d_ddot: Floats,
) -> None:
    """Fill x_w = (e, gamma_d, v_d, omega_d, q_hat_dot, q_d_dot, q_d_ddot); the estimate stands for q_dot.

    Without e_4 and gamma_d where nothing steers, by its length.
    """
    x[0], x[1], x[2] = error.e_1, error.e_2, error.e_3
    rest = len(x) - 8
    if rest == 5:
        x[3], x[4] = error.e_4, leader_steering
    for j in range(2):
        x[rest + j] = leader_velocity[j]
        x[rest + 2 + j] = q_hat_dot[j]
        x[rest + 4 + j] = q_d_dot[j]
        x[rest + 6 + j] = q_d_ddot[j]


@borrowing
def tick(inputs: TickInputs, team: TeamRecords, torque: Floats) -> None:
    """Fill the torques of a team at one tick, and its telemetry, and advance its state by one period."""
    vectors_of_four()
    seen, c, size = team.seen[0], team.columns[0], len(inputs.pose)
    steering_d = steering_angle(pose_of(inputs.leader_pose, team.vehicle), team.vehicle)

    for first in range(0, size, BLOCK):
        count = min(BLOCK, size - first)
        robot_view.see(inputs, team, first, count)
        for r in range(count):
            i = first + r
            q, own, g = seen["q"][:, r], team.state[i], team.gains[i]
            observer_pid.estimate(q, c, r, own, g, inputs.q_d[i], inputs.q_d_dot[i])
            network_input(
                c["x"][:, r],
                PostureError(seen["e_1"][r], seen["e_2"][r], seen["e_3"][r], seen["e_4"][r]),
                steering_d,
                inputs.leader_velocity,
                c["q_hat_dot"][:, r],
                inputs.q_d_dot[i],
                inputs.q_d_ddot[i],
            )
        network.basis(c, team.gains, first, count)

        for r in range(count):
            i = first + r
            own, g, out = team.state[i], team.gains[i], team.telemetry[i]
            W, theta, s, sigma = own["W"], own["theta"], c["s"][:, r], network.sigma_of(c, r, count)
            view = robot_view.view_of(seen, r)

            # PID, network and robust term; torque, (24)
            s_norm = math.sqrt(s[0] * s[0] + s[1] * s[1])
            robust = theta * theta / (theta * s_norm + g["epsilon_t"])
            u_1 = -g["K_p"][0] * c["pid"][0, r] - network.output(W, sigma, 0) - robust * s[0]
            u_2 = -g["K_p"][1] * c["pid"][1, r] - network.output(W, sigma, 1) - robust * s[1]
            tau_1, tau_2 = robot_view.torque_of_formation_force(view, u_1, u_2)
            torque[i, 0], torque[i, 1] = tau_1, tau_2

            held = saturation.beyond(tau_1, tau_2, g["torque_limit"])
            trace = projection.norm_squared(W)
            observer_pid.report_estimate(view, own, c["q_hat_dot"][:, r], out)
            out["weight_norm"], out["gain_estimate"] = math.sqrt(trace), theta
            robot_view.report(view, tau_1, tau_2, out)
            out["held"] = held

            # Adaptation (28) to (30), observer (33), (34), integrals: explicit Euler, values of this tick
            if not held:
                projection.step_weights(W, trace, s, sigma, g["gamma_w"], g["W_m"], team.period)
                own["theta"] = projection.step_gain(theta, s_norm, g["gamma_theta"], g["theta_m"], team.period)
            observer_pid.advance(c, r, own, g, inputs.q_d_ddot[i], held, team.period)
            own["bearing"] = view.sight.bearing


class NeuralAdaptivePid(ObserverPid):
    """Observer-based neural adaptive PID formation control, (24) to (34), by explicit Euler steps.

    At a tick, the torque comes from the poses and the present state; then every state advances with values of
    this tick. No velocity of the followers is measured: the only one used is the observer's estimate of the
    rate of q, also in the network's input.
    """

    tick = staticmethod(tick)
    gains_type = NeuralAdaptivePidGains
    robot_gains: tuple[NeuralAdaptivePidGains, ...]
    signals: ClassVar[tuple[Signal, ...]] = (
        *OBSERVER_SIGNALS,
        Signal("weight_norm", "N", "Frobenius norm of the network's weights W, (29)"),
        Signal("gain_estimate", "N", "robust gain theta_hat, (30)"),
        *TORQUE_SIGNALS,
        HELD_SIGNAL,
    )

    def own_state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Return name and shape, per robot, of every state but the bearing."""
        return {**super().own_state_shapes(), "W": (2, len(self.robot_gains[0].centres)), "theta": ()}

    def own_columns(self) -> dict[str, tuple[int, ...]]:
        """Return name and shape, per robot, of what the law's tick works out besides `robot_view.see`."""
        inputs, centres = network_inputs(geometry_of(self.team.vehicle)), len(self.robot_gains[0].centres)
        return {**super().own_columns(), **network.columns(inputs, centres)}
