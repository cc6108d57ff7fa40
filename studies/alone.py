"""The paper's law and its plants alone, without the harness, so that every state of the law can be read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from formation_controllers import CarLike, Desired, Leader, Team, load
from formation_controllers.geometry import formation_courses
from numpy.typing import NDArray

import plants
from plants import numeric

Array = NDArray[np.float64]

LIMIT = 200.0  # N.m
VEHICLE = CarLike(wheelbase=1.2)
STARTS = ((-5.0, 0.0), (-5.0, 10.0), (-5.0, 15.0), (-5.0, -5.0))
"""Of the four followers, in sections 5.1."""


@dataclass(frozen=True)
class Formation:
    """A simulation of section 5.1.

    Attributes
    ----------
    places
        Desired ranges [m] and bearings [deg] of the followers.
    leader_steering
        The leader's steering angle at the start [rad].
    gains
        Gains that differ from those printed for the first simulation.
    """

    places: tuple[tuple[float, float], ...]
    leader_steering: float
    gains: Mapping[str, float]

    def with_gains(self, **gains: float) -> Formation:
        """Return the same with some other gains."""
        return Formation(self.places, self.leader_steering, {**self.gains, **gains})


LINE = Formation(((3, 45), (3, -45), (8, 15), (8, -15)), 0.0, {})
CIRCLE = Formation(
    ((1.5, 45), (1.5, -45), (4, 60), (4, -60)), 0.1, {"gamma_theta": 0.25, "theta_m": 20, "gamma_w": 0.1, "W_m": 100}
)


@dataclass(frozen=True)
class Course:
    """A simulation, tick by tick; T ticks, N followers.

    Attributes
    ----------
    time
        (T,) [s].
    pose, velocity, torque, command
        Of the followers: (T, N, 4), (T, N, 2), and torques that act and that the law asks for (T, N, 2).
    leader, leader_velocity, leader_acceleration
        (T, 4), (T, 2) and (T, 2).
    q, q_d
        Range [m] and bearing [rad], unwrapped, and the desired ones: (T, N, 2) and (N, 2).
    states
        Of the law at each tick, before it advances: (T, N, ...), by name.
    """

    time: Array
    pose: Array
    velocity: Array
    torque: Array
    command: Array
    leader: Array
    leader_velocity: Array
    leader_acceleration: Array
    q: Array
    q_d: Array
    states: Mapping[str, Array]


def simulate(formation: Formation, followers: int = 4, step: float = 0.02, horizon: float = 100.0) -> Course:
    """Simulate the first followers of a formation without noise, by explicit Euler.

    Parameters
    ----------
    formation
        The formation.
    followers
        How many of its followers.
    step
        Step of plants and law [s].
    horizon
        End of the simulation [s].
    """
    law = load("neural-adaptive-pid")
    controller = law(Team(VEHICLE, followers, step), law.gains_type.from_mapping(dict(formation.gains)))
    plant = numeric.compile(plants.load("car_like"))
    parameters = plant.parameters(drive="as_printed")
    q_d = np.array([[rho, math.radians(bearing)] for rho, bearing in formation.places[:followers]])
    desired = Desired(q_d, np.zeros((followers, 2)), np.zeros((followers, 2)))
    x = np.zeros((followers + 1, 6))  # the leader first
    x[0, [0, 1, 3]] = 2.5, 5.5, formation.leader_steering
    x[1:, :2] = STARTS[:followers]
    torque = np.zeros((followers + 1, 2))
    torque[0] = 8.0, 0.0

    ticks = round(horizon / step)
    motion, torques = np.empty((ticks, *x.shape)), np.empty((ticks, *torque.shape))
    commands = np.empty((ticks, followers, 2))
    states: dict[str, Array] = {}
    for k in range(ticks):
        leader = Leader(x[0, :4], x[0, 4:])
        if k == 0:
            controller.start(x[1:, :4], leader, desired)
        for name, value in controller.get_state().items():
            states.setdefault(name, np.empty((ticks, *value.shape)))[k] = value
        commands[k] = controller.step(x[1:, :4], leader, desired)
        torque[1:] = np.clip(commands[k], -LIMIT, LIMIT)
        motion[k], torques[k] = x, torque
        x = plant.euler(k * step, x, plant.inputs(tau_drive=torque[:, 0], tau_steer=torque[:, 1]), parameters, step)
    pose, leader_pose = motion[:, 1:, :4], motion[:, 0, :4]
    leader_velocity = motion[:, 0, 4:]
    courses = formation_courses(pose, leader_pose, np.broadcast_to(q_d, (ticks, followers, 2)), VEHICLE)
    return Course(
        time=np.arange(ticks) * step,
        pose=pose,
        velocity=motion[:, 1:, 4:],
        torque=torques[:, 1:],
        command=commands,
        leader=leader_pose,
        leader_velocity=leader_velocity,
        leader_acceleration=np.gradient(leader_velocity, step, axis=0),
        q=np.moveaxis(courses[:2], (0, 1, 2), (2, 1, 0)),
        q_d=q_d,
        states=states,
    )
