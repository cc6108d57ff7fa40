"""The desired place of a follower in the formation, over time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.clock import ROUNDING, Clock
from cosim.scenario.scenario import Follower, PlaceChange
from cosim.storage import Storage, blocks, constant


def desired_places(followers: Sequence[Follower], clock: Clock, storage: Storage) -> tuple[NDArray[np.float64], ...]:
    """Return the places of all followers at all communication points and two derivatives, each (ticks + 1, N, 2)."""
    samples, shape = clock.ticks + 1, (len(followers), 2)
    if not any(follower.changes for follower in followers):
        place = np.array([follower.desired for follower in followers], dtype=float).reshape(shape)
        return tuple(constant(part, samples) for part in (place, np.zeros(shape), np.zeros(shape)))
    found = tuple(storage.empty((samples, *shape)) for _ in range(3))
    for block in blocks(samples):
        times = clock.times_in(block)
        for row, follower in enumerate(followers):
            for course, own in zip(found, desired_samples(follower.desired, follower.changes, times), strict=True):
                course[block, row] = own
    return found


def desired_samples(
    desired: tuple[float, float], changes: Iterable[PlaceChange], times: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return a follower's desired range and bearing with their first two derivatives.

    From the start of a change to its end, both follow the quintic 10 s^3 - 15 s^4 + 6 s^5 in the part s of the time
    that has passed, so that velocity and acceleration are zero at both ends; at all other times they are constant,
    exactly as given.

    Parameters
    ----------
    desired, changes
        Range [m] and bearing [rad] at the start, and their changes, one after the other.
    times
        Points in time (T,) [s].

    Returns
    -------
    tuple of ndarray
        q_d, its first and its second derivative, each (T, 2): [m, rad], [m/s, rad/s], [m/s2, rad/s2].
    """
    q = np.tile(np.array(desired, dtype=float), (len(times), 1))
    q_dot, q_ddot = np.zeros_like(q), np.zeros_like(q)
    before = np.array(desired, dtype=float)
    for change in changes:
        after = np.array([change.range, change.bearing])
        duration = change.stop - change.start
        during = (times > change.start + ROUNDING) & (times < change.stop - ROUNDING)
        s = ((times[during] - change.start) / duration)[:, np.newaxis]
        q[during] = before + (after - before) * (s * s * s * (10 - 15 * s + 6 * s**2))
        q_dot[during] = (after - before) / duration * (30 * s**2 * (1 - s) ** 2)
        q_ddot[during] = (after - before) / duration**2 * (60 * s * (1 - s) * (1 - 2 * s))
        q[times >= change.stop - ROUNDING] = after
        before = after
    return q, q_dot, q_ddot
