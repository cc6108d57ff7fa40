"""A reduced car-like plant in NumPy, (1) to (3) and (56), and the paper's first simulation on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from formation_controllers.interface import Desired, Leader, Team
from formation_controllers.vehicles import CarLike

WHEELBASE, MASS, INERTIA_BODY, INERTIA_STEERING, DAMPING = 1.2, 30.0, 5.0, 10.0, 25.0
PERIOD = 0.02
LIMIT = 200.0


def drive_gain(psi, gamma, drive):
    return {
        "as_printed": 1 + np.tan(gamma) * np.sin(psi),
        "front_wheel": 1 / np.cos(gamma),
        "rear_wheel": np.ones_like(psi),
    }[drive]


def rates(state, torque, drive="as_printed"):
    """Return the rates of (x, y, psi, gamma, v, omega), shape (..., 6), under torques (..., 2)."""
    psi, gamma, v, omega = np.moveaxis(state[..., 2:], -1, 0)
    t, t_dot = np.tan(gamma), omega / np.cos(gamma) ** 2
    # M2 = S' M1 S, C2 = S' M1 S_dot (the rest of (3) cancels), D2 = S' D1 S
    inertia = INERTIA_BODY + INERTIA_STEERING
    m_11 = MASS + inertia * t * t / WHEELBASE**2
    m_12 = INERTIA_STEERING * t / WHEELBASE
    m_22 = INERTIA_STEERING
    f_1 = drive_gain(psi, gamma, drive) * torque[..., 0]
    f_1 = f_1 - inertia * t * t_dot / WHEELBASE**2 * v - DAMPING * (1 + t * t / WHEELBASE**2) * v
    f_2 = torque[..., 1] - INERTIA_STEERING * t_dot / WHEELBASE * v - DAMPING * omega
    det = m_11 * m_22 - m_12 * m_12
    v_dot = (m_22 * f_1 - m_12 * f_2) / det
    omega_dot = (m_11 * f_2 - m_12 * f_1) / det
    return np.stack([v * np.cos(psi), v * np.sin(psi), v * t / WHEELBASE, omega, v_dot, omega_dot], axis=-1)


@dataclass(frozen=True)
class Run:
    """Trajectories: time, state (K+1, N, 6), leader (K+1, 6), torques (K, N, 2), telemetry by name."""

    time: np.ndarray
    state: np.ndarray
    leader: np.ndarray
    torque: np.ndarray
    telemetry: dict[str, np.ndarray]


START = np.array([[-5, 0, 0, 0], [-5, 10, 0, 0], [-5, 15, 0, 0], [-5, -5, 0, 0]], dtype=float)
LEADER_START = np.array([2.5, 5.5, 0, 0])
LEADER_TORQUE = np.array([8.0, 0.0])
DESIRED = np.column_stack([[3, 3, 8, 8], np.radians([45, -45, 15, -15])]).astype(float)


def simulate(
    controller_type, gains=None, *, horizon=100.0, drive="as_printed", noise=0.0, seed=0, rows=slice(None)
):
    """Run the paper's first simulation: explicit Euler, torques clipped, noise [m, rad] on every pose."""
    start, desired_q = START[rows], DESIRED[rows]
    n = len(start)
    controller = controller_type(Team(CarLike(WHEELBASE, drive), n, PERIOD), gains)
    random = np.random.default_rng(seed)
    steps = round(horizon / PERIOD)
    state = np.zeros((steps + 1, n, 6))
    leader = np.zeros((steps + 1, 6))
    torque = np.zeros((steps, n, 2))
    state[0, :, :4], leader[0, :4] = start, LEADER_START
    desired = Desired(desired_q, np.zeros((n, 2)), np.zeros((n, 2)))
    telemetry = {
        s.name: np.zeros((steps, n, len(s.components)) if s.components else (steps, n))
        for s in controller.signals
    }
    for k in range(steps):
        pose = state[k, :, :4] + noise * random.standard_normal((n, 4))
        told = Leader(leader[k, :4], leader[k, 4:])
        if k == 0:
            controller.start(pose, told, desired)
        torque[k] = controller.step(pose, told, desired).clip(-LIMIT, LIMIT)
        for name, value in controller.telemetry().items():
            telemetry[name][k] = value
        state[k + 1] = state[k] + PERIOD * rates(state[k], torque[k], drive)
        leader[k + 1] = leader[k] + PERIOD * rates(leader[k], LEADER_TORQUE, drive)
    return Run(np.arange(steps + 1) * PERIOD, state, leader, torque, telemetry)
