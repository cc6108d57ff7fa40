"""Observer-based PID control, (24) without its network and its robust term, and the parts shared with that law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from formation_controllers import robot_view, saturation, velocity_observer
from formation_controllers.columns import BLOCK
from formation_controllers.compiled import borrowing, part
from formation_controllers.compiled_law import CompiledLaw, TeamRecords
from formation_controllers.gains import gain
from formation_controllers.interface import Floats, Signal, TickInputs
from formation_controllers.robot_view import RobotView
from formation_controllers.saturation import HELD_SIGNAL, LimitGains
from formation_controllers.singularities import TORQUE_SIGNALS

DEFINITE: Final = "the matrix must be positive definite"


@dataclass(frozen=True)
class ObserverPidGains(LimitGains):
    """Gains of the PID terms and of the observer; the defaults are those printed in section 5.1."""

    K_p: float | Sequence[float] = gain(
        10.0, "K_p", "N.s/m", "feedback of the filtered error, (24)", size=2, above=0, reason=DEFINITE
    )
    Lambda_0: float | Sequence[float] = gain(
        2.0, "Λ_0", "1/s", "weight of the error in the filtered error, (17), (18)", size=2, above=0, reason=DEFINITE
    )
    Lambda_1: float | Sequence[float] = gain(
        0.05, "Λ_1", "1/s2", "weight of its integral, (17), (18); zero switches it off", size=2, at_least=0
    )
    k_d: float = gain(10.0, "k_d", "1/s", "gain of the velocity observer, (32) to (34)", above=0)


OBSERVER_SIGNALS: Final = (
    Signal("range_estimate", "m", "estimated range, first entry of q_hat"),
    Signal("bearing_estimate", "rad", "estimated bearing, second entry of q_hat"),
    Signal("range_rate_estimate", "m/s", "estimated rate of the range, first entry of q_hat_dot, (32)"),
    Signal("bearing_rate_estimate", "rad/s", "estimated rate of the bearing, second entry of q_hat_dot, (32)"),
    Signal("speed_estimate", "m/s", "estimated linear velocity v_hat, (32)"),
    Signal("steering_rate_estimate", "rad/s", "estimated steering or angular velocity omega_hat, (32)"),
)


ERRORS: Final = dict.fromkeys(("q_tilde", "q_hat_dot", "epsilon_hat", "epsilon_q_tilde", "s", "pid"), (2,))
"""Columns of estimates and errors; s is s_c_hat + s_o_hat, and pid what K_p multiplies in (24)."""


@part
def estimate(q: Floats, c: np.void, r: int, own: np.void, g: np.void, q_d: Floats, q_d_dot: Floats) -> None:
    """Fill in a robot's estimate (32), filtered error (25) and PID terms of (24), in the columns `ERRORS`."""
    for j in range(2):
        q_tilde = q[j] - own["q_hat"][j]
        q_hat_dot = velocity_observer.rate_estimate(own["p"][j], q_tilde, g["Lambda_0"][j], g["k_d"])
        epsilon_hat = own["q_hat"][j] - q_d[j]
        epsilon_q_tilde = q[j] - q_d[j] + q_tilde
        c["q_tilde"][j, r], c["q_hat_dot"][j, r] = q_tilde, q_hat_dot
        c["epsilon_hat"][j, r], c["epsilon_q_tilde"][j, r] = epsilon_hat, epsilon_q_tilde
        c["s"][j, r] = (
            q_hat_dot
            - q_d_dot[j]
            + g["Lambda_0"][j] * epsilon_q_tilde
            + g["Lambda_1"][j] * own["epsilon_q_tilde_integral"][j]
        )
        c["pid"][j, r] = (
            q_hat_dot - q_d_dot[j] + g["Lambda_0"][j] * epsilon_hat + g["Lambda_1"][j] * own["epsilon_hat_integral"][j]
        )


@part
def report_estimate(view: RobotView, own: np.void, q_hat_dot: Floats, out: np.void) -> None:
    """Write the `OBSERVER_SIGNALS`."""
    out["range_estimate"], out["bearing_estimate"] = own["q_hat"][0], own["q_hat"][1]
    out["range_rate_estimate"], out["bearing_rate_estimate"] = q_hat_dot[0], q_hat_dot[1]
    out["speed_estimate"], out["steering_rate_estimate"] = robot_view.velocity(view, q_hat_dot[0], q_hat_dot[1])


@part
def advance(c: np.void, r: int, own: np.void, g: np.void, q_d_ddot: Floats, held: bool, period: float) -> None:
    """Advance observer (33), (34) and the control's integrals: explicit Euler, values of this tick.

    Saturation holds the integrals of the control but not those of the observer, whose equations contain no torque.
    """
    for j in range(2):
        q_tilde = c["q_tilde"][j, r]
        p_dot = velocity_observer.p_dot(
            own["zeta"][j], q_tilde, q_d_ddot[j], g["Lambda_0"][j], g["Lambda_1"][j], g["k_d"]
        )
        own["zeta"][j] += period * velocity_observer.zeta_dot(q_tilde, g["Lambda_1"][j], g["k_d"])
        own["p"][j] += period * p_dot
        own["q_hat"][j] += period * c["q_hat_dot"][j, r]
        if not held:
            own["epsilon_hat_integral"][j] += period * c["epsilon_hat"][j, r]
            own["epsilon_q_tilde_integral"][j] += period * c["epsilon_q_tilde"][j, r]


@borrowing
def tick(inputs: TickInputs, team: TeamRecords, torque: Floats) -> None:
    """Fill the torques of a team at one tick, and its telemetry, and advance its state by one period."""
    c, size = team.columns[0], len(inputs.pose)
    for first in range(0, size, BLOCK):
        count = min(BLOCK, size - first)
        robot_view.see(inputs, team, first, count)
        for r in range(count):
            i = first + r
            own, g, out = team.state[i], team.gains[i], team.telemetry[i]
            view = robot_view.view_of(team.seen[0], r)
            estimate(team.seen[0]["q"][:, r], c, r, own, g, inputs.q_d[i], inputs.q_d_dot[i])
            tau_1, tau_2 = robot_view.torque_of_formation_force(
                view, -g["K_p"][0] * c["pid"][0, r], -g["K_p"][1] * c["pid"][1, r]
            )
            torque[i, 0], torque[i, 1] = tau_1, tau_2
            held = saturation.beyond(tau_1, tau_2, g["torque_limit"])
            report_estimate(view, own, c["q_hat_dot"][:, r], out)
            robot_view.report(view, tau_1, tau_2, out)
            out["held"] = held
            advance(c, r, own, g, inputs.q_d_ddot[i], held, team.period)
            own["bearing"] = view.sight.bearing


@borrowing
def begin(inputs: TickInputs, team: TeamRecords) -> None:
    """Set the state of a team at time zero: q_hat(0) = q(0), so that q_tilde(0) = 0; everything else starts at zero."""
    for i in range(len(inputs.pose)):
        own = team.state[i]
        own["q_hat"][0], own["q_hat"][1] = robot_view.first_sight(inputs, team, i)
        own["bearing"] = own["q_hat"][1]


class ObserverPid(CompiledLaw[ObserverPidGains]):
    """Observer-based PID formation control: (24), (32) to (34) with W = 0 and theta = 0, by explicit Euler steps."""

    tick = staticmethod(tick)
    begin = staticmethod(begin)
    gains_type: type[ObserverPidGains] = ObserverPidGains
    signals: ClassVar[tuple[Signal, ...]] = (*OBSERVER_SIGNALS, *TORQUE_SIGNALS, HELD_SIGNAL)

    def own_state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Return name and shape, per robot, of every state but the bearing."""
        return {
            "q_hat": (2,),
            "p": (2,),
            "zeta": (2,),
            "epsilon_hat_integral": (2,),  # of q_hat - q_d, in (24)
            "epsilon_q_tilde_integral": (2,),  # of (q - q_d) + q_tilde, in (25)
        }

    def own_columns(self) -> dict[str, tuple[int, ...]]:
        """Return name and shape, per robot, of what the law's tick works out besides `robot_view.see`."""
        return {**ERRORS}
