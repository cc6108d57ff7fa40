"""The paper's simulations, and one of differential-drive robots, on reduced plants: fixtures of closed-loop tests."""

from __future__ import annotations

import functools
import hashlib
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass

# Before NumPy and SciPy load their linear algebra: threads cost matrices of six rows ten times the time where they wait
# for a core.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numba
import numpy as np
import pytest
from formation_controllers import load as find
from formation_controllers.dynamics import DIFFERENTIAL_DRIVE_MODEL, TRACTOR_TRAILER_MODEL
from formation_controllers.gains import Gains
from formation_controllers.geometry import range_bearing, unwrapped_bearing
from formation_controllers.interface import Desired, Leader, Team
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePid
from formation_controllers.vehicles import CarLike, DifferentialDrive, TractorTrailer
from hypothesis import settings

load = functools.cache(find)  # which searches every installed package

# The first call of a compiled function takes its time, and the same examples every time make failures repeatable.
settings.register_profile("formation-controllers", deadline=None, derandomize=True)
settings.load_profile("formation-controllers")

WHEELBASE, MASS, INERTIA_BODY, INERTIA_STEERING, DAMPING = 1.2, 30.0, 5.0, 10.0, 25.0
PERIOD = 0.02
LIMIT = 200.0


AS_PRINTED, FRONT_WHEEL, REAR_WHEEL = range(3)
DRIVES = {"as_printed": AS_PRINTED, "front_wheel": FRONT_WHEEL, "rear_wheel": REAR_WHEEL}

# Without a cache: Numba finds a cached function by its module's name, which depends on where pytest is started.
# Robot by robot, with products for squares: NumPy's functions may round differently from one array to the next, and
# powers from plain to compiled code.
compiled_plant = numba.njit(error_model="numpy")


@compiled_plant
def euler(states, torques, drive):
    """Return the states (x, y, psi, gamma, v, omega) of car-like robots, one a row, a period later."""
    after = np.empty_like(states)
    for i in range(len(states)):
        x, y, psi, gamma, v, omega = states[i]
        t, c = math.tan(gamma), math.cos(gamma)
        t_dot = omega / (c * c)
        drive_gain = 1.0
        if drive == AS_PRINTED:
            drive_gain = 1 + t * math.sin(psi)
        elif drive == FRONT_WHEEL:
            drive_gain = 1 / c
        # M2 = S' M1 S, C2 = S' M1 S_dot (the rest of (3) cancels), D2 = S' D1 S
        inertia = INERTIA_BODY + INERTIA_STEERING
        m_11 = MASS + inertia * t * t / WHEELBASE**2
        m_12 = INERTIA_STEERING * t / WHEELBASE
        m_22 = INERTIA_STEERING
        f_1 = drive_gain * torques[i, 0]
        f_1 -= inertia * t * t_dot / WHEELBASE**2 * v + DAMPING * (1 + t * t / WHEELBASE**2) * v
        f_2 = torques[i, 1] - INERTIA_STEERING * t_dot / WHEELBASE * v - DAMPING * omega
        det = m_11 * m_22 - m_12 * m_12
        after[i, 0] = x + PERIOD * v * math.cos(psi)
        after[i, 1] = y + PERIOD * v * math.sin(psi)
        after[i, 2] = psi + PERIOD * v * t / WHEELBASE
        after[i, 3] = gamma + PERIOD * omega
        after[i, 4] = v + PERIOD * (m_22 * f_1 - m_12 * f_2) / det
        after[i, 5] = omega + PERIOD * (m_11 * f_2 - m_12 * f_1) / det
    return after


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

    def euler(self, states, torques):
        return euler(states, torques, DRIVES[self.drive])

    def sensed(self):
        pose = self.state[:, :-2].copy()
        if self.noise:
            pose += self.noise * self.random.standard_normal(pose.shape)
        return pose, Leader(self.leader[:-2], self.leader[-2:]), self.desired

    def tick(self):
        """Advance everything by one period and return the torque as sent to the plant."""
        velocity = self.state[:, -2:] if "velocity" in self.law.needs else None
        torque = self.controller.step(*self.sensed(), velocity).clip(-LIMIT, LIMIT)
        self.state = self.euler(self.state, torque)
        self.leader = self.euler(self.leader[None], self.leader_torque[None])[0]
        return torque

    def run(self, ticks):
        """Return states (ticks + 1, N, P + 2), the leader's (ticks + 1, P + 2) and telemetry, a record (ticks, N)."""
        states, leaders, telemetry = [self.state], [self.leader], []
        for _ in range(ticks):
            self.tick()
            states.append(self.state)
            leaders.append(self.leader)
            telemetry.append(self.controller.telemetry_record.tobytes())
        record = self.controller.telemetry_record
        told = np.frombuffer(b"".join(telemetry), record.dtype).reshape(ticks, *record.shape)
        return np.array(states), np.array(leaders), told

    def errors(self, states, leaders):
        """Return range [m] and bearing [rad] errors, shape (..., N, 2), the bearing unwrapped over time."""
        q = range_bearing(states[..., :-2], leaders[..., None, :-2], self.vehicle)
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


@compiled_plant
def euler_tractor_trailer(states, torques):
    """Return the states (x, y, theta_1, theta_0, v, omega) of tractor-trailers a period later, (57) and (3)."""
    after = np.empty_like(states)
    i_theta_1 = MASS_1 * A_1**2 + MASS_0 * HITCH**2 + INERTIA_1
    i_theta_0 = MASS_0 * A_0**2 + INERTIA_0
    for i in range(len(states)):
        x, y, theta_1, theta_0, v, omega = states[i]
        t, c = math.tan(theta_0 - theta_1), math.cos(theta_0 - theta_1)
        turn = v * t / HITCH
        m_11 = MASS_0 + MASS_1 + i_theta_1 * t * t / HITCH**2
        f_1 = (torques[i, 0] + torques[i, 1]) / (RADIUS * c)
        f_1 -= i_theta_1 * v * t * (omega - turn) / (HITCH**2 * c * c)
        f_1 += A_0 * MASS_0 * omega * omega / c - DAMPING * (1 + t * t / HITCH**2) * v
        f_2 = HALF_TRACK / RADIUS * (torques[i, 0] - torques[i, 1])
        f_2 -= A_0 * MASS_0 * v * omega / c + DAMPING * omega
        after[i, 0] = x + PERIOD * v * math.cos(theta_1)
        after[i, 1] = y + PERIOD * v * math.sin(theta_1)
        after[i, 2] = theta_1 + PERIOD * turn
        after[i, 3] = theta_0 + PERIOD * omega
        after[i, 4] = v + PERIOD * f_1 / m_11
        after[i, 5] = omega + PERIOD * f_2 / i_theta_0
    return after


@dataclass
class ThirdSimulation(FirstSimulation):
    """The third simulation: tractor-trailers behind a leader on a circle (section 5.2)."""

    start = np.array([[0, 2, 0, 30], [0, -2, 0, -30], [0, 4, 0, -15], [0, -4, 0, 15]]) * [1, 1, 1, math.pi / 180]
    leader_start = np.array([5.0, 0, 0, 0])
    leader_torque = np.array([0.35, 0.5])
    desired_q = np.column_stack([[1.5, 1.5, 3.0, 3.0], np.radians([45, -45, 45, -45])])

    def new_vehicle(self):
        return TractorTrailer(HITCH, RADIUS, HALF_TRACK)

    def euler(self, states, torques):
        return euler_tractor_trailer(states, torques)


@compiled_plant
def euler_differential_drive(states, torques):
    """Return the states (x, y, theta, v, omega) of differential-drive robots a period later."""
    after = np.empty_like(states)
    for i in range(len(states)):
        x, y, theta, v, omega = states[i]
        f_1 = (torques[i, 0] + torques[i, 1]) / 0.1 + 3.6 * omega * omega - DAMPING * v
        f_2 = 0.25 / 0.1 * (torques[i, 0] - torques[i, 1]) - 3.6 * v * omega - 2.0 * omega
        after[i, 0] = x + PERIOD * v * math.cos(theta)
        after[i, 1] = y + PERIOD * v * math.sin(theta)
        after[i, 2] = theta + PERIOD * omega
        after[i, 3] = v + PERIOD * f_1 / 44.0
        after[i, 4] = omega + PERIOD * f_2 / 2.7
    return after


@dataclass
class DifferentialSimulation(FirstSimulation):
    """Differential-drive robots behind a leader on a circle of some 8 m."""

    start = np.array([[-3, 2, 0.5], [-3, -2, -0.5], [-5, 4, 0], [-5, -4, 0]], dtype=float)
    leader_start = np.array([0.0, 0, 0])
    leader_torque = np.array([0.43, 0.37])
    desired_q = np.column_stack([[1.5, 1.5, 3.0, 3.0], np.radians([40, -40, 30, -30])])

    def new_vehicle(self):
        return DifferentialDrive(0.1, 0.25)

    def euler(self, states, torques):
        return euler_differential_drive(states, torques)


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


@pytest.fixture(scope="session")
def differential_simulation():
    return DifferentialSimulation


MODELS = {ThirdSimulation: TRACTOR_TRAILER_MODEL, DifferentialSimulation: DIFFERENTIAL_DRIVE_MODEL}


def bits(name, course):
    """Return law, course and a hash of every number after 2 s."""
    law = load(name)
    model = MODELS.get(course, {}) if "I_1" in vars(law.gains_type()) else {}
    simulation = course(law=law, gains=law.gains_type(guard=0.1, **model))
    simulation.run(100)
    controller = simulation.controller
    numbers = simulation.state.tobytes() + controller.to_bytes() + controller._telemetry.tobytes()
    return f"{name} {course.__name__} {hashlib.sha256(numbers).hexdigest()}"


@pytest.fixture(scope="session")
def bits_of_a_run():
    return bits
