"""The paper's controller: observer-based neural adaptive PID without velocity measurements, (24) to (34)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from formation_controllers import kinematics, observer, projection, rbf
from formation_controllers.compiled import compiled
from formation_controllers.controller import Controller
from formation_controllers.errors import GainError
from formation_controllers.gains import Gains, gain, gain_records
from formation_controllers.geometry import range_bearing, unwrapped_bearing
from formation_controllers.interface import Desired, Floats, Leader, Signal, Team
from formation_controllers.kinematics import vehicle_record

_OFF = "zero switches it off"
_DEFINITE = "the matrix must be positive definite"


@dataclass(frozen=True)
class NeuralAdaptivePidGains(Gains):
    """Gains of the paper's law; the defaults are those printed for the first simulation (section 5.1)."""

    K_p: float | Sequence[float] = gain(
        10.0, "K_p", "N.s/m", "feedback of the filtered error, (24)", size=2, above=0, reason=_DEFINITE
    )
    Lambda_0: float | Sequence[float] = gain(
        2.0,
        "Λ_0",
        "1/s",
        "weight of the error in the filtered error, (17), (18)",
        size=2,
        above=0,
        reason=_DEFINITE,
    )
    Lambda_1: float | Sequence[float] = gain(
        0.05, "Λ_1", "1/s2", "weight of its integral, (17), (18); zero switches it off", size=2, at_least=0
    )
    k_d: float = gain(10.0, "k_d", "1/s", "gain of the velocity observer, (32) to (34)", above=0)
    epsilon_t: float = gain(
        10.0,
        "ε_t",
        "N.m/s",
        "smoothing of the robust term, (24)",
        above=0,
        reason="the robust term divides by it",
    )
    gamma_theta: float = gain(0.5, "γ_θ", "N/m", "adaptation gain of the robust gain, (28)", at_least=0, reason=_OFF)
    theta_m: float = gain(10.0, "θ_m", "N", "bound of the robust gain, (30)", at_least=0, reason=_OFF)
    gamma_w: float = gain(10.0, "γ_w", "N/m", "adaptation gain of the network's weights, (28)", at_least=0, reason=_OFF)
    W_m: float = gain(1000.0, "W_m", "N2", "bound of tr(W'W), (29)", above=0, reason="it is a squared norm")
    centres: Sequence[float] = gain(
        (-4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 4.0),
        "μ_k",
        "1",
        "centres of the basis functions, (11); each stands for a vector of that value",
        size=None,
    )
    widths: float | Sequence[float] = gain(
        10.0, "λ_k", "1", "widths of the basis functions, (11); one for all or one each", size=None, above=0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        n = np.size(self.centres)
        if np.size(self.widths) not in (1, n):
            raise GainError(
                f"gain 'widths' has {np.size(self.widths)} entries: expected 1, or {n} as there are centres"
            )
        object.__setattr__(self, "widths", tuple(np.broadcast_to(self.widths, n).tolist()))


class NeuralAdaptivePid(Controller[NeuralAdaptivePidGains]):
    """Observer-based neural adaptive PID formation control, (24) to (34), by explicit Euler steps.

    At a tick, the torque comes from the poses and the present state; then every state advances with values of
    this tick. No velocity of the followers is measured: the only one used is the observer's estimate of the
    rate of q, also in the network's input.
    """

    interface: ClassVar[str] = "1.0"
    vehicles: ClassVar[tuple[str, ...]] = ("car_like",)
    gains_type = NeuralAdaptivePidGains
    signals: ClassVar[tuple[Signal, ...]] = (
        Signal("range_estimate", "m", "estimated range, first entry of q_hat"),
        Signal("bearing_estimate", "rad", "estimated bearing, second entry of q_hat"),
        Signal("range_rate_estimate", "m/s", "estimated rate of the range, first entry of q_hat_dot, (32)"),
        Signal("bearing_rate_estimate", "rad/s", "estimated rate of the bearing, second entry of q_hat_dot, (32)"),
        Signal("speed_estimate", "m/s", "estimated linear velocity v_hat, (32)"),
        Signal("steering_rate_estimate", "rad/s", "estimated steering velocity omega_hat, (32)"),
        Signal("weight_norm", "N", "Frobenius norm of the network's weights W, (29)"),
        Signal("gain_estimate", "N", "robust gain theta_hat, (30)"),
        Signal("torque_command", "N.m", "torque before any saturation, (24)", ("tau_1", "tau_2")),
        Signal("drive_gain", "1", "(1, 1) entry of B2, (3)", singular_at_zero="the law is singular"),
        Signal("det_R", "1", "determinant of R, (8)", singular_at_zero="the formation model is singular"),
    )

    def __init__(self, team: Team, gains: NeuralAdaptivePidGains | None = None) -> None:
        super().__init__(team, gains)
        self._gains = gain_records([self.gains] * team.size)
        self._vehicle = vehicle_record(team.vehicle)

    def state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Return name and shape, per robot, of every state of the law."""
        return {
            "bearing": (),  # of the last tick, to unwrap the next one
            "q_hat": (2,),
            "p": (2,),
            "zeta": (2,),
            "epsilon_hat_integral": (2,),  # of q_hat - q_d, in (24)
            "epsilon_q_tilde_integral": (2,),  # of (q - q_d) + q_tilde, in (25)
            "W": (2, len(self.gains.centres)),
            "theta": (),
        }

    def on_start(self, pose: Floats, leader: Leader, desired: Desired) -> None:
        """Set q_hat(0) = q(0), so that q_tilde(0) = 0; everything else starts at zero."""
        q = range_bearing(pose, leader.pose, self.team.vehicle)
        q[:, 1] = unwrapped_bearing(q[np.newaxis, :, 1], desired.q[np.newaxis, :, 1])[0]
        self._state["q_hat"] = q
        self._state["bearing"] = q[:, 1]

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
    e: tuple[float, float, float, float],
    leader_steering: float,
    leader_velocity: Floats,
    q_hat_dot: Floats,
    q_d_dot: Floats,
    q_d_ddot: Floats,
) -> None:
    """Fill x_w = (e, gamma_d, v_d, omega_d, q_hat_dot, q_d_dot, q_d_ddot); the estimate stands for q_dot."""
    x[0], x[1], x[2], x[3] = e
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
    car = vehicle[0]
    x_w = np.empty(NETWORK_INPUTS)
    sigma = np.empty(len(gains[0]["centres"]))
    pairs = np.empty((6, 2))
    q, q_tilde, q_hat_dot, epsilon_hat, s, u = pairs[0], pairs[1], pairs[2], pairs[3], pairs[4], pairs[5]

    for i in range(len(pose)):
        own, g, out = state[i], gains[i], telemetry[i]
        W, theta = own["W"], own["theta"]

        # Geometry, (4), (7), (8)
        e = kinematics.posture_error(pose[i], leader_pose)
        steering = kinematics.steering_angle(pose[i])
        rho, phi = kinematics.line_of_sight(e[0], e[1], car["length"])
        q[0], q[1] = rho, kinematics.unwrapped(phi - steering, own["bearing"])
        r_11, r_12, r_21, r_22 = kinematics.rate_matrix(rho, phi, steering, car["length"])
        delta_1, delta_2 = kinematics.leader_rates(rho, phi, e[2], leader_velocity[0])
        b_11, b_12, b_21, b_22 = kinematics.input_matrix(pose[i], car)

        # Observer (32) and filtered error s = s_c_hat + s_o_hat, (25)
        for j in range(2):
            q_tilde[j] = q[j] - own["q_hat"][j]
            q_hat_dot[j] = observer.rate_estimate(own["p"][j], q_tilde[j], g["Lambda_0"][j], g["k_d"])
            epsilon_hat[j] = own["q_hat"][j] - q_d[i, j]
            s[j] = (
                q_hat_dot[j]
                - q_d_dot[i, j]
                + g["Lambda_0"][j] * (q[j] - q_d[i, j] + q_tilde[j])
                + g["Lambda_1"][j] * own["epsilon_q_tilde_integral"][j]
            )
        s_norm = math.sqrt(s[0] * s[0] + s[1] * s[1])

        # PID, network and robust term; torque, (24)
        steering_d = kinematics.steering_angle(leader_pose)
        network_input(x_w, e, steering_d, leader_velocity, q_hat_dot, q_d_dot[i], q_d_ddot[i])
        rbf.basis(x_w, g["centres"], g["widths"], sigma)
        robust = theta * theta / (theta * s_norm + g["epsilon_t"])
        for j in range(2):
            pid = (
                q_hat_dot[j]
                - q_d_dot[i, j]
                + g["Lambda_0"][j] * epsilon_hat[j]
                + g["Lambda_1"][j] * own["epsilon_hat_integral"][j]
            )
            u[j] = -g["K_p"][j] * pid - rbf.output(W, sigma, j) - robust * s[j]
        torque[i, 0], torque[i, 1] = kinematics.solve_2x2(
            b_11, b_12, b_21, b_22, r_11 * u[0] + r_21 * u[1], r_12 * u[0] + r_22 * u[1]
        )

        out["range_estimate"], out["bearing_estimate"] = own["q_hat"][0], own["q_hat"][1]
        out["range_rate_estimate"], out["bearing_rate_estimate"] = q_hat_dot[0], q_hat_dot[1]
        out["speed_estimate"], out["steering_rate_estimate"] = kinematics.solve_2x2(
            r_11, r_12, r_21, r_22, q_hat_dot[0] - delta_1, q_hat_dot[1] - delta_2
        )
        out["weight_norm"] = math.sqrt(projection.norm_squared(W))
        out["gain_estimate"] = theta
        out["torque_command"][0], out["torque_command"][1] = torque[i, 0], torque[i, 1]
        out["drive_gain"] = b_11
        out["det_R"] = r_11 * r_22 - r_12 * r_21

        # Adaptation (28) to (30), observer (33), (34), integrals: explicit Euler, values of this tick
        projection.step_weights(W, s, sigma, g["gamma_w"], g["W_m"], period)
        own["theta"] = projection.step_gain(theta, s_norm, g["gamma_theta"], g["theta_m"], period)
        for j in range(2):
            p_dot = observer.p_dot(
                own["zeta"][j], q_tilde[j], q_d_ddot[i, j], g["Lambda_0"][j], g["Lambda_1"][j], g["k_d"]
            )
            own["zeta"][j] += period * observer.zeta_dot(q_tilde[j], g["Lambda_1"][j], g["k_d"])
            own["p"][j] += period * p_dot
            own["q_hat"][j] += period * q_hat_dot[j]
            own["epsilon_hat_integral"][j] += period * epsilon_hat[j]
            own["epsilon_q_tilde_integral"][j] += period * (q[j] - q_d[i, j] + q_tilde[j])
        own["bearing"] = q[1]
