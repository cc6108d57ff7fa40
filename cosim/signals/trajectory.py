"""The motion of a leader that moves along a given path: by differential flatness from x(t) and y(t)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from formation_controllers.vehicles import Vehicle
from numpy.typing import NDArray

from cosim.clock import ROUNDING, Clock
from cosim.errors import InputError
from cosim.scenario.csv_table import read_table
from cosim.scenario.scenario import Trajectory
from cosim.signals.spline import through
from cosim.storage import Storage, blocks
from cosim.vehicle.kind import Kind, OnPath
from cosim.vehicle.path import Motion, PathMotion
from plants import arrays

Path = Callable[..., NDArray[np.float64]]
"""A path: its points (T, 2) at times (T,), or a derivative of them, whose order is the second argument."""

MIN_POINTS = 6
MAX_SMOOTHED = 10_000
"""Points through which a smoothing spline is led: the time that it takes can grow with their square."""
MIN_SPEED = 1e-3  # m/s
MAX_STEERING = math.radians(80)


def leader_motion(trajectory: Trajectory, kind: Kind, vehicle: Vehicle, clock: Clock, storage: Storage) -> Motion:
    """Return the motion in which a vehicle's reference point follows a path exactly, driving forwards.

    The path is a quintic spline through the points, or near them if the trajectory is smoothed. The reference
    point is the midpoint of the rear axle (tractor-trailer: of the trailer's axle). Its first two derivatives give
    heading and steering angle (the hitch angle theta_0 - theta_1), the third one gives the velocities, the fourth one
    the accelerations. All derivatives are the spline's own.

    Parameters
    ----------
    trajectory
        The points.
    kind, vehicle
        The kind of vehicle, and its geometry.
    clock
        The communication points.
    storage
        Where the motion lies.

    Raises
    ------
    InputError
        The kind states no motion along a path; the table cannot be used; there are fewer than six points, or they do
        not reach from 0 to the horizon; or the vehicle cannot follow the path: it stands still, or has to steer by
        more than 80 degrees.
    """
    if kind.on_path is None:
        raise InputError(
            f"the kind {kind.name} states no motion along a path: give the leader a <pose> and commands "
            "instead of a <trajectory>",
            trajectory.where,
        )
    path, heading = _spline(trajectory, clock.horizon), _Heading()
    found: Motion | None = None
    for block in blocks(clock.ticks + 1):
        times = clock.times_in(block)
        with np.errstate(all="ignore"):
            motion = _flat_motion(trajectory, path, kind.on_path, vehicle, times, heading)
        beyond = np.asarray(~np.isfinite(np.hstack([motion.state, motion.acceleration])).all(axis=1))
        _refuse(trajectory, times, beyond, "is too fast to compute with", "no vehicle moves like this")
        if found is None:
            places = (storage.empty((clock.ticks + 1, part.shape[1])) for part in (motion.state, motion.acceleration))
            found = Motion(*places)
        found.state[block], found.acceleration[block] = motion.state, motion.acceleration
    assert found is not None
    return found


class _Heading:
    """The heading without jumps, of one part of the time after the other; the same bits as `numpy.unwrap` of all."""

    def __init__(self) -> None:
        self._raw: NDArray[np.float64] | None = None
        self._added, self._last = 0.0, 0.0

    def unwrapped(self, raw: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the heading (T,), and how much it has turned since the time before."""
        turned = np.diff(raw, prepend=raw[:1] if self._raw is None else self._raw)
        within = np.mod(turned + math.pi, 2 * math.pi) - math.pi
        within[(within == -math.pi) & (turned > 0)] = math.pi
        corrections = np.where(np.abs(turned) < math.pi, 0.0, within - turned)
        corrections[0] += self._added
        added = corrections.cumsum()
        heading = raw + added
        before = heading[0] if self._raw is None else self._last
        self._raw, self._added, self._last = raw[-1:], float(added[-1]), float(heading[-1])
        return heading, np.diff(heading, prepend=before)


def _flat_motion(
    trajectory: Trajectory,
    path: Path,
    on_path: OnPath,
    vehicle: Vehicle,
    times: NDArray[np.float64],
    course: _Heading,
) -> Motion:
    (x_1, y_1), (x_2, y_2), (x_3, y_3), (x_4, y_4) = (path(times, nu).T for nu in (1, 2, 3, 4))
    v = arrays.hypot(x_1, y_1)
    _refuse(trajectory, times, v < MIN_SPEED, "stands still", "its heading is not defined there")
    heading, turned = course.unwrapped(arrays.atan2(y_1, x_1))
    _refuse(
        trajectory,
        times,
        np.abs(turned) > math.pi / 2,
        "turns by more than 90 degrees in a communication step",
        "it is no smooth path",
    )

    v_dot = (x_1 * x_2 + y_1 * y_2) / v
    v_ddot = (x_2**2 + y_2**2 + x_1 * x_3 + y_1 * y_3 - v_dot**2) / v
    # The curvature n / v^3 and its derivatives
    n = x_1 * y_2 - y_1 * x_2
    n_dot = x_1 * y_3 - y_1 * x_3
    n_ddot = x_2 * y_3 + x_1 * y_4 - y_2 * x_3 - y_1 * x_4
    v_3 = v * v * v
    kappa = n / v_3
    kappa_dot = (n_dot - 3 * n * v_dot / v) / v_3
    kappa_ddot = (n_ddot - (6 * n_dot * v_dot + 3 * n * v_ddot) / v + 12 * n * (v_dot / v) ** 2) / v_3

    length = on_path.steering_length(vehicle)
    if length is not None:
        _refuse(
            trajectory,
            times,
            np.abs(arrays.atan(length * kappa)) > MAX_STEERING,
            f"turns so tightly that the leader, {length:g} m long, would have to steer by more than 80 degrees",
            "give it a wider turn",
        )
    x, y = path(times).T
    return on_path.motion(vehicle, PathMotion(x, y, heading, v, v_dot, kappa, kappa_dot, kappa_ddot))


def _spline(trajectory: Trajectory, horizon: float) -> Path:
    """Return the path as a function of the time [s] and the order of the derivative, with values (T, 2) [m]."""
    time, points = _points(trajectory)
    if len(time) < MIN_POINTS:
        raise InputError(f"the trajectory has {len(time)} points; at least {MIN_POINTS} are needed", trajectory.where)
    if time[0] > ROUNDING or time[-1] < horizon - ROUNDING:
        raise InputError(
            f"the trajectory's points are from {time[0]:.12g} s to {time[-1]:.12g} s; they must reach from 0 s to the "
            f"horizon, {horizon:.12g} s",
            trajectory.where,
        )
    if trajectory.smoothing > 0 and len(time) > MAX_SMOOTHED:
        raise InputError(
            f"the trajectory has {len(time)} points; at most {MAX_SMOOTHED} can be smoothed", trajectory.where
        )
    try:
        if trajectory.smoothing == 0:
            return through(time, points)
        from scipy import interpolate  # slow to import, and few scenarios need it

        allowed = len(time) * trajectory.smoothing * trajectory.smoothing
        (spline, _), _, flag, _ = interpolate.splprep(points.T, u=time, k=5, s=allowed, full_output=1, quiet=1)
        if flag > 0:
            raise ValueError(f"allow more smoothing than {trajectory.smoothing:g} m")
    except ValueError as error:
        raise InputError(f"no spline leads through the trajectory's points: {error}", trajectory.where) from None
    knots, coefficients, degree = spline
    smooth: Path = interpolate.BSpline(knots, np.column_stack(coefficients), degree)
    return smooth


def _points(trajectory: Trajectory) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the times (n,) [s] and the points (n, 2) [m]."""
    if trajectory.file is None:
        waypoints = np.array(trajectory.waypoints)
        return waypoints[:, 0], waypoints[:, 1:]
    table = read_table(trajectory.file, trajectory.where)
    return table.time, np.column_stack([table.column(name, "m", trajectory.where) for name in ("x", "y")])


def _refuse(
    trajectory: Trajectory, times: NDArray[np.float64], where: NDArray[np.bool_], problem: str, advice: str
) -> None:
    if where.any():
        time = times[np.argmax(where)]
        raise InputError(f"the trajectory {problem} at t = {time:.12g} s: {advice}", trajectory.where)
