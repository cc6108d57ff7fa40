"""Motion along a path, which every kind of vehicle shares: position, heading, speed and curvature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plants import arrays

Floats = NDArray[np.float64]


class Course(NamedTuple):
    """Course on a path: reference point [m], heading [rad], speed [m/s], curvature [1/m] and its rate."""

    x: float
    y: float
    heading: float
    v: float
    curvature: float
    curvature_rate: float


@dataclass(frozen=True, eq=False)
class PathMotion:
    """How a reference point moves along a path over time, each (T,).

    Attributes
    ----------
    x, y : ndarray
        Position [m].
    heading : ndarray
        Direction of motion, without jumps [rad].
    v, v_dot : ndarray
        Speed [m/s] and its rate.
    kappa, kappa_dot, kappa_ddot : ndarray
        Curvature [1/m] and its rates.
    """

    x: Floats
    y: Floats
    heading: Floats
    v: Floats
    v_dot: Floats
    kappa: Floats
    kappa_dot: Floats
    kappa_ddot: Floats

    def steering(self, length: float) -> tuple[Floats, Floats, Floats]:
        """Return the steering angle of a vehicle of some length [m] and its two rates."""
        steering = arrays.atan(length * self.kappa)
        cos_2 = arrays.cos(steering) ** 2
        steering_dot = length * self.kappa_dot * cos_2
        steering_ddot = length * self.kappa_ddot * cos_2 - 2 * arrays.tan(steering) * steering_dot**2
        return steering, steering_dot, steering_ddot


@dataclass(frozen=True, eq=False)
class Motion:
    """A vehicle's motion over time.

    Attributes
    ----------
    state : ndarray (T, entries)
        Pose, angles without jumps, and pseudo-velocities, in the order and units of the kind of vehicle.
    acceleration : ndarray (T, velocities)
        Time derivatives of the pseudo-velocities.
    """

    state: Floats
    acceleration: Floats
