"""The oscillation of the first simulation as printed, in a long run: its end, and where the weights are.

    python studies/long_run.py

prints tables and draws ``docs/figures/long_run.png``. Followers 1 and 2 without noise, by the controller and the
plant's right-hand side alone, so that the weights W can be read: the part along the basis functions acts on the robot,
the rest of W acts on nothing as long as these hardly vary, but counts for the bound tr(W'W) <= W_m all the same.
"""

from __future__ import annotations

import math

import numpy as np
from formation_controllers import CarLike, Desired, Leader, Team, load
from formation_controllers.geometry import range_bearing
from linearised import Loop
from matplotlib.figure import Figure
from numpy.typing import NDArray
from variation import heading, row, save

import plants
from plants import numeric

Array = NDArray[np.float64]

LIMIT = 200.0  # N.m
HORIZON = 700.0  # s
WINDOW = 50.0  # s


def simulate(step: float, horizon: float, W_m: float = 1000.0) -> tuple[Array, Array, Array, Array]:
    """Simulate followers 1 and 2 as printed, by explicit Euler.

    Parameters
    ----------
    step
        Step of plants and controllers [s].
    horizon
        End of the simulation [s].
    W_m
        Bound of tr(W'W) [N2].

    Returns
    -------
    time : ndarray
        (T,) [s].
    error : ndarray
        Errors of range and bearing (T, 2, 2) [m, rad].
    acting, idle : ndarray
        Of the weights: the part along sigma (T, 2), by its entry for the range, and the norm of the rest [N].
    """
    law = load("neural-adaptive-pid")
    controller = law(Team(CarLike(wheelbase=1.2), 2, step), law.gains_type.from_mapping({"W_m": W_m}))
    plant = numeric.compile(plants.load("car_like"))
    parameters = plant.parameters(drive="as_printed")
    q = np.array([[3.0, math.pi / 4], [3.0, -math.pi / 4]])
    desired = Desired(q, np.zeros((2, 2)), np.zeros((2, 2)))
    states = np.zeros((3, 6))  # the leader first
    states[:, :2] = [2.5, 5.5], [-5, 0], [-5, 10]
    torque = np.zeros((3, 2))
    torque[0] = 8.0, 0.0
    unit = [Loop(beta=beta).sigma for beta in q[:, 1]]
    unit = np.stack([sigma / np.linalg.norm(sigma) for sigma in unit])

    ticks = round(horizon / step)
    error, weights = np.empty((ticks, 2, 2)), np.empty((ticks, 2, 2, 9))
    for k in range(ticks):
        leader = Leader(states[0, :4], states[0, 4:])
        if k == 0:
            controller.start(states[1:, :4], leader, desired)
        torque[1:] = np.clip(controller.step(states[1:, :4], leader, desired), -LIMIT, LIMIT)
        error[k] = range_bearing(states[1:, :4], states[0, :4], controller.team.vehicle) - q
        weights[k] = controller.get_state()["W"]
        inputs = plant.inputs(tau_drive=torque[:, 0], tau_steer=torque[:, 1])
        states = plant.euler(k * step, states, inputs, parameters, step)
    acting = np.einsum("tijk,ik->tij", weights, unit)
    rest = weights - acting[..., np.newaxis] * unit[:, np.newaxis]
    return np.arange(ticks) * step, error, acting[..., 0], np.linalg.norm(rest, axis=(2, 3))


def draw(time: Array, error: Array, acting: Array, idle: Array) -> Figure:
    """Return the figure: range error, and the two parts of the weights, of follower 1."""
    figure = Figure(figsize=(10, 4.8), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    upper.plot(time, error[:, 0, 0], linewidth=0.5)
    upper.set_ylim(-1.5, 1.5)
    upper.set_ylabel("range error [m]")
    upper.axvspan(0, 100, color="grey", alpha=0.2, linewidth=0, label="horizon of the scenario")
    upper.legend(fontsize="small", loc="lower right")
    lower.plot(time, acting[:, 0], linewidth=0.5, label="along the basis functions: acts on the robot")
    lower.plot(time, idle[:, 0], label="the rest: acts on nothing (norm)")
    for bound in (math.sqrt(1000.0), -math.sqrt(1000.0)):
        lower.axhline(bound, color="black", linestyle="--", linewidth=0.8)
    lower.set_ylabel("weights W [N]")
    lower.set_xlabel("time [s]")
    lower.legend(fontsize="small", loc="lower right")
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
        axes.set_xlim(0, 500)
    return figure


def rms(time: Array, error: Array, starts: Array, length: float) -> list[str]:
    """Return the root mean square of an error over windows of time, as cells of a table."""
    return [f"{math.sqrt(np.mean(error[(time >= a) & (time < a + length)] ** 2)):.3f}" for a in starts]


def main() -> None:
    """Print the tables and draw the figure."""
    print("Range error, RMS [m], as printed\n")
    starts = np.arange(0.0, HORIZON, WINDOW)
    print(heading("", *(f"{a:.0f} to {a + WINDOW:.0f} s" for a in starts)))
    for step in (0.02, 0.005):
        time, error, acting, idle = simulate(step, HORIZON)
        for follower in range(2):
            cells = rms(time, error[:, follower, 0], starts, WINDOW)
            print(row(f"follower {follower + 1}, step {step * 1000:g} ms", *cells), flush=True)
        if step == 0.02:
            save(draw(time, error, acting, idle), "long_run")

    print("\nRange error, RMS [m], with other bounds of the weights, step 20 ms\n")
    starts = np.arange(0.0, 150.0, 25.0)
    print(heading("", *(f"{a:.0f} to {a + 25:.0f} s" for a in starts)))
    for bound in (1e3, 3e3, 1e4, 1e6):
        time, error, _, _ = simulate(0.02, 150.0, bound)
        for follower in range(2):
            print(row(f"follower {follower + 1}, W_m = {bound:g}", *rms(time, error[:, follower, 0], starts, 25.0)))


if __name__ == "__main__":
    main()
