"""Why the first simulation does not settle as printed: the closed loop linearised about the steady formation.

    python studies/linearised.py

prints tables and draws ``docs/figures/linearised.png``. The leader drives straight at v_d, the follower holds its
desired range and bearing behind it. The model is derived by hand below and checked against numerical derivatives of
the very code that runs: the controller's tick and the plant's right-hand side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import control
import numpy as np
from formation_controllers import CarLike, Desired, Leader, Team, load
from formation_controllers.geometry import formation_rates, range_bearing
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pages import heading, row, save

import plants
from plants import numeric

Array = NDArray[np.float64]

PERIOD = 0.02
CENTRES = np.arange(-4.0, 5.0)
WIDTH = 10.0

# States: deviations from the steady formation. rho, beta: range and bearing; n: the network's output W sigma_0;
# E, F: the integrals in (24) and (25).
PLANT_STATES = ("rho", "beta", "psi", "gamma", "v", "omega")
PAIRS = ("q_hat", "p", "zeta", "E", "F", "n")
STATES = (*PLANT_STATES, *(f"{name}_{j}" for name in PAIRS for j in (1, 2)))
Q_HAT, P, ZETA, E, F, N = (slice(6 + 2 * k, 8 + 2 * k) for k in range(len(PAIRS)))


@dataclass(frozen=True)
class Loop:
    """A follower of the first simulation in its place, with the gains as printed.

    Attributes
    ----------
    rho, beta : float
        Desired range [m] and bearing [rad].
    theta : float
        Value of the robust gain [N]; it only ever grows, up to theta_m.
    amplitude : float
        Magnitude of s in the robust term [m/s]: zero for small errors. The term then acts on s as the gain
        theta^2/(theta |s| + epsilon_t).
    sigma_varies : bool
        Whether the basis functions vary with the network's input, or stay as they are in the steady formation.
    """

    rho: float = 3.0
    beta: float = math.radians(45)
    gamma_w: float = 10.0
    K_p: float = 10.0
    Lambda_0: float = 2.0
    Lambda_1: float = 0.05
    k_d: float = 10.0
    epsilon_t: float = 10.0
    theta: float = 10.0
    amplitude: float = 0.0
    sigma_varies: bool = True
    v_d: float = 0.32
    a: float = 1.2
    m: float = 30.0
    I_f: float = 10.0
    d: float = 25.0

    @property
    def robust_gain(self) -> float:
        """The factor of s in the robust term of (24)."""
        return self.theta**2 / (self.theta * self.amplitude + self.epsilon_t)

    @property
    def network_input(self) -> Array:
        """x_w in the steady formation (13,)."""
        x = np.zeros(13)
        x[0], x[1], x[5] = self.a + self.rho * math.cos(self.beta), self.rho * math.sin(self.beta), self.v_d
        return x

    @property
    def sigma(self) -> Array:
        """Basis functions in the steady formation (9,), (11)."""
        return np.exp(-np.sum((self.network_input[:, np.newaxis] - CENTRES) ** 2, axis=0) / WIDTH**2)

    @property
    def network_gain(self) -> float:
        """gamma_w sum sigma^2: the gain of the integrator that the network is [N/m]."""
        return float(self.gamma_w * np.sum(self.sigma**2))

    @property
    def weights(self) -> Array:
        """The least weights (2, 9) that hold the follower at v_d, where s and all integrals are zero: W sigma = -u."""
        n = np.array([self.d * self.v_d / math.cos(self.beta), 0.0])
        return np.outer(n, self.sigma) / np.sum(self.sigma**2)


# The model by hand -------------------------------------------------------------------------------------------


def vehicle_and_pid(loop: Loop) -> control.StateSpace:
    """Return all but the network, in the first 16 of `STATES`: input n, the network's output; output s of (25)."""
    c, s = math.cos(loop.beta), math.sin(loop.beta)
    A = np.zeros((16, 16))

    # (8) with phi = beta + gamma, e_3 = -psi: the terms in beta and rho alone cancel, as the formation moves as a whole
    rho, beta, psi, gamma, v, omega = range(6)
    A[rho, [v, psi, gamma]] = -c, -loop.v_d * s, -loop.v_d * s
    A[beta, [v, omega]] = s / loop.rho, -1.0
    A[beta, [psi, gamma]] = -loop.v_d * c / loop.rho, -loop.v_d * (c / loop.rho + 1 / loop.a)
    A[psi, gamma] = loop.v_d / loop.a
    A[gamma, omega] = 1.0
    # (3): of C2 only I_f v_d omega/a remains. The thrust d v_d turns with R: R_11 = -cos(beta)/cos(gamma)
    A[v, v] = -loop.d / loop.m
    A[omega, omega] = -loop.v_d / loop.a - loop.d / loop.I_f
    A[v, beta] = -loop.d * loop.v_d * s / c / loop.m
    force = np.zeros((16, 2))  # (v, omega)' per formation force u: M2^-1 R'
    force[v] = -c / loop.m, s / loop.rho / loop.m
    force[omega] = 0.0, -1 / loop.I_f

    # (32) to (34), (24), (25): one row for each component of q
    eye = np.eye(16)
    q, q_hat = eye[:2], eye[Q_HAT]
    q_tilde = q - q_hat
    q_hat_dot = eye[P] + (loop.Lambda_0 + loop.k_d) * q_tilde
    A[Q_HAT] = q_hat_dot
    A[P] = (loop.k_d * loop.Lambda_0 + loop.Lambda_1) * q_tilde + eye[ZETA]
    A[ZETA] = loop.k_d * loop.Lambda_1 * q_tilde
    A[E] = q_hat
    A[F] = q + q_tilde
    pid = q_hat_dot + loop.Lambda_0 * q_hat + loop.Lambda_1 * eye[E]
    filtered = q_hat_dot + loop.Lambda_0 * (q + q_tilde) + loop.Lambda_1 * eye[F]
    u = -loop.K_p * pid - loop.robust_gain * filtered
    if loop.sigma_varies:
        x_w = np.zeros((13, 16))
        x_w[0, [rho, beta, gamma]] = c, -loop.rho * s, -loop.rho * s
        x_w[1, [rho, beta, gamma]] = s, loop.rho * c, loop.rho * c
        x_w[2, psi], x_w[3, gamma] = -1.0, -1.0
        x_w[7:9] = q_hat_dot
        slope = -2 * (loop.network_input - CENTRES[:, np.newaxis]) / WIDTH**2 * loop.sigma[:, np.newaxis]
        u = u - loop.weights @ slope @ x_w
    A += force @ u
    return control.ss(A, -force, filtered, np.zeros((2, 2)))


def closed_loop(loop: Loop) -> control.StateSpace:
    """Return the whole loop: the network, n' = gamma_w sum(sigma^2) s, fed back to the rest. States as `STATES`."""
    network = control.ss(np.zeros((2, 2)), loop.network_gain * np.eye(2), np.eye(2), np.zeros((2, 2)))
    return control.feedback(vehicle_and_pid(loop), network, sign=1)


def oscillation(loop: Loop) -> complex:
    """Return the pole above 0.2 rad/s, of positive imaginary part, that grows most or decays least."""
    poles = closed_loop(loop).poles()
    return complex(max(poles[poles.imag > 0.2], key=lambda pole: pole.real, default=complex(math.nan, math.nan)))


# The model from the code -------------------------------------------------------------------------------------


class Code:
    """The controller and the plant as they run, as functions of `STATES`."""

    def __init__(self, loop: Loop) -> None:
        self.loop = loop
        self.vehicle = CarLike(wheelbase=loop.a)
        law = load("neural-adaptive-pid")
        names = ("gamma_w", "K_p", "Lambda_0", "Lambda_1", "k_d", "epsilon_t")
        gains = law.gains_type.from_mapping({name: getattr(loop, name) for name in names} | {"theta_m": loop.theta})
        self.controller = law(Team(self.vehicle, 1, PERIOD), gains)
        self.desired = Desired(np.array([[loop.rho, loop.beta]]), np.zeros((1, 2)), np.zeros((1, 2)))
        self.leader = Leader(np.zeros(4), np.array([loop.v_d, 0.0]))
        self.plant = numeric.compile(plants.load("car_like"))
        self.parameters = self.plant.parameters(drive="as_printed")

    def pose(self, x: Array) -> Array:
        """Return the follower's pose: the inverse of (7) and (4), the leader at the origin."""
        rho, beta, psi, gamma = x[:4] + np.array([self.loop.rho, self.loop.beta, 0.0, 0.0])
        ahead, left = self.loop.a + rho * math.cos(beta + gamma), rho * math.sin(beta + gamma)
        c, s = math.cos(psi), math.sin(psi)
        return np.array([-c * ahead + s * left, -s * ahead - c * left, psi, gamma])

    def rates(self, x: Array) -> Array:
        """Return der(x): the plant's right-hand side and the controller's step over its period."""
        pose, after, plant_rates = self._tick(x)
        v = np.array([x[4] + self.loop.v_d, x[5]])
        r, delta = formation_rates(pose, self.leader.pose, self.loop.v_d, self.vehicle)
        return np.concatenate([r @ v + delta, plant_rates[2:], (after - x[6:]) / PERIOD])

    def tick(self, y: Array) -> Array:
        """Return the states one tick later; x and y relative to the leader stand for range and bearing."""
        x = y.copy()
        pose = y[:4].copy()
        x[:2] = range_bearing(pose, self.leader.pose, self.vehicle) - [self.loop.rho, self.loop.beta]
        x[4] -= self.loop.v_d
        _, after, plant_rates = self._tick(x, pose)
        plant_rates[0] -= self.loop.v_d
        return np.concatenate([y[:6] + PERIOD * plant_rates, after])

    def _tick(self, x: Array, pose: Array | None = None) -> tuple[Array, Array, Array]:
        loop = self.loop
        pose = self.pose(x) if pose is None else pose
        q_d = self.desired.q[0]
        sigma_2 = np.sum(loop.sigma**2)
        state = {
            "bearing": [q_d[1]],
            "q_hat": [x[Q_HAT] + q_d],
            "p": [x[P]],
            "zeta": [x[ZETA]],
            "epsilon_hat_integral": [x[E]],
            "epsilon_q_tilde_integral": [x[F]],
            "W": [loop.weights + np.outer(x[N], loop.sigma) / sigma_2],
            "theta": [loop.theta],
        }
        self.controller.set_state(state)
        torque = self.controller.step(pose[np.newaxis], self.leader, self.desired)[0]
        new = self.controller.get_state()
        integrals = ("p", "zeta", "epsilon_hat_integral", "epsilon_q_tilde_integral")
        n = (new["W"][0] - loop.weights) @ loop.sigma
        after = np.concatenate([new["q_hat"][0] - q_d, *(new[name][0] for name in integrals), n])
        states = np.concatenate([pose, [x[4] + loop.v_d, x[5]]])
        inputs = self.plant.inputs(tau_drive=torque[0], tau_steer=torque[1])
        return pose, after, self.plant.rhs(0.0, states, inputs, self.parameters)


def jacobian(function, x: Array, step: float = 1e-7) -> Array:  # type: ignore[no-untyped-def]
    """Return the Jacobian of a function by central differences."""
    columns = [(function(x + step * e) - function(x - step * e)) / (2 * step) for e in np.eye(len(x))]
    return np.stack(columns, axis=1)


def check(loop: Loop) -> tuple[float, float, float]:
    """Compare the model with the code.

    Returns
    -------
    rest : float
        Largest rate of the code in the steady formation: it should be zero.
    matrix : float
        Largest difference between entries of A and of the numerical Jacobian.
    poles : float
        Largest distance of a pole of `closed_loop` from the nearest of the tick, (z - 1)/h as for explicit Euler [1/s].
    """
    code, A = Code(loop), closed_loop(loop).A
    zero = np.zeros(len(STATES))
    rest = float(np.abs(code.rates(zero)).max())
    matrix = float(np.abs(jacobian(code.rates, zero) - A).max())
    steady = np.concatenate([code.pose(zero), [loop.v_d, 0.0], zero[6:]])
    sampled = (np.linalg.eigvals(jacobian(code.tick, steady)) - 1) / PERIOD
    distance = max(float(np.abs(sampled - pole).min()) for pole in np.linalg.eigvals(A))
    return rest, matrix, distance


# The report --------------------------------------------------------------------------------------------------

MEASURED_FREQUENCY = 0.88  # rad/s, of followers 1 and 2 between 80 and 100 s
MEASURED_AMPLITUDE = 0.83  # m/s, mean of |s| of follower 1 between 80 and 100 s
LARGE = 1e9
PLACES = {"1 and 2": Loop(), "3 and 4": Loop(rho=8.0, beta=math.radians(15))}
CHANGES = {
    "none": {},
    "γ_w = 5 (printed: 10)": {"gamma_w": 5.0},
    "γ_w = 2": {"gamma_w": 2.0},
    "γ_w = 0.1": {"gamma_w": 0.1},
    "K_p = 20 (10)": {"K_p": 20.0},
    "Λ_0 = 1 (2)": {"Lambda_0": 1.0},
    "ε_t = 1 (10)": {"epsilon_t": 1.0},
    "θ_m = 20 (10)": {"theta": 20.0},
    "θ_m = 0: no robust term": {"theta": 0.0},
}


def threshold(loop: Loop) -> float:
    """Return the |s| [m/s] beyond which the oscillation grows: zero if it always does, infinite if never."""
    if oscillation(replace(loop, amplitude=LARGE)).real < 0:
        return math.inf
    if oscillation(loop).real > 0:
        return 0.0
    low, high = 1e-6, 1e6
    for _ in range(60):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if oscillation(replace(loop, amplitude=middle)).real > 0 else (middle, high)
    return high


def draw() -> Figure:
    """Return the figure: the oscillation's pole against the adaptation gain and against the desired bearing."""
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    plane, growth = figure.subplots(1, 2)
    amplitudes = {
        "small errors": (0.0, "tab:blue"),
        f"|s| = {MEASURED_AMPLITUDE:g} m/s, as measured": (MEASURED_AMPLITUDE, "tab:orange"),
        "large errors": (LARGE, "tab:red"),
    }
    _draw_plane(plane, amplitudes)
    bearings = np.arange(0.0, 76.0)
    for label, (amplitude, colour) in amplitudes.items():
        loops = [Loop(beta=math.radians(bearing), amplitude=amplitude) for bearing in bearings]
        growth.plot(bearings, [oscillation(loop).real for loop in loops], color=colour, label=label)
    growth.axhline(0.0, color="black", linewidth=0.8)
    growth.axvline(45.0, color="grey", linewidth=0.8, linestyle=":")
    growth.annotate("followers 1 and 2", (44.5, -0.28), rotation=90, ha="right", fontsize="small", color="grey")
    growth.set_title("(b) γ_w = 10 N/m, range 3 m", fontsize="medium")
    growth.set_xlabel("desired bearing [deg]")
    growth.set_ylabel("growth rate of the oscillation [1/s]")
    growth.grid(alpha=0.3)
    growth.legend(fontsize="small")
    return figure


def _draw_plane(axes: Axes, amplitudes: dict[str, tuple[float, str]]) -> None:
    gains = np.geomspace(0.1, 30.0, 120)
    for label, (amplitude, colour) in amplitudes.items():
        poles = np.array([oscillation(Loop(gamma_w=gain, amplitude=amplitude)) for gain in gains])
        axes.plot(poles.real, poles.imag, color=colour, label=label)
        for gain in (0.1, 1.0, 5.0, 10.0, 20.0):
            pole = oscillation(Loop(gamma_w=gain, amplitude=amplitude))
            axes.plot(pole.real, pole.imag, marker="o", markersize=8 if gain == 10 else 4, color=colour)
            if amplitude == 0.0:
                axes.annotate(f"{gain:g}", (pole.real, pole.imag), textcoords="offset points", xytext=(7, -10))
    axes.axhline(MEASURED_FREQUENCY, color="grey", linestyle="--", linewidth=0.8, label="measured, 0.88 rad/s")
    axes.axvline(0.0, color="black", linewidth=0.8)
    axes.set_title("(a) bearing 45°, range 3 m, dots: γ_w = 0.1 to 20 N/m", fontsize="medium")
    axes.set_xlabel("growth rate, real part of the pole [1/s]")
    axes.set_ylabel("frequency, imaginary part of the pole [rad/s]")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small", loc="upper left")


def main() -> None:
    """Print the tables and draw the figure."""
    print("The model against the code that runs\n")
    print(
        heading("followers", "rate at rest", "largest entry of A", "largest difference of an entry", "of a pole [1/s]")
    )
    for name, loop in PLACES.items():
        rest, matrix, poles = check(loop)
        largest = np.abs(closed_loop(loop).A).max()
        print(row(name, f"{rest:.0e}", f"{largest:.0f}", f"{matrix:.0e}", f"{poles:.0e}"))

    print("\nThe pole of the oscillation [1/s, rad/s], followers 1 and 2\n")
    print(heading("change", "small errors", f"|s| = {MEASURED_AMPLITUDE:g} m/s", "large errors", "grows beyond |s| of"))
    for name, change in CHANGES.items():
        loop = replace(PLACES["1 and 2"], **change)
        poles = [_pole(replace(loop, amplitude=amplitude)) for amplitude in (0.0, MEASURED_AMPLITUDE, LARGE)]
        print(row(name, *poles, _limit(loop)))
    other = PLACES["3 and 4"]
    poles = [_pole(replace(other, amplitude=amplitude)) for amplitude in (0.0, MEASURED_AMPLITUDE, LARGE)]
    print(row("none, followers 3 and 4", *poles, _limit(other)))
    fixed = replace(Loop(), sigma_varies=False)
    poles = [_pole(replace(fixed, amplitude=amplitude)) for amplitude in (0.0, MEASURED_AMPLITUDE, LARGE)]
    print(row("none, basis functions held constant", *poles, _limit(fixed)))
    print(f"\ngamma_w sum(sigma^2): {', '.join(f'{loop.network_gain:.1f} N/m' for loop in PLACES.values())}")
    save(draw(), "linearised")


def _pole(loop: Loop) -> str:
    pole = oscillation(loop)
    return f"{pole.real:+.3f} ± {pole.imag:.2f}j".replace("-", "−") if math.isfinite(pole.real) else "none"


def _limit(loop: Loop) -> str:
    limit = threshold(loop)
    return "never grows" if math.isinf(limit) else f"{limit:.2f} m/s"


if __name__ == "__main__":
    main()
