"""The paper's simulations on reduced plants, (1) to (3) with (56) or (57): fixtures for closed-loop tests."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from formation_controllers import load
from formation_controllers.dynamics import TRACTOR_TRAILER_MODEL
from formation_controllers.gains import Gains
from formation_controllers.geometry import range_bearing, unwrapped_bearing
from formation_controllers.interface import Desired, Leader, Team
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePid
from formation_controllers.vehicles import CarLike, TractorTrailer
from hypothesis import settings

# The first call of a compiled function takes its time, and the same examples every time make failures repeatable.
settings.register_profile("formation-controllers", deadline=None, derandomize=True)
settings.load_profile("formation-controllers")

WHEELBASE, MASS, INERTIA_BODY, INERTIA_STEERING, DAMPING = 1.2, 30.0, 5.0, 10.0, 25.0
PERIOD = 0.02
LIMIT = 200.0


def drive_gain(psi, gamma, drive):
    return {
        "as_printed": 1 + math.tan(gamma) * math.sin(psi),
        "front_wheel": 1 / math.cos(gamma),
        "rear_wheel": 1.0,
    }[drive]


def euler(state, torque, drive):
    """Return the state (x, y, psi, gamma, v, omega) of one robot a period later.

    Not vectorised: NumPy's trigonometric functions may round differently from one array to the next.
    """
    x, y, psi, gamma, v, omega = map(float, state)
    t, t_dot = math.tan(gamma), omega / math.cos(gamma) ** 2
    # M2 = S' M1 S, C2 = S' M1 S_dot (the rest of (3) cancels), D2 = S' D1 S
    inertia = INERTIA_BODY + INERTIA_STEERING
    m_11 = MASS + inertia * t * t / WHEELBASE**2
    m_12 = INERTIA_STEERING * t / WHEELBASE
    m_22 = INERTIA_STEERING
    f_1 = drive_gain(psi, gamma, drive) * torque[0]
    f_1 -= inertia * t * t_dot / WHEELBASE**2 * v + DAMPING * (1 + t * t / WHEELBASE**2) * v
    f_2 = torque[1] - INERTIA_STEERING * t_dot / WHEELBASE * v - DAMPING * omega
    det = m_11 * m_22 - m_12 * m_12
    v_dot, omega_dot = (m_22 * f_1 - m_12 * f_2) / det, (m_11 * f_2 - m_12 * f_1) / det
    return [
        x + PERIOD * v * math.cos(psi),
        y + PERIOD * v * math.sin(psi),
        psi + PERIOD * v * t / WHEELBASE,
        gamma + PERIOD * omega,
        v + PERIOD * v_dot,
        omega + PERIOD * omega_dot,
    ]


START = np.array([[-5, 0, 0, 0], [-5, 10, 0, 0], [-5, 15, 0, 0], [-5, -5, 0, 0]], dtype=float)
LEADER_START = np.array([2.5, 5.5, 0, 0])
LEADER_TORQUE = np.array([8.0, 0.0])
DESIRED = np.column_stack([[3.0, 3.0, 8.0, 8.0], np.radians([45, -45, 15, -15])])


@dataclass
class FirstSimulation:
    """The first simulation, tick by tick: explicit Euler, torques clipped, noise on every pose [m, rad]."""

    gains: Gains | Sequence[Gains] | None = None
    rows: Sequence[int] = (0, 1, 2, 3)
    drive: str = "as_printed"
    noise: float = 0.0
    seed: int = 0
    law: type = NeuralAdaptivePid

    start, leader_start, leader_torque, desired_q = START, LEADER_START, LEADER_TORQUE, DESIRED

    def __post_init__(self):
        n = len(self.rows)
        self.vehicle = self.new_vehicle()
        self.controller = self.law(Team(self.vehicle, n, PERIOD), self.gains)
        self.desired = Desired(self.desired_q[list(self.rows)], np.zeros((n, 2)), np.zeros((n, 2)))
        self.random = np.random.default_rng(self.seed)
        self.state = np.hstack([self.start[list(self.rows)], np.zeros((n, 2))])
        self.leader = np.concatenate([self.leader_start, np.zeros(2)])
        self.controller.start(*self.sensed())

    def new_vehicle(self):
        return CarLike(WHEELBASE, self.drive)

    def euler(self, state, torque):
        return euler(state, torque, self.drive)

    def sensed(self):
        pose = self.state[:, :4] + self.noise * self.random.standard_normal((len(self.rows), 4))
        return pose, Leader(self.leader[:4], self.leader[4:]), self.desired

    def tick(self):
        """Advance everything by one period and return the torque as sent to the plant."""
        velocity = self.state[:, 4:] if "velocity" in self.law.needs else None
        torque = self.controller.step(*self.sensed(), velocity).clip(-LIMIT, LIMIT)
        self.state = np.array([self.euler(*robot) for robot in zip(self.state, torque, strict=True)])
        self.leader = np.array(self.euler(self.leader, self.leader_torque))
        return torque

    def run(self, ticks):
        """Return states (ticks + 1, N, 6), leader's states (ticks + 1, 6) and telemetry by name (ticks, ...)."""
        states, leaders, telemetry = [self.state], [self.leader], []
        for _ in range(ticks):
            self.tick()
            states.append(self.state)
            leaders.append(self.leader)
            telemetry.append(self.controller.telemetry())
        signals = {name: np.array([t[name] for t in telemetry]) for name in telemetry[0]}
        return np.array(states), np.array(leaders), signals

    def errors(self, states, leaders):
        """Return range [m] and bearing [rad] errors, shape (..., N, 2), the bearing unwrapped over time."""
        q = range_bearing(states[..., :4], leaders[..., None, :4], self.vehicle)
        q[..., 1] = unwrapped_bearing(q[..., 1], self.desired.q[:, 1])
        return q - self.desired.q

    def last_rms(self, states, leaders, ticks):
        """Return the root mean square of the last errors: range [m] and bearing [deg], shape (N, 2)."""
        return np.sqrt((self.errors(states, leaders)[-ticks:] ** 2).mean(axis=0)) * [1, 180 / math.pi]


@dataclass
class SecondSimulation(FirstSimulation):
    """The second simulation: behind a leader on a circle."""

    leader_start = np.array([2.5, 5.5, 0.0, 0.1])
    desired_q = np.column_stack([[1.5, 1.5, 4.0, 4.0], np.radians([45, -45, 60, -60])])


HITCH, RADIUS, HALF_TRACK = 1.5, 0.15, 0.4
MASS_0, MASS_1, INERTIA_0, INERTIA_1, A_0, A_1 = 15.0, 15.0, 2.0, 2.0, 0.15, 0.05


def euler_tractor_trailer(state, torque):
    """Return the state (x, y, theta_1, theta_0, v, omega) of one tractor-trailer a period later, (57) and (3)."""
    x, y, theta_1, theta_0, v, omega = map(float, state)
    h = theta_0 - theta_1
    turn = v * math.tan(h) / HITCH
    i_theta_1 = MASS_1 * A_1**2 + MASS_0 * HITCH**2 + INERTIA_1
    i_theta_0 = MASS_0 * A_0**2 + INERTIA_0
    m_11 = MASS_0 + MASS_1 + i_theta_1 * math.tan(h) ** 2 / HITCH**2
    f_1 = (torque[0] + torque[1]) / (RADIUS * math.cos(h))
    f_1 -= i_theta_1 * v * math.tan(h) * (omega - turn) / (HITCH * math.cos(h)) ** 2
    f_1 += A_0 * MASS_0 * omega**2 / math.cos(h) - DAMPING * (1 + math.tan(h) ** 2 / HITCH**2) * v
    f_2 = HALF_TRACK / RADIUS * (torque[0] - torque[1]) - A_0 * MASS_0 * v * omega / math.cos(h) - DAMPING * omega
    return [
        x + PERIOD * v * math.cos(theta_1),
        y + PERIOD * v * math.sin(theta_1),
        theta_1 + PERIOD * turn,
        theta_0 + PERIOD * omega,
        v + PERIOD * f_1 / m_11,
        omega + PERIOD * f_2 / i_theta_0,
    ]


@dataclass
class ThirdSimulation(FirstSimulation):
    """The third simulation: tractor-trailers behind a leader on a circle (section 5.2)."""

    start = np.array([[0, 2, 0, 30], [0, -2, 0, -30], [0, 4, 0, -15], [0, -4, 0, 15]]) * [1, 1, 1, math.pi / 180]
    leader_start = np.array([5.0, 0, 0, 0])
    leader_torque = np.array([0.35, 0.5])
    desired_q = np.column_stack([[1.5, 1.5, 3.0, 3.0], np.radians([45, -45, 45, -45])])

    def new_vehicle(self):
        return TractorTrailer(HITCH, RADIUS, HALF_TRACK)

    def euler(self, state, torque):
        return euler_tractor_trailer(state, torque)


@pytest.fixture(scope="session")
def first_simulation():
    """The class, so that a test can vary it."""
    return FirstSimulation


@pytest.fixture(scope="session")
def second_simulation():
    return SecondSimulation


@pytest.fixture(scope="session")
def third_simulation():
    return ThirdSimulation


def bits(name, course):
    """Return law, course and a hash of every number after 2 s."""
    law = load(name)
    has_model = "I_1" in vars(law.gains_type()) and course is ThirdSimulation
    simulation = course(law=law, gains=law.gains_type(guard=0.1, **(TRACTOR_TRAILER_MODEL if has_model else {})))
    simulation.run(100)
    controller = simulation.controller
    numbers = simulation.state.tobytes() + controller.to_bytes() + controller._telemetry.tobytes()
    return f"{name} {course.__name__} {hashlib.sha256(numbers).hexdigest()}"


@pytest.fixture(scope="session")
def bits_of_a_run():
    return bits
