"""Figures of a recorded motion: how large an error was, when it settled, how near two robots came."""

from __future__ import annotations

import math
from collections.abc import Collection
from itertools import combinations

import numpy as np
import xarray as xr
from numpy.typing import NDArray


def figure_of(kind: str, time: NDArray[np.float64], values: NDArray[np.float64], start: float = 0.0) -> float:
    """Return one figure of a signal over a window; NaN if it is empty or a value that counts is NaN.

    Parameters
    ----------
    kind
        ``rms``, the root mean square; ``peak``, the largest magnitude; ``final``, the last magnitude; ``itae``, the
        integral of time times magnitude by the trapezoidal rule; ``least``, the smallest value.
    time, values
        The window (T,): times [s] and the signal in its unit.
    start
        From when the time of ``itae`` counts [s].

    Returns
    -------
    float
        In the unit of the signal; ``itae`` in that times s2.
    """
    if not len(values):
        return math.nan
    magnitude = np.abs(values)
    if kind == "rms":
        return float(np.sqrt(np.mean(np.square(values))))
    if kind == "peak":
        return float(magnitude.max())
    if kind == "final":
        return float(magnitude[-1])
    if kind == "itae":
        integrand = (time - start) * magnitude
        return float(0.5 * np.sum((integrand[1:] + integrand[:-1]) * np.diff(time)))
    if kind == "least":
        return float(values.min())
    raise ValueError(f"{kind!r} is no figure of a signal")


def settling_time(follower: xr.Dataset, range_band: float, bearing_band: float) -> float | None:
    """Return from when on [s] both errors of a follower stay within their bands [m], [rad]; None if they do not."""
    within = np.abs(follower["range_error"].values) <= range_band
    within &= np.abs(follower["bearing_error"].values) <= bearing_band  # what is not a number is not within
    first = np.flatnonzero(~within)[-1] + 1 if not within.all() else 0
    time = follower["time"].values
    return float(time[first]) if first < len(time) else None


def smallest_distance(result: xr.Dataset, robots: Collection[str] = ()) -> tuple[float, tuple[str, str], float] | None:
    """Return the smallest distance [m] between the reference points of two followers, which two, and when [s].

    Parameters
    ----------
    result
        A result, or a window of it.
    robots
        If any are given, only pairs that one of these belongs to.

    Returns
    -------
    tuple or None
        None if there is no sample or no pair.
    """
    time, position = result["time"].values, result["pose"].values[..., :2]
    names = [str(robot) for robot in result["robot"].values]
    smallest = None
    for i, j in combinations(range(len(names)), 2):
        if not len(time) or (robots and not {names[i], names[j]} & set(robots)):
            continue
        distance = np.hypot(*(position[:, i] - position[:, j]).T)
        nearest = int(distance.argmin())  # one that is not a number, if there is any
        if smallest is None or not distance[nearest] >= smallest[0]:
            smallest = float(distance[nearest]), (names[i], names[j]), float(time[nearest])
    return smallest
