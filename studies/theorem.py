"""Theorem 1 held against runs: the Lyapunov function (43), its rate and the bound (51), with constants computed.

    python studies/theorem.py

prints tables and draws ``docs/figures/theorem.png``, for the first two simulations without noise, which are free of
everything that the theorem leaves out but steps of 20 ms and the limit of the torque.

The constants are the least that hold on a run, as those of Property 1 exist on a set only. With q_d at rest,
z = alpha epsilon + beta xi_c and epsilon_dot = s_c - z, (21) and (37) are::

    chi_1 = M ((alpha + beta) epsilon_dot + alpha beta epsilon)
            + C(q_dot) z - C(0) epsilon_dot + D z + D_bar epsilon_dot
    chi_2 = C(q_dot) (s_o - epsilon_dot) - C(0) epsilon_dot + (D_bar - D) epsilon_dot

so that (22) and (38) hold with the norms of M, C, D and D_bar, whose maxima over the run are taken. C(q_dot) is C(0),
as the leader moves, plus a part that is linear in q_dot. W* is the least-squares fit of eta = -f, (20), over the run,
among the weights within the bound, tr(W'W) <= W_m, which (50) needs; theta is the largest |e_w - tau_d| of the run.
tau_d is what (10) as printed leaves out: C2's lack of symmetry while the leader moves, and torque beyond its limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from alone import CIRCLE, LINE, VEHICLE, Array, Course, Formation, simulate
from formation_controllers import Leader
from formation_controllers.analysis.formation_model import ReducedDynamics, formation_model
from formation_controllers.analysis.gain_conditions import Bounds, GainReport, check_gains, propose_gains
from formation_controllers.geometry import formation_rates, posture_error
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePidGains
from matplotlib.figure import Figure
from pages import heading, row, save

STEP = 0.02  # s
EVERY = 5
"""Ticks between two samples."""
SCENARIOS: dict[str, Formation] = {
    "line, as printed": LINE,
    "line, W_m = 100": LINE.with_gains(W_m=100),
    "circle, as printed": CIRCLE,
    "circle, K_p = 150": CIRCLE.with_gains(K_p=150),
}
DRAWN = ("line, as printed", "line, W_m = 100")


@dataclass(frozen=True)
class Held:
    """Theorem 1 held against a follower's run; T samples.

    Attributes
    ----------
    time : ndarray
        (T,) [s].
    x : ndarray
        Norm of x, (23), (T,).
    V : ndarray
        The Lyapunov function (43), (T,).
    V_dot, bound : ndarray
        Its rate by central differences, and the bound (51), (T,).
    parts : ndarray
        Parts of V, (T, 4): errors and integrals, filtered errors, weights, robust gain.
    bounds : Bounds
        The constants.
    report : GainReport
        Conditions (39) to (42).
    kappa_m, kappa_7, kappa_8, gamma : float
        Of (52), at the report's l.
    W_star, theta : float
        Norm of the ideal weights [N], and the bound of what they leave [N].
    limited : bool
        Whether a torque reached its limit.
    """

    time: Array
    x: Array
    V: Array
    V_dot: Array
    bound: Array
    parts: Array
    bounds: Bounds
    report: GainReport
    kappa_m: float
    kappa_7: float
    kappa_8: float
    gamma: float
    W_star: float
    theta: float
    limited: bool


def norm(matrix: Array) -> float:
    """Return the induced norm."""
    return float(np.linalg.norm(matrix, 2))


@dataclass(frozen=True)
class Sample:
    """The formation model (10) at one sample: M, norms, eta of (20) and what (10) as printed leaves out, tau_d."""

    M: Array
    inertia: tuple[float, float]
    damping: tuple[float, float]
    D_bar: float
    apart: float
    C_0: float
    C_linear: float
    eta: Array
    tau_d: Array
    q_dot: Array


def samples(course: Course, i: int) -> Iterator[Sample]:
    """Return the formation model of a follower along its run."""
    dynamics = ReducedDynamics.of_vehicle(VEHICLE)
    for k in range(0, len(course.time), EVERY):
        pose, leader_pose, v = course.pose[k, i], course.leader[k], course.velocity[k, i]
        leader = Leader(leader_pose, course.leader_velocity[k], course.leader_acceleration[k])
        R, delta = formation_rates(pose, leader_pose, leader.velocity[0], VEHICLE)
        q_dot = R @ v + delta
        at = formation_model(pose, leader, q_dot, VEHICLE, dynamics)
        exact = formation_model(pose, leader, q_dot, VEHICLE, dynamics, exact=True)
        C_0, *C_axes = (formation_model(pose, leader, rate, VEHICLE, dynamics).C for rate in (np.zeros(2), *np.eye(2)))
        clipped = at.B @ (course.command[k, i] - course.torque[k, i])
        inertia, damping = np.linalg.eigvalsh(at.M), np.linalg.eigvalsh((at.D + at.D.T) / 2)
        yield Sample(
            M=at.M,
            inertia=(float(inertia[0]), float(inertia[-1])),
            damping=(float(damping[0]), float(damping[-1])),
            D_bar=norm(at.D_bar),
            apart=norm(at.D_bar - at.D),
            C_0=norm(C_0),
            C_linear=math.hypot(*(norm(own - C_0) for own in C_axes)),
            eta=-at.f,
            tau_d=(at.D_bar - exact.D_bar) @ q_dot + clipped,
            q_dot=q_dot,
        )


def bounds_of(model: list[Sample], alpha: float, beta: float) -> Bounds:
    """Return the constants of (22), (27) and (38) and those of Properties 1 and 3, over a run."""
    total = alpha + beta
    k_rate = math.sqrt(1 + alpha**2 + beta**2)  # |epsilon_dot| <= k_rate |x|
    k_z = math.hypot(alpha, beta)
    k_inertia = math.sqrt(total**2 + alpha**4 + (beta * total) ** 2)
    k_both = math.sqrt(2 + alpha**2 + beta**2)  # s_o - epsilon_dot
    M, D = (max(ends) for ends in ([own.inertia[1] for own in model], [own.damping[1] for own in model]))
    D_bar, apart = max(own.D_bar for own in model), max(own.apart for own in model)
    C_0, C_linear = max(own.C_0 for own in model), max(own.C_linear for own in model)
    return Bounds(
        c_1=M * k_inertia + C_0 * (k_z + k_rate) + D * k_z + D_bar * k_rate,
        c_2=C_linear * k_rate * k_z,
        c_3=2 * k_rate,
        c_4=C_0 * (k_both + k_rate) + apart * k_rate,
        c_5=C_linear * k_rate * k_both,
        lambda_m=min(own.inertia[0] for own in model),
        lambda_d=min(own.damping[0] for own in model),
        lambda_M=M,
    )


def basis(course: Course, i: int, gains: NeuralAdaptivePidGains, q_hat_dot: Array) -> Array:
    """Return the basis functions (11) along a run, (T, 9)."""
    at = slice(None, None, EVERY)
    x = np.zeros((len(q_hat_dot), 13))
    x[:, :4] = posture_error(course.pose[at, i], course.leader[at], VEHICLE)
    x[:, 4], x[:, 5:7], x[:, 7:9] = course.leader[at, 3], course.leader_velocity[at], q_hat_dot
    centres, widths = np.array(gains.centres), np.array(gains.widths)
    return np.asarray(np.exp(-np.sum((x[:, np.newaxis] - centres[:, np.newaxis]) ** 2, axis=2) / widths**2))


def ideal_weights(sigma: Array, eta: Array, W_m: float) -> Array:
    """Return the weights (2, 9) within their bound whose output fits eta best: with a ridge, where the bound acts."""
    u, s, v = np.linalg.svd(sigma, full_matrices=False)
    seen = u.T @ eta

    def weights(ridge: float) -> Array:
        return np.asarray((v.T @ (s[:, np.newaxis] / (s[:, np.newaxis] ** 2 + ridge) * seen)).T)

    low, high = math.log(s[0] ** 2 * 1e-14), math.log(s[0] ** 2 * 1e6)
    for _ in range(60):
        middle = (low + high) / 2
        if np.sum(weights(math.exp(middle)) ** 2) > W_m:
            low = middle
        else:
            high = middle
    return weights(math.exp(high))


def hold(course: Course, i: int, gains: NeuralAdaptivePidGains) -> Held:
    """Hold Theorem 1 against the run of a follower."""
    at = slice(None, None, EVERY)
    model = list(samples(course, i))
    sums = gains.Lambda_0[0], gains.Lambda_1[0]  # type: ignore[index]
    root = math.sqrt(sums[0] ** 2 - 4 * sums[1])
    reports = []
    for alpha, beta in (((sums[0] - root) / 2, (sums[0] + root) / 2), ((sums[0] + root) / 2, (sums[0] - root) / 2)):
        bounds = bounds_of(model, alpha, beta)
        report = check_gains(gains, bounds)
        if math.isclose(report.alpha, alpha):
            reports.append((bounds, report))
    bounds, report = max(reports, key=lambda one: min(condition.margin for condition in one[1].conditions))
    alpha, beta, free = report.alpha, report.beta, report.l

    # (13) to (18), (23)
    own = {name: value[at, i] for name, value in course.states.items()}
    q, q_dot = course.q[at, i], np.array([one.q_dot for one in model])
    epsilon, q_tilde = q - course.q_d[i], q - own["q_hat"]
    q_hat_dot = own["p"] + (sums[0] + gains.k_d) * q_tilde
    of_epsilon = (own["epsilon_q_tilde_integral"] + own["epsilon_hat_integral"]) / 2
    of_q_tilde = (own["epsilon_q_tilde_integral"] - own["epsilon_hat_integral"]) / 2
    xi_c, xi_o = epsilon + alpha * of_epsilon, q_tilde + alpha * of_q_tilde
    s_c = q_dot + sums[0] * epsilon + sums[1] * of_epsilon
    s_o = q_dot - q_hat_dot + sums[0] * q_tilde + sums[1] * of_q_tilde
    x = np.linalg.norm(np.concatenate([xi_c, xi_o, epsilon, q_tilde, s_c, s_o], axis=1), axis=1)

    # Ideal weights, (12), and theta
    sigma, eta = basis(course, i, gains, q_hat_dot), np.array([one.eta for one in model])
    W_star = ideal_weights(sigma, eta, gains.W_m)
    left = eta - sigma @ W_star.T - np.array([one.tau_d for one in model])
    theta = float(np.linalg.norm(left, axis=1).max())

    # (43)
    K_p = np.array(gains.K_p)
    M = np.array([one.M for one in model])
    errors = 0.5 * sum(np.sum(K_p * one**2, axis=1) for one in (epsilon, xi_c, q_tilde, xi_o))
    filtered = 0.5 * sum(np.einsum("ti,tij,tj->t", one, M, one) for one in (s_c, s_o))
    weights = np.sum((W_star - own["W"]) ** 2, axis=(1, 2)) / (2 * gains.gamma_w)
    robust = (theta - own["theta"]) ** 2 / (2 * gains.gamma_theta)
    parts = np.stack([errors, filtered, weights, robust], axis=1)
    V = parts.sum(axis=1)

    # (51), (52)
    kappa_m = min(condition.margin for condition in report.conditions)
    kappa_7 = 0.5 * ((bounds.c_1 + bounds.c_4) / free + 3 * bounds.c_3)
    kappa_8 = 0.5 * (bounds.c_2 + bounds.c_5) / free
    most = (float(np.linalg.norm(W_star)) + math.sqrt(gains.W_m)) ** 2 * len(gains.centres)
    gamma = 0.5 * bounds.c_3 * (most + theta**2 + gains.theta_m**2) + gains.epsilon_t
    return Held(
        time=course.time[at],
        x=x,
        V=V,
        V_dot=np.gradient(V, course.time[EVERY]),
        bound=-(kappa_m - kappa_7 - kappa_8 * x**2) * x**2 + gamma,
        parts=parts,
        bounds=bounds,
        report=report,
        kappa_m=kappa_m,
        kappa_7=kappa_7,
        kappa_8=kappa_8,
        gamma=gamma,
        W_star=float(np.linalg.norm(W_star)),
        theta=theta,
        limited=bool((course.command[:, i] != course.torque[:, i]).any()),
    )


def draw(held: dict[str, list[Held]]) -> Figure:
    """Return the figure: V of each follower, and its rate beside the bound."""
    figure = Figure(figsize=(9, 5), layout="constrained")
    upper, lower = figure.subplots(2, len(held), sharex=True, sharey="row")
    for above, below, (name, followers) in zip(upper, lower, held.items(), strict=True):
        above.set_title(name)
        for i, one in enumerate(followers):
            above.semilogy(one.time, one.V, linewidth=0.8, label=f"follower {i + 1}")
            below.plot(one.time, one.V_dot, linewidth=0.6)
            below.plot(one.time, one.bound, linewidth=0.8, linestyle="--", color=f"C{i}")
        below.set_yscale("symlog", linthresh=1)
        below.set_xlabel("time [s]")
        for axes in (above, below):
            axes.grid(alpha=0.3)
    upper[0].set_ylabel("V, (43)")
    upper[0].legend(fontsize="small")
    lower[0].set_ylabel("rate of V; dashed: its bound, (51)")
    return figure


def number(value: float) -> str:
    """Return a number with two or three digits."""
    return f"{value:.1e}" if abs(value) >= 100_000 else f"{float(f'{value:.3g}'):,g}".replace(",", " ")


def main() -> None:
    """Print the tables and draw the figure."""
    held: dict[str, list[Held]] = {}
    for name, formation in SCENARIOS.items():
        course = simulate(formation)
        gains = NeuralAdaptivePidGains.from_mapping(dict(formation.gains))
        held[name] = [hold(course, i, gains) for i in range(4)]

    print("Constants over each run\n")
    names = ("c_1", "c_2", "c_3", "c_4", "c_5", "lambda_m", "lambda_M", "lambda_d")
    print(heading("run, follower", *names, "norm of W*", "theta", "kappa_m", "kappa_7", "kappa_8", "gamma", "l"))
    for name, followers in held.items():
        for i, one in enumerate(followers):
            cells = [*(getattr(one.bounds, own) for own in names), one.W_star, one.theta]
            cells += [one.kappa_m, one.kappa_7, one.kappa_8, one.gamma, one.report.l]
            print(row(f"{name}, {i + 1}", *map(number, cells)))

    print("\nConditions, margins at that l\n")
    print(heading("run, follower", "(39)", "(40)", "(41)", "(42)"))
    for name, followers in held.items():
        for i, one in enumerate(followers):
            print(row(f"{name}, {i + 1}", *(number(condition.margin) for condition in one.report.conditions)))

    print("\nGains that the constants of a run ask for: (39) to (42) with l = 0.5, and 10 % to spare\n")
    print(heading("run, follower", "Lambda_0", "Lambda_1", "K_p", "k_d", "k_d times the step"))
    for name, followers in held.items():
        gains = NeuralAdaptivePidGains.from_mapping(dict(SCENARIOS[name].gains))
        for i, one in enumerate(followers):
            asked = propose_gains(gains, one.bounds, l=0.5, margin=0.1)
            cells = [asked.Lambda_0[0], asked.Lambda_1[0], asked.K_p[0], asked.k_d, asked.k_d * STEP]  # type: ignore[index]
            print(row(f"{name}, {i + 1}", *map(number, cells)))

    print("\nV along the runs\n")
    columns = ("V(0)", "largest V", "V(100 s)", "V grows", "largest rate", "largest bound", "least bound", "bound held")
    print(heading("run, follower", *columns, "torque limited"))
    for name, followers in held.items():
        for i, one in enumerate(followers):
            cells = [one.V[0], one.V.max(), one.V[-1]]
            grows, holds = float(np.mean(one.V_dot > 0)), float(np.mean(one.V_dot <= one.bound))
            ends = [one.V_dot.max(), one.bound.max(), one.bound.min()]
            told = [f"{grows:.0%} of the time", *map(number, ends), f"{holds:.1%}", "yes" if one.limited else "no"]
            print(row(f"{name}, {i + 1}", *map(number, cells), *told))
    print("\nThe errors' part of V, and the norm of x\n")
    print(
        heading(
            "run, follower", "V of errors at 0 s", "at 100 s", "of weights and theta at 100 s", "x at 0 s", "at 100 s"
        )
    )
    for name, followers in held.items():
        for i, one in enumerate(followers):
            cells = [one.parts[0, :2].sum(), one.parts[-1, :2].sum(), one.parts[-1, 2:].sum(), one.x[0], one.x[-1]]
            print(row(f"{name}, {i + 1}", *map(number, cells)))
    save(draw({name: followers for name, followers in held.items() if name in DRAWN}), "theorem", dpi=75)


if __name__ == "__main__":
    main()
