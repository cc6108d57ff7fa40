"""Figures of a recorded motion: how large an error was, when it settled, how near two robots came."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from cosim.results.result import Result
from plants import arrays


@dataclass(frozen=True)
class Measure:
    """A way to sum up a signal over a window in one figure.

    Attributes
    ----------
    figure : callable
        Returns the figure from times (T,) [s], values (T,) and the time [s] from which time counts; NaN if a value is.
    at : callable
        Returns the sample at which the figure comes about; None if that is not one sample.
    unit : callable
        Returns the figure's unit from the signal's.
    fewest : int
        Samples that are needed.
    """

    figure: Callable[[NDArray[np.float64], NDArray[np.float64], float], float]
    at: Callable[[NDArray[np.float64]], int | None] = lambda values: None
    unit: Callable[[str], str] = lambda unit: unit
    fewest: int = 1

    def __call__(self, time: NDArray[np.float64], values: NDArray[np.float64], start: float = 0.0) -> float:
        """Return the figure; NaN if the window is empty or a value that counts is NaN."""
        return float(self.figure(time, values, start)) if len(values) else math.nan


def _itae(time: NDArray[np.float64], values: NDArray[np.float64], start: float) -> float:
    integrand = (time - start) * np.abs(values)
    return float(0.5 * np.sum((integrand[1:] + integrand[:-1]) * np.diff(time)))


def _times_s2(unit: str) -> str:
    numerator, slash, denominator = unit.partition("/")
    return f"{'s2' if unit == '1' else numerator + '.s2'}{slash}{denominator}"


MEASURES: Mapping[str, Measure] = {
    "rms": Measure(lambda time, values, start: float(np.sqrt(np.mean(np.square(values))))),
    "peak": Measure(lambda time, values, start: float(np.abs(values).max()), at=lambda v: int(np.abs(v).argmax())),
    "final": Measure(lambda time, values, start: float(np.abs(values)[-1])),
    "itae": Measure(_itae, unit=_times_s2, fewest=2),
    "least": Measure(lambda time, values, start: float(values.min()), at=lambda values: int(values.argmin())),
}
"""Root mean square; largest magnitude; last magnitude; integral of time times magnitude by the trapezoidal rule, whose
time counts from the start of the window; smallest value."""


def settling_time(result: Result, robot: str, range_band: float, bearing_band: float) -> float | None:
    """Return from when on [s] both errors of a follower stay within their bands [m], [rad]; None if they do not."""
    within = np.abs(result.of_robot("range_error", robot)) <= range_band
    within &= np.abs(result.of_robot("bearing_error", robot)) <= bearing_band  # NaN is not within
    first = len(within) - int(within[::-1].argmin()) if len(within) and not within.all() else 0
    time = result["time"].values
    return float(time[first]) if first < len(time) else None


@dataclass(frozen=True)
class Nearest:
    """Where two followers came nearest to each other.

    Attributes
    ----------
    distance : float
        The distance [m]; NaN where a pose is not a number.
    between : tuple of str
        The two followers.
    time : float
        The time [s].
    """

    distance: float
    between: tuple[str, str]
    time: float


def smallest_distance(result: Result, robots: Collection[str] = ()) -> Nearest | None:
    """Return where the reference points of two followers came nearest to each other.

    Parameters
    ----------
    result
        A result, or a window of it.
    robots
        If any are given, only pairs that one of these belongs to.

    Returns
    -------
    Nearest or None
        None if there is no sample or no pair.
    """
    time, position = result["time"].values, result["pose"].values[..., :2]
    names = result.robots
    smallest = None
    for i, j in combinations(range(len(names)), 2):
        if not len(time) or (robots and not {names[i], names[j]} & set(robots)):
            continue
        distance = arrays.hypot(*(position[:, i] - position[:, j]).T)
        nearest = int(distance.argmin())  # one that is not a number, if there is any
        if smallest is None or not distance[nearest] >= smallest.distance:
            smallest = Nearest(float(distance[nearest]), (names[i], names[j]), float(time[nearest]))
    return smallest
