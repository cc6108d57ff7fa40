"""Where the weights are while the first simulation as printed oscillates, and how the oscillation ends.

    python studies/weights.py

prints a table and draws ``docs/figures/long_run.png``. Followers 1 and 2 without noise, at two steps; `oscillation.xml`
has the noise. The part of W along the basis functions acts on the robot, the rest of W acts on nothing as long as these
hardly vary, but counts for the bound tr(W'W) <= W_m all the same.
"""

from __future__ import annotations

import math

import numpy as np
from alone import LINE, Array, Course, simulate
from linearised import Loop
from matplotlib.figure import Figure
from pages import heading, row, save

HORIZON = 700.0  # s
WINDOW = 50.0  # s


def parts(course: Course) -> tuple[Array, Array]:
    """Return the weights' part along sigma (T, 2), by its entry for the range, and the norm of the rest (T, 2) [N]."""
    unit = np.stack([Loop(beta=beta).sigma for beta in course.q_d[:, 1]])
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    weights = course.states["W"]
    acting = np.einsum("tijk,ik->tij", weights, unit)
    rest = weights - acting[..., np.newaxis] * unit[:, np.newaxis]
    return acting[..., 0], np.linalg.norm(rest, axis=(2, 3))


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
    """Print the table and draw the figure."""
    print("Range error, RMS [m], as printed\n")
    starts = np.arange(0.0, HORIZON, WINDOW)
    print(heading("", *(f"{a:.0f} to {a + WINDOW:.0f} s" for a in starts)))
    for step in (0.02, 0.005):
        course = simulate(LINE, 2, step, HORIZON)
        error = course.q - course.q_d
        for follower in range(2):
            cells = rms(course.time, error[:, follower, 0], starts, WINDOW)
            print(row(f"follower {follower + 1}, step {step * 1000:g} ms", *cells), flush=True)
        if step == 0.02:
            save(draw(course.time, error, *parts(course)), "long_run")


if __name__ == "__main__":
    main()
