"""The cost of one tick for one follower: the compiled tick of every law, and the public step.

    python controllers/benchmarks/tick.py

Times are per follower and tick, the best of several rounds. As clocks differ from machine to machine, everything is
also given in units of one compiled Euler step of one car-like plant, measured in the same run.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numba
import numpy as np
from formation_controllers import CarLike, ControllerError, Desired, Leader, Team, load
from formation_controllers.compiled_law import CompiledLaw
from formation_controllers.interface import TickInputs

PERIOD = 0.02
LAWS = ("neural-adaptive-pid", "observer-pid", "neural-high-gain", "feedback-linearisation", "lqg")


@numba.njit(error_model="numpy")
def plants(state, torque):
    """One Euler step of (56), reduced, for every row of (x, y, psi, gamma, v, omega): the yardstick."""
    for i in range(len(state)):
        psi, gamma, v, omega = state[i, 2], state[i, 3], state[i, 4], state[i, 5]
        t = math.tan(gamma)
        t_dot = omega * (1 + t * t)
        m_11, m_12, m_22 = 30 + 15 * t * t / 1.44, 10 * t / 1.2, 10.0
        f_1 = (1 + t * math.sin(psi)) * torque[i, 0] - 15 * t * t_dot / 1.44 * v - 25 * (1 + t * t / 1.44) * v
        f_2 = torque[i, 1] - 10 * t_dot / 1.2 * v - 25 * omega
        det = m_11 * m_22 - m_12 * m_12
        state[i, 0] += PERIOD * v * math.cos(psi)
        state[i, 1] += PERIOD * v * math.sin(psi)
        state[i, 2] += PERIOD * v * t / 1.2
        state[i, 3] += PERIOD * omega
        state[i, 4] += PERIOD * (m_22 * f_1 - m_12 * f_2) / det
        state[i, 5] += PERIOD * (m_11 * f_2 - m_12 * f_1) / det


def best(action: Callable[[], object], calls: int, rounds: int = 7) -> float:
    """Return the time [s] of one call in the fastest of several rounds."""
    action()
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        for _ in range(calls):
            action()
        times.append((time.perf_counter() - start) / calls)
    return min(times)


def compiled_tick(controller: CompiledLaw, inputs: TickInputs, ticks: int) -> Callable[[], None]:
    """Return a compiled loop that calls a law's tick again and again: the cost in a compiled master."""
    tick, torque = type(controller).tick, np.empty((controller.team.size, 2))

    @numba.njit(error_model="numpy")
    def many(inputs, team, torque):
        for _ in range(ticks):
            tick(inputs, team, torque)

    return lambda: many(inputs, controller._records, torque)


def main() -> None:
    """Print the table."""
    print("nanoseconds per follower and tick (in units of one Euler step of one plant)\n")
    print(f"{'':26}{'team of 4':>34}{'team of 1000':>34}")
    print(f"{'':26}{'compiled tick':>17}{'public step':>17}{'compiled tick':>17}{'public step':>17}")
    sizes = (4, 1000)
    rows: dict[str, list[float]] = {"Euler step of one plant": []}
    skipped: dict[str, str] = {}
    for size in sizes:
        random = np.random.default_rng(0)
        state = np.hstack([random.uniform([-8, -5, -0.3, -0.3], [-6, 5, 0.3, 0.3], (size, 4)), np.zeros((size, 2))])
        torque, ticks = np.zeros((size, 2)), 20000 // size + 1

        @numba.njit(error_model="numpy")
        def steps(state, torque, ticks):
            for _ in range(ticks):
                plants(state, torque)

        yard = best(lambda: steps(state, torque, ticks), 3) / ticks / size  # noqa: B023
        rows["Euler step of one plant"] += [yard, math.nan]
        pose = state[:, :4].copy()
        leader = Leader(np.array([2.5, 5.5, 0.0, 0.0]), np.array([0.3, 0.0]), np.zeros(2))
        desired = Desired(np.tile([3.0, 0.5], (size, 1)), np.zeros((size, 2)), np.zeros((size, 2)))
        for name in LAWS:
            try:
                controller = load(name)(Team(CarLike(1.2), size, PERIOD))
            except ControllerError as refusal:
                skipped[name] = str(refusal)
                continue
            controller.start(pose, leader, desired)
            velocity = np.zeros((size, 2))
            step = best(lambda: controller.step(pose, leader, desired, velocity), ticks) / size  # noqa: B023
            inputs = TickInputs(pose, velocity, *leader, *desired)
            tick = best(compiled_tick(controller, inputs, ticks), 3) / ticks / size
            rows.setdefault(name, []).extend([tick, step])
    for name, times in rows.items():
        cells = ""
        for k, seconds in enumerate(times):
            yard = rows["Euler step of one plant"][2 * (k // 2)]
            cells += f"{f'{seconds * 1e9:.0f} ({seconds / yard:.1f})':>17}" if seconds == seconds else f"{'':17}"
        print(f"{name:26}{cells}")
    for name, why in skipped.items():
        print(f"{name:26}skipped: {why}")


if __name__ == "__main__":
    main()
