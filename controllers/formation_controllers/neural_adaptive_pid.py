"""The paper's controller: observer-based neural adaptive PID without velocity measurements, (24) to (34)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from formation_controllers import observer_pid, projection, rbf, sight
from formation_controllers.compiled import compiled
from formation_controllers.gains import gain
from formation_controllers.interface import Desired, Floats, Leader, Signal
from formation_controllers.kinematics import steering_angle
from formation_controllers.observer_pid import OBSERVER_SIGNALS, ObserverPid, ObserverPidGains
from formation_controllers.rbf import NetworkGains
from formation_controllers.sight import HELD_SIGNAL, TORQUE_SIGNALS, Sight


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


class NeuralAdaptivePid(ObserverPid):
    """Observer-based neural adaptive PID formation control, (24) to (34), by explicit Euler steps.

    At a tick, the torque comes from the poses and the present state; then every state advances with values of
    this tick. No velocity of the followers is measured: the only one used is the observer's estimate of the
    rate of q, also in the network's input.
    """

    gains_type = NeuralAdaptivePidGains
    robot_gains: tuple[NeuralAdaptivePidGains, ...]
    signals: ClassVar[tuple[Signal, ...]] = (
        *OBSERVER_SIGNALS,
        Signal("weight_norm", "N", "Frobenius norm of the network's weights W, (29)"),
        Signal("gain_estimate", "N", "robust gain theta_hat, (30)"),
        *TORQUE_SIGNALS,
        HELD_SIGNAL,
    )

    def state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Return name and shape, per robot, of every state of the law."""
        return {**super().state_shapes(), "W": (2, len(self.robot_gains[0].centres)), "theta": ()}

    def on_step(self, pose: Floats, leader: Leader, desired: Desired) -> Floats:
        """Return the torques (24), then advance the states by (28) to (34)."""
        torque = np.empty((self.team.size, 2))
        tick(
            pose,
            leader.pose,
            leader.velocity,
            desired.q,
            desired.q_dot,
            desired.q_ddot,
            self._vehicle,
            self.team.period,
            self._gains,
            self._state,
            self._telemetry,
            torque,
        )
        return torque


NETWORK_INPUTS: Final = 13


@compiled
def network_input(
    x: Floats,
    seen: Sight,
    leader_steering: float,
    leader_velocity: Floats,
    q_hat_dot: Floats,
    q_d_dot: Floats,
    q_d_ddot: Floats,
) -> None:
    """Fill x_w = (e, gamma_d, v_d, omega_d, q_hat_dot, q_d_dot, q_d_ddot); the estimate stands for q_dot."""
    x[0], x[1], x[2], x[3] = seen.e_1, seen.e_2, seen.e_3, seen.e_4
    x[4] = leader_steering
    for j in range(2):
        x[5 + j] = leader_velocity[j]
        x[7 + j] = q_hat_dot[j]
        x[9 + j] = q_d_dot[j]
        x[11 + j] = q_d_ddot[j]


@compiled
def tick(
    pose: Floats,
    leader_pose: Floats,
    leader_velocity: Floats,
    q_d: Floats,
    q_d_dot: Floats,
    q_d_ddot: Floats,
    vehicle: NDArray[np.void],
    period: float,
    gains: NDArray[np.void],
    state: NDArray[np.void],
    telemetry: NDArray[np.void],
    torque: Floats,
) -> None:
    """Fill the torques of a team at one tick, and its telemetry, and advance its state by one period."""
    errors = observer_pid.no_errors()
    x_w = np.empty(NETWORK_INPUTS)
    sigma = np.empty(len(gains[0]["centres"]))
    u = np.empty(2)
    steering_d = steering_angle(leader_pose, vehicle[0])

    for i in range(len(pose)):
        own, g, out = state[i], gains[i], telemetry[i]
        W, theta = own["W"], own["theta"]
        seen = sight.look(pose[i], leader_pose, leader_velocity[0], own["bearing"], vehicle[0], g["guard"])
        observer_pid.estimate(seen, own, g, q_d[i], q_d_dot[i], errors)

        # PID, network and robust term; torque, (24)
        s = errors.s
        s_norm = math.sqrt(s[0] * s[0] + s[1] * s[1])
        network_input(x_w, seen, steering_d, leader_velocity, errors.q_hat_dot, q_d_dot[i], q_d_ddot[i])
        rbf.basis(x_w, g["centres"], g["widths"], sigma)
        robust = theta * theta / (theta * s_norm + g["epsilon_t"])
        for j in range(2):
            u[j] = -g["K_p"][j] * errors.pid[j] - rbf.output(W, sigma, j) - robust * s[j]
        tau_1, tau_2 = sight.torque_of_formation_force(seen, u[0], u[1])
        torque[i, 0], torque[i, 1] = tau_1, tau_2

        held = sight.beyond(tau_1, tau_2, g["torque_limit"])
        observer_pid.report_estimate(seen, own, errors, out)
        out["weight_norm"] = math.sqrt(projection.norm_squared(W))
        out["gain_estimate"] = theta
        sight.report(seen, tau_1, tau_2, out)
        out["held"] = held

        # Adaptation (28) to (30), observer (33), (34), integrals: explicit Euler, values of this tick
        if not held:
            projection.step_weights(W, s, sigma, g["gamma_w"], g["W_m"], period)
            own["theta"] = projection.step_gain(theta, s_norm, g["gamma_theta"], g["theta_m"], period)
        observer_pid.advance(own, g, q_d[i], q_d_ddot[i], errors, held, period)
