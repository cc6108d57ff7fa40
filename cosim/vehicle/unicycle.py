"""How a vehicle moves along a path whose state is x, y, heading, forward and angular velocity of one point."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from formation_controllers.vehicles import Vehicle

from cosim.vehicle.kind import OnPath
from cosim.vehicle.path import Course, Motion, PathMotion

_STANDING = 1e-6
"""Speed [m/s] below which a vehicle turns on the spot, so that its path has no curvature."""


def unicycle_on_path(steering_length: Callable[[Vehicle], float | None] = lambda _: None) -> OnPath:
    """Return how such a vehicle moves along a path.

    Parameters
    ----------
    steering_length
        See `OnPath`.
    """
    return OnPath(_course, _state, _motion, steering_length)


def _course(_: Vehicle, state: Sequence[float]) -> Course:
    """Return its course on a path; a vehicle that turns on the spot is on a straight path. The rate is not known."""
    x, y, heading, v, omega = state
    return Course(x, y, heading, v, omega / v if abs(v) > _STANDING else 0.0, 0.0)


def _state(_: Vehicle, course: Course) -> tuple[float, ...]:
    return course.x, course.y, course.heading, course.v, course.v * course.curvature


def _motion(_: Vehicle, path: PathMotion) -> Motion:
    omega_dot = path.v_dot * path.kappa + path.v * path.kappa_dot
    return Motion(
        np.column_stack([path.x, path.y, path.heading, path.v, path.v * path.kappa]),
        np.column_stack([path.v_dot, omega_dot]),
    )
