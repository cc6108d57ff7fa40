"""The paper's comparator: neural backstepping with a high-gain observer, (58) and (59)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

from formation_controllers import network, projection, robot_view, saturation
from formation_controllers.columns import BLOCK
from formation_controllers.compiled import borrowing, vectors_of_four
from formation_controllers.compiled_law import CompiledLaw, TeamRecords
from formation_controllers.errors import GainError
from formation_controllers.gains import gain
from formation_controllers.interface import Floats, Signal, Team, TickInputs
from formation_controllers.network import NetworkGains
from formation_controllers.saturation import HELD_SIGNAL, LimitGains
from formation_controllers.singularities import TORQUE_SIGNALS


@dataclass(frozen=True)
class NeuralHighGainGains(NetworkGains, LimitGains):
    """Gains of (58) and (59). The paper prints none; these settle its scenarios and are not tuned further."""

    K_1: float | Sequence[float] = gain(0.6, "K_1", "1/s", "feedback of q - q_d, (58)", size=2, above=0)
    K_2: float | Sequence[float] = gain(
        60.0, "K_2", "N.s/m", "feedback of v_hat - alpha_1, (58); the second entry in N.m.s/rad", size=2, above=0
    )
    Gamma: float = gain(
        10.0, "Γ", "N/m", "adaptation gain of the weights, (58)", at_least=0, reason="zero switches it off"
    )
    sigma: float = gain(0.01, "σ", "m/(N.s)", "leakage of the weights, (58); Γσ is its rate", at_least=0)
    epsilon: float = gain(0.1, "ε", "s", "time constant of the observer, (59)", above=0)
    gamma_1: float = gain(2.0, "γ_1", "1", "damping of the observer, (59); 2 is critical", above=0)


NETWORK_INPUTS: Final = 8


@borrowing
def tick(inputs: TickInputs, team: TeamRecords, torque: Floats) -> None:
    """Fill the torques of a team at one tick, and its telemetry, and advance its state by one period."""
    vectors_of_four()
    c, size = team.columns[0], len(inputs.pose)
    q, z_1, z_2, alpha, q_hat_dot, v_hat = team.seen[0]["q"], c["z_1"], c["z_2"], c["alpha"], c["q_hat_dot"], c["v_hat"]
    for first in range(0, size, BLOCK):
        count = min(BLOCK, size - first)
        robot_view.see(inputs, team, first, count)

        # (58), with q_hat_dot of (59); the network's input Z
        for r in range(count):
            i = first + r
            own, g, view, Z = team.state[i], team.gains[i], robot_view.view_of(team.seen[0], r), c["x"][:, r]
            for j in range(2):
                z_1[j, r] = q[j, r] - inputs.q_d[i, j]
                q_hat_dot[j, r] = own["pi_2"][j] / g["epsilon"]
            alpha[0, r], alpha[1, r] = robot_view.velocity(
                view, inputs.q_d_dot[i, 0] - g["K_1"][0] * z_1[0, r], inputs.q_d_dot[i, 1] - g["K_1"][1] * z_1[1, r]
            )
            v_hat[0, r], v_hat[1, r] = robot_view.velocity(view, q_hat_dot[0, r], q_hat_dot[1, r])
            for j in range(2):
                z_2[j, r] = v_hat[j, r] - alpha[j, r]
                Z[j], Z[2 + j], Z[4 + j] = q[j, r], v_hat[j, r], alpha[j, r]
                Z[6 + j] = (alpha[j, r] - own["alpha_1"][j]) / team.period if own["ticks"] > 0 else 0.0
        network.basis(c, team.gains, first, count)

        for r in range(count):
            i = first + r
            own, g, out = team.state[i], team.gains[i], team.telemetry[i]
            view, Theta, S = robot_view.view_of(team.seen[0], r), own["Theta"], network.sigma_of(c, r, count)
            f_1, f_2 = robot_view.along_velocities(view, z_1[0, r], z_1[1, r])
            tau_1, tau_2 = robot_view.torque_of(
                view,
                -f_1 + (network.output(Theta, S, 0) - g["K_2"][0] * z_2[0, r]),
                -f_2 + (network.output(Theta, S, 1) - g["K_2"][1] * z_2[1, r]),
            )
            torque[i, 0], torque[i, 1] = tau_1, tau_2

            held = saturation.beyond(tau_1, tau_2, g["torque_limit"])
            out["range_rate_estimate"], out["bearing_rate_estimate"] = q_hat_dot[0, r], q_hat_dot[1, r]
            out["speed_estimate"], out["steering_rate_estimate"] = v_hat[0, r], v_hat[1, r]
            out["speed_wanted"], out["steering_rate_wanted"] = alpha[0, r], alpha[1, r]
            out["weight_norm"] = math.sqrt(projection.norm_squared(Theta))
            robot_view.report(view, tau_1, tau_2, out)
            out["held"] = held

            # Weights (58) and observer (59): explicit Euler, values of this tick
            for j in range(2):
                if not held:
                    for k in range(Theta.shape[1]):
                        Theta[j, k] -= team.period * g["Gamma"] * (S[k] * z_2[j, r] + g["sigma"] * Theta[j, k])
                pi_2 = own["pi_2"][j]
                own["pi_2"][j] += team.period / g["epsilon"] * (q[j, r] - own["pi_1"][j] - g["gamma_1"] * pi_2)
                own["pi_1"][j] += team.period / g["epsilon"] * pi_2
                own["alpha_1"][j] = alpha[j, r]
            own["ticks"] += 1
            own["bearing"] = q[1, r]


@borrowing
def begin(inputs: TickInputs, team: TeamRecords) -> None:
    """Set the state of a team at time zero: pi_1(0) = q(0); everything else starts at zero."""
    for i in range(len(inputs.pose)):
        own = team.state[i]
        own["pi_1"][0], own["pi_1"][1] = robot_view.first_sight(inputs, team, i)
        own["bearing"] = own["pi_1"][1]


class NeuralHighGain(CompiledLaw[NeuralHighGainGains]):
    """Neural backstepping with a high-gain observer, (58) and (59), by explicit Euler steps.

    Open points of the paper are read as follows. There are two networks, one for each entry of z_2_hat (three are
    printed), with the centres and widths of the other law; z_2_hat and the weights belong to (v, omega). The rate of
    alpha_1 in their input is its change since the last tick over the period, at first zero. pi_1(0) = q(0), and
    pi_2(0) = 0.
    """

    tick = staticmethod(tick)
    begin = staticmethod(begin)
    gains_type = NeuralHighGainGains
    signals: ClassVar[tuple[Signal, ...]] = (
        Signal("range_rate_estimate", "m/s", "estimated rate of the range, first entry of q_hat_dot, (59)"),
        Signal("bearing_rate_estimate", "rad/s", "estimated rate of the bearing, second entry of q_hat_dot, (59)"),
        Signal("speed_estimate", "m/s", "estimated linear velocity v_hat, (58)"),
        Signal("steering_rate_estimate", "rad/s", "estimated steering or angular velocity omega_hat, (58)"),
        Signal("speed_wanted", "m/s", "first entry of alpha_1, (58)"),
        Signal("steering_rate_wanted", "rad/s", "second entry of alpha_1, (58)"),
        Signal("weight_norm", "N", "Frobenius norm of the networks' weights Theta, (58)"),
        *TORQUE_SIGNALS,
        HELD_SIGNAL,
    )

    def __init__(self, team: Team, gains: NeuralHighGainGains | Sequence[NeuralHighGainGains] | None = None) -> None:
        super().__init__(team, gains)
        for robot, own in enumerate(self.robot_gains):
            x = team.period / own.epsilon
            # Jury's conditions for Euler steps of (59), whose characteristic polynomial is s^2 + gamma_1 s + 1 in
            # units of epsilon
            if not (x < own.gamma_1 and 4 - 2 * x * own.gamma_1 + x * x > 0):
                raise GainError(
                    f"gain 'epsilon' is {own.epsilon:g} and 'gamma_1' {own.gamma_1:g}: "
                    f"Euler steps of {team.period:g} s make the observer unstable",
                    robot=robot,
                )

    def own_state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Return name and shape, per robot, of every state but the bearing."""
        return {
            "pi_1": (2,),
            "pi_2": (2,),
            "Theta": (2, len(self.robot_gains[0].centres)),
            "alpha_1": (2,),  # of the last tick
            "ticks": (),
        }

    def own_columns(self) -> dict[str, tuple[int, ...]]:
        """Return name and shape, per robot, of what the law's tick works out besides `robot_view.see`."""
        pairs = dict.fromkeys(("z_1", "z_2", "alpha", "q_hat_dot", "v_hat"), (2,))
        return {**pairs, **network.columns(NETWORK_INPUTS, len(self.robot_gains[0].centres))}
