"""Linear-quadratic control of the linearised formation model with a Kalman filter, designed with python-control.

(10) is linearised about the straight motion: leader and robot aligned at the speed v_0, wheels straight, at the range
and bearing desired at the start. State: the errors of range and bearing and their rates; input: the formation force
u = B tau less the one that keeps the leader's pace. What the robot's heading and steering do meanwhile is left to the
internal dynamics, as in the paper's law. Integrals of the errors make up for what the model does not say.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from formation_controllers import dynamics, kinematics, sight
from formation_controllers.compiled import compiled
from formation_controllers.controller import Controller
from formation_controllers.dynamics import ModelGains
from formation_controllers.errors import ControllerError
from formation_controllers.formation_model import COSINE_MIN, FormationModel, ReducedDynamics, formation_model
from formation_controllers.gains import gain, gain_records
from formation_controllers.geometry import first_range_bearing
from formation_controllers.interface import Desired, Floats, Leader, Signal, Team
from formation_controllers.kinematics import vehicle_record
from formation_controllers.sight import HELD_SIGNAL, TORQUE_SIGNALS, LimitGains
from formation_controllers.vehicles import Vehicle

STATES: Final = 4


@dataclass(frozen=True)
class LqgGains(ModelGains, LimitGains):
    """Weights of the design, as errors and forces that weigh the same, and the model; see `ModelGains`."""

    v_0: float = gain(0.32, "v_0", "m/s", "speed about which (10) is linearised", at_least=0)
    q_max: float | Sequence[float] = gain(1.0, "-", "m", "error of range and bearing that weighs one", size=2, above=0)
    rate_max: float | Sequence[float] = gain(1.0, "-", "m/s", "rate of that error that weighs one", size=2, above=0)
    integral_max: float | Sequence[float] = gain(
        5.0, "-", "m.s", "integral of that error that weighs one", size=2, above=0
    )
    force_max: float | Sequence[float] = gain(
        20.0, "-", "N", "force along range and bearing, B tau of (10), that weighs one", size=2, above=0
    )
    force_noise: float | Sequence[float] = gain(
        5.0, "-", "N", "standard deviation of the force along range and bearing that disturbs a tick", size=2, above=0
    )
    q_noise: float | Sequence[float] = gain(
        0.002, "-", "m", "standard deviation of measured range and bearing", size=2, above=0
    )


class Lqg(Controller[LqgGains]):
    """Linear-quadratic control with a Kalman filter and integral action; needs python-control, the extra ``lqg``.

    Designed at the start, for each follower alone. It speaks to the robot through B^-1 of (10) at the present pose and
    knows nothing of other nonlinearities: far from a straight motion at v_0 it promises nothing. A torque beyond the
    `torque_limit` holds the integrals, and the filter predicts with the torque clipped to it, which is what saturated
    actuators apply: the clipped part changes q_ddot by R M2^-1 B2 (tau_clipped - tau), at the present pose.
    """

    interface: ClassVar[str] = "1.1"
    vehicles: ClassVar[tuple[str, ...]] = ("car_like", "tractor_trailer")
    gains_type = LqgGains
    signals: ClassVar[tuple[Signal, ...]] = (
        Signal("range_estimate", "m", "estimated range"),
        Signal("bearing_estimate", "rad", "estimated bearing"),
        Signal("range_rate_estimate", "m/s", "estimated rate of the range"),
        Signal("bearing_rate_estimate", "rad/s", "estimated rate of the bearing"),
        *TORQUE_SIGNALS,
        HELD_SIGNAL,
    )

    def __init__(self, team: Team, gains: LqgGains | Sequence[LqgGains] | None = None) -> None:
        super().__init__(team, gains)
        if importlib.util.find_spec("control") is None:
            raise ControllerError("Lqg needs python-control: pip install 'formation-controllers[lqg]'")
        self._gains = gain_records(self.robot_gains)
        self._vehicle = vehicle_record(team.vehicle)

    def state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Return name and shape, per robot, of every state of the law; the design is among them."""
        return {
            "bearing": (),  # of the last tick, to unwrap the next one
            "x_hat": (STATES,),  # predicted for this tick
            "integral": (2,),
            "Phi": (STATES, STATES),
            "Gamma": (STATES, 2),
            "K": (2, STATES + 2),
            "L": (STATES, 2),
            "M": (2, 2),
        }

    def on_start(self, pose: Floats, leader: Leader, desired: Desired) -> None:
        """Design for the desired range and bearing; the estimate starts at the measured error, its rate at zero."""
        q = first_range_bearing(pose, leader.pose, desired.q, self.team.vehicle)
        self._state["bearing"] = q[:, 1]
        self._state["x_hat"][:, :2] = q - desired.q
        for robot, (own, gains) in enumerate(zip(self._state, self.robot_gains, strict=True)):
            try:
                design = _design(self.team.vehicle, gains, self.team.period, *map(float, desired.q[robot]))
            except ControllerError as error:
                raise ControllerError(error.message, robot=robot) from None
            for name, matrix in zip(("Phi", "Gamma", "K", "L", "M"), design, strict=True):
                own[name] = matrix

    def on_step(self, pose: Floats, leader: Leader, desired: Desired) -> Floats:
        """Return the torques, then predict the state of the next tick."""
        torque = np.empty((self.team.size, 2))
        tick(
            pose,
            leader.pose,
            leader.velocity,
            0.0 if leader.acceleration is None else leader.acceleration[0],
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


@lru_cache(maxsize=1024)
def _design(
    vehicle: Vehicle, gains: LqgGains, period: float, rho: float, bearing: float
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Return Phi, Gamma, K, L and M for one desired range and bearing."""
    import control

    A, B, M = linearised(vehicle, gains, rho, bearing)
    plant = control.c2d(control.ss(A, B, np.eye(STATES), 0), period)
    Phi, Gamma = np.asarray(plant.A), np.asarray(plant.B)
    seen, nothing = np.eye(2, STATES), np.zeros((2, 2))
    with_integrals = np.block([[Phi, np.zeros((STATES, 2))], [period * seen, np.eye(2)]])
    weights = np.square(np.concatenate([gains.q_max, gains.rate_max, gains.integral_max])) ** -1.0
    cost, noise = np.square(gains.force_max) ** -1.0, np.diag(np.square(gains.q_noise))
    try:
        K, _, _ = control.dlqr(with_integrals, np.vstack([Gamma, nothing]), np.diag(weights), np.diag(cost))
        _, P, _ = control.dlqe(Phi, Gamma, seen, np.diag(np.square(gains.force_noise)), noise)  # P of the prediction
    except (np.linalg.LinAlgError, ValueError) as error:
        raise ControllerError(
            f"no linear-quadratic design exists for a range of {rho:g} m and a bearing of {bearing:g} rad: {error}"
        ) from None
    return Phi, Gamma, np.asarray(K), P @ seen.T @ np.linalg.inv(seen @ P @ seen.T + noise), M


def linearised(vehicle: Vehicle, gains: LqgGains, rho: float, bearing: float) -> tuple[Floats, Floats, Floats]:
    """Linearise the formation model (10) about the straight motion: M epsilon_ddot + D epsilon_dot + K epsilon = u.

    Returns
    -------
    A : ndarray
        Shape (4, 4), of the state (epsilon, epsilon_dot).
    B : ndarray
        Shape (4, 2), of the formation force u.
    M : ndarray
        Inertia of (10), shape (2, 2).

    Raises
    ------
    ControllerError
        If the range is zero or the bearing is 90 degrees, where R is singular.
    """
    if rho <= 0 or abs(math.cos(bearing)) < COSINE_MIN:
        raise ControllerError(f"a range of {rho:g} m at a bearing of {bearing:g} rad is singular, (8)")
    reduced = ReducedDynamics.of_vehicle(vehicle, gains)
    length = float(vehicle_record(vehicle)[0]["length"])
    leader_velocity = np.array([gains.v_0, 0.0])

    def model(q_1: float, q_2: float) -> FormationModel:
        leader = np.array([length + q_1 * math.cos(q_2), q_1 * math.sin(q_2), 0.0, 0.0])
        return formation_model(np.zeros(4), Leader(leader, leader_velocity), np.zeros(2), vehicle, reduced, exact=True)

    def held(q_1: float, q_2: float) -> Floats:
        """Return the formation force that holds range and bearing, less the one that keeps the leader's pace."""
        here = model(q_1, q_2)
        return here.f - np.linalg.solve(here.R.T, reduced.at(np.zeros(4))[1] @ leader_velocity)

    here, step = model(rho, bearing), 1e-5
    stiffness = np.column_stack(
        [
            held(rho + step, bearing) - held(rho - step, bearing),
            held(rho, bearing + step) - held(rho, bearing - step),
        ]
    ) / (2 * step)
    A = np.block(
        [
            [np.zeros((2, 2)), np.eye(2)],
            [-np.linalg.solve(here.M, stiffness), -np.linalg.solve(here.M, here.C + here.D - here.D_bar)],
        ]
    )
    return A, np.vstack([np.zeros((2, 2)), np.linalg.inv(here.M)]), here.M


@compiled
def clipped(torque: float, limit: float) -> float:
    """Return what an actuator with this limit applies."""
    return min(max(torque, -limit), limit)


@compiled
def tick(
    pose: Floats,
    leader_pose: Floats,
    leader_velocity: Floats,
    v_d_dot: float,
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
    car, v_d = vehicle[0], leader_velocity[0]
    x = np.empty(STATES + 2)
    for i in range(len(pose)):
        own, g, out = state[i], gains[i], telemetry[i]
        x_hat, Phi, Gamma, K, L, M = own["x_hat"], own["Phi"], own["Gamma"], own["K"], own["L"], own["M"]
        seen = sight.look(pose[i], leader_pose, v_d, own["bearing"], car, g["guard"])
        epsilon_1, epsilon_2 = seen.rho - q_d[i, 0], seen.bearing - q_d[i, 1]

        # Kalman filter
        for j in range(STATES):
            x[j] = x_hat[j] + L[j, 0] * (epsilon_1 - x_hat[0]) + L[j, 1] * (epsilon_2 - x_hat[1])
        x[STATES], x[STATES + 1] = own["integral"][0], own["integral"][1]

        # Formation force: feedback, and what the wanted acceleration and the leader's pace take
        u_1, u_2 = 0.0, 0.0
        for k in range(STATES + 2):
            u_1 -= K[0, k] * x[k]
            u_2 -= K[1, k] * x[k]
        w_1 = u_1 + M[0, 0] * q_d_ddot[i, 0] + M[0, 1] * q_d_ddot[i, 1]
        w_2 = u_2 + M[1, 0] * q_d_ddot[i, 0] + M[1, 1] * q_d_ddot[i, 1]
        d_1, _ = dynamics.damping(pose[i, 2], 0.0, car, g)
        pace = g["m"] * v_d_dot + d_1 * v_d
        tau_1, tau_2 = sight.torque_of(
            seen, seen.r_11 * w_1 + seen.r_21 * w_2 + pace, seen.r_12 * w_1 + seen.r_22 * w_2
        )
        torque[i, 0], torque[i, 1] = tau_1, tau_2

        held = sight.beyond(tau_1, tau_2, g["torque_limit"])
        out["range_estimate"], out["bearing_estimate"] = q_d[i, 0] + x[0], q_d[i, 1] + x[1]
        out["range_rate_estimate"], out["bearing_rate_estimate"] = q_d_dot[i, 0] + x[2], q_d_dot[i, 1] + x[3]
        sight.report(seen, tau_1, tau_2, out)
        out["held"] = held

        if not held:
            own["integral"][0] += period * epsilon_1
            own["integral"][1] += period * epsilon_2
        else:
            # The force that would change q_ddot by as much as the clipped part of the torque does
            lost_1, lost_2 = clipped(tau_1, g["torque_limit"]) - tau_1, clipped(tau_2, g["torque_limit"]) - tau_2
            m_11, m_12, m_22 = dynamics.inertia(seen.steering, car, g)
            v_dot, omega_dot = kinematics.solve_2x2(
                m_11,
                m_12,
                m_12,
                m_22,
                seen.b_11 * lost_1 + seen.b_12 * lost_2,
                seen.b_21 * lost_1 + seen.b_22 * lost_2,
            )
            q_1_ddot = seen.r_11 * v_dot + seen.r_12 * omega_dot
            q_2_ddot = seen.r_21 * v_dot + seen.r_22 * omega_dot
            u_1 += M[0, 0] * q_1_ddot + M[0, 1] * q_2_ddot
            u_2 += M[1, 0] * q_1_ddot + M[1, 1] * q_2_ddot
        for j in range(STATES):
            x_hat[j] = Gamma[j, 0] * u_1 + Gamma[j, 1] * u_2
            for k in range(STATES):
                x_hat[j] += Phi[j, k] * x[k]
        own["bearing"] = seen.bearing
