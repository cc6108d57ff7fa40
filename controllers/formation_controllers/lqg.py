"""Linear-quadratic control of the linearised formation model with a Kalman filter.

(10) is linearised about the straight motion: leader and robot aligned at the speed v_0, wheels straight, at the range
and bearing desired at the start. State: the errors of range and bearing and their rates; input: the formation force
u = B tau less the one that keeps the leader's pace. What the robot's heading and steering do meanwhile is left to the
internal dynamics, as in the paper's law. Integrals of the errors make up for what the model does not say.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from formation_controllers import dynamics, kinematics, robot_view, saturation
from formation_controllers.analysis.linearisation import linearised
from formation_controllers.analysis.small_matrices import held, inverse, product, riccati, solve
from formation_controllers.columns import BLOCK
from formation_controllers.compiled import borrowing
from formation_controllers.compiled_law import CompiledLaw, TeamRecords
from formation_controllers.dynamics import ModelGains
from formation_controllers.errors import ControllerError
from formation_controllers.gains import gain, gain_info
from formation_controllers.interface import Desired, Floats, Leader, Signal, TickInputs
from formation_controllers.saturation import HELD_SIGNAL, LimitGains
from formation_controllers.singularities import TORQUE_SIGNALS
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


@borrowing
def tick(inputs: TickInputs, team: TeamRecords, torque: Floats) -> None:
    """Fill the torques of a team at one tick, and its telemetry, and advance its state by one period."""
    c, size, vehicle = team.columns[0], len(inputs.pose), team.vehicle
    v_d, v_d_dot = inputs.leader_velocity[0], inputs.leader_acceleration[0]
    straight = kinematics.steering_of(0.0)
    for first in range(0, size, BLOCK):
        count = min(BLOCK, size - first)
        robot_view.see(inputs, team, first, count)
        for r in range(count):
            i = first + r
            own, g, out = team.state[i], team.gains[i], team.telemetry[i]
            x_hat, Phi, Gamma, K, L, M = own["x_hat"], own["Phi"], own["Gamma"], own["K"], own["L"], own["M"]
            view, x = robot_view.view_of(team.seen[0], r), c["x"][:, r]
            epsilon_1, epsilon_2 = view.sight.rho - inputs.q_d[i, 0], view.sight.bearing - inputs.q_d[i, 1]

            # Kalman filter
            for j in range(STATES):
                x[j] = x_hat[j] + L[j, 0] * (epsilon_1 - x_hat[0]) + L[j, 1] * (epsilon_2 - x_hat[1])
            x[STATES], x[STATES + 1] = own["integral"][0], own["integral"][1]

            # Formation force: feedback, and what the wanted acceleration and the leader's pace take
            u_1, u_2 = 0.0, 0.0
            for k in range(STATES + 2):
                u_1 -= K[0, k] * x[k]
                u_2 -= K[1, k] * x[k]
            w_1 = u_1 + M[0, 0] * inputs.q_d_ddot[i, 0] + M[0, 1] * inputs.q_d_ddot[i, 1]
            w_2 = u_2 + M[1, 0] * inputs.q_d_ddot[i, 0] + M[1, 1] * inputs.q_d_ddot[i, 1]
            d_1, _ = dynamics.damping(view.heading, straight, vehicle, g)
            pace = g["m"] * v_d_dot + d_1 * v_d
            f_1, f_2 = robot_view.along_velocities(view, w_1, w_2)
            tau_1, tau_2 = robot_view.torque_of(view, f_1 + pace, f_2)
            torque[i, 0], torque[i, 1] = tau_1, tau_2

            limit = g["torque_limit"]
            held = saturation.beyond(tau_1, tau_2, limit)
            out["range_estimate"], out["bearing_estimate"] = inputs.q_d[i, 0] + x[0], inputs.q_d[i, 1] + x[1]
            out["range_rate_estimate"], out["bearing_rate_estimate"] = (
                inputs.q_d_dot[i, 0] + x[2],
                inputs.q_d_dot[i, 1] + x[3],
            )
            robot_view.report(view, tau_1, tau_2, out)
            out["held"] = held

            if not held:
                own["integral"][0] += team.period * epsilon_1
                own["integral"][1] += team.period * epsilon_2
            else:
                # The force that would change q_ddot by as much as the clipped part of the torque does
                lost_1, lost_2 = saturation.clipped(tau_1, limit) - tau_1, saturation.clipped(tau_2, limit) - tau_2
                B2, R = view.B2, view.rates.R
                v_dot, omega_dot = kinematics.solve_2x2(
                    dynamics.inertia(view.steering, vehicle, g),
                    B2.m_11 * lost_1 + B2.m_12 * lost_2,
                    B2.m_21 * lost_1 + B2.m_22 * lost_2,
                )
                q_1_ddot = R.m_11 * v_dot + R.m_12 * omega_dot
                q_2_ddot = R.m_21 * v_dot + R.m_22 * omega_dot
                u_1 += M[0, 0] * q_1_ddot + M[0, 1] * q_2_ddot
                u_2 += M[1, 0] * q_1_ddot + M[1, 1] * q_2_ddot
            for j in range(STATES):
                x_hat[j] = Gamma[j, 0] * u_1 + Gamma[j, 1] * u_2
                for k in range(STATES):
                    x_hat[j] += Phi[j, k] * x[k]
            own["bearing"] = view.sight.bearing


@borrowing
def begin(inputs: TickInputs, team: TeamRecords) -> None:
    """Set the state of a team at time zero, given the design: the estimate is the measured error, its rate zero."""
    for i in range(len(inputs.pose)):
        own = team.state[i]
        rho, own["bearing"] = robot_view.first_sight(inputs, team, i)
        own["x_hat"][0], own["x_hat"][1] = rho - inputs.q_d[i, 0], own["bearing"] - inputs.q_d[i, 1]


class Lqg(CompiledLaw[LqgGains]):
    """Linear-quadratic control with a Kalman filter and integral action.

    Designed at the start, for each follower alone. It speaks to the robot through B^-1 of (10) at the present pose and
    knows nothing of other nonlinearities: far from a straight motion at v_0 it promises nothing. A torque beyond the
    `torque_limit` holds the integrals, and the filter predicts with the torque clipped to it, which is what saturated
    actuators apply: the clipped part changes q_ddot by R M2^-1 B2 (tau_clipped - tau), at the present pose.
    """

    tick = staticmethod(tick)
    begin = staticmethod(begin)
    prepared: ClassVar[tuple[str, ...]] = ("Phi", "Gamma", "K", "L", "M", "place", "designed_with")
    gains_type = LqgGains
    signals: ClassVar[tuple[Signal, ...]] = (
        Signal("range_estimate", "m", "estimated range"),
        Signal("bearing_estimate", "rad", "estimated bearing"),
        Signal("range_rate_estimate", "m/s", "estimated rate of the range"),
        Signal("bearing_rate_estimate", "rad/s", "estimated rate of the bearing"),
        *TORQUE_SIGNALS,
        HELD_SIGNAL,
    )

    def own_state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Return name and shape, per robot, of every state but the bearing; the design is among them."""
        return {
            "x_hat": (STATES,),  # predicted for this tick
            "integral": (2,),
            "Phi": (STATES, STATES),
            "Gamma": (STATES, 2),
            "K": (2, STATES + 2),
            "L": (STATES, 2),
            "M": (2, 2),
            "place": (2,),  # the desired range and bearing of the design
            "designed_with": _numbers(self.robot_gains[0]).shape,
        }

    def own_columns(self) -> dict[str, tuple[int, ...]]:
        """Return name and shape, per robot, of what the law's tick works out besides `robot_view.see`."""
        return {"x": (STATES + 2,)}

    def on_start(self, pose: Floats, leader: Leader, desired: Desired) -> None:
        """Design for the desired range and bearing, then start the estimate."""
        for robot in range(self.team.size):
            self._design_of(robot, desired.q[robot])
        super().on_start(pose, leader, desired)

    def set_state(self, state: Mapping[str, ArrayLike]) -> None:
        """Go on from a state, see `Controller.set_state`; a robot that had other gains is designed for anew.

        Raises
        ------
        ControllerError
            Also if no design exists for the gains.
        """
        before = self._state.copy(), self._telemetry.copy(), self._started
        super().set_state(state)
        try:
            for robot, (own, gains) in enumerate(zip(self._state, self.robot_gains, strict=True)):
                if not np.array_equal(own["designed_with"], _numbers(gains)):
                    self._design_of(robot, own["place"])
        except BaseException:
            self._state[...], self._telemetry[...], self._started = before
            raise

    def _design_of(self, robot: int, place: Floats) -> None:
        """Set the prepared states of a robot for a desired range and bearing."""
        gains = self.robot_gains[robot]
        try:
            design = _design(self.team.vehicle, gains, self.team.period, *map(float, place))
        except ControllerError as error:
            raise ControllerError(error.message, robot=robot) from None
        for name, values in zip(self.prepared, (*design, place, _numbers(gains)), strict=True):
            self._state[robot][name] = values


def _numbers(gains: LqgGains) -> Floats:
    """Return all gains as finite numbers, as states are: the torque limit may be infinite."""
    numbers: Floats = np.nan_to_num(np.hstack([getattr(gains, name) for name in gain_info(LqgGains)]))
    return numbers


@lru_cache(maxsize=1024)
def _design(
    vehicle: Vehicle, gains: LqgGains, period: float, rho: float, bearing: float
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Return Phi, Gamma, K, L and M for one desired range and bearing."""
    A, B, M = linearised(vehicle, gains, gains.v_0, rho, bearing)
    Phi, Gamma = held(A, B, period)
    seen, nothing = np.eye(2, STATES), np.zeros((2, 2))
    with_integrals = np.block([[Phi, np.zeros((STATES, 2))], [period * seen, np.eye(2)]])
    pushed = np.vstack([Gamma, nothing])
    with np.errstate(all="ignore"):  # what is too large for a square weighs nothing
        weights = np.diag(1.0 / np.square(np.concatenate([gains.q_max, gains.rate_max, gains.integral_max])))
        cost, noise = np.diag(1.0 / np.square(gains.force_max)), np.diag(np.square(gains.q_noise))
    try:
        X = riccati(with_integrals, pushed, weights, cost)
        K = solve(cost + product(pushed.T, X, pushed), product(pushed.T, X, with_integrals))
        disturbed = product(Gamma, np.diag(np.square(gains.force_noise)), Gamma.T)
        P = riccati(Phi.T, seen.T, disturbed, noise)  # of the prediction
        L = product(P, seen.T, inverse(product(seen, P, seen.T) + noise))
    except np.linalg.LinAlgError as error:
        raise ControllerError(
            f"no linear-quadratic design exists for a range of {rho:g} m and a bearing of {bearing:g} rad: {error}"
        ) from None
    return Phi, Gamma, K, L, M
