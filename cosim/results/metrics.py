"""Figures of a recorded motion: how large an error was, when it settled, how near two robots came."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.results import passes
from cosim.results.result import Result
from cosim.storage import blocks, forget
from plants import arrays

Floats: TypeAlias = NDArray[np.float64]

_FEW, _TOGETHER = 20, 50
"""Points of which all pairs are looked at, and samples over which those that are far from each other are left out."""
_ROUNDING = 1e-9
"""Part of a distance, more than by which rounding makes a lower bound too large."""


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

    figure: Callable[[Floats, Floats, float], float]
    at: Callable[[Floats], int | None] = lambda values: None
    unit: Callable[[str], str] = lambda unit: unit
    fewest: int = 1

    def __call__(self, time: Floats, values: Floats, start: float = 0.0) -> float:
        """Return the figure; NaN if the window is empty, NaN or infinite if a value that counts is."""
        with np.errstate(invalid="ignore", over="ignore"):
            return float(self.figure(time, values, start)) if len(values) else math.nan


def _rms(time: Floats, values: Floats, start: float) -> float:
    return math.sqrt(passes.total(lambda block: np.square(values[block]), len(values)) / len(values))


def _itae(time: Floats, values: Floats, start: float) -> float:
    return _integral(time, lambda block: (time[block] - start) * np.abs(values[block]))


def _effort(time: Floats, values: Floats, start: float) -> float:
    return _integral(time, lambda block: np.abs(values[block]))


def _integral(time: Floats, integrand: Callable[[slice], Floats]) -> float:
    """Return an integral over the time, by the trapezoidal rule, of what a function returns of a block of samples."""

    def terms(block: slice) -> Floats:
        both_ends = slice(block.start, block.stop + 1)
        values = integrand(both_ends)
        found: Floats = (values[1:] + values[:-1]) * np.diff(time[both_ends])
        return found

    return 0.5 * passes.total(terms, len(time) - 1)


def _chatter(time: Floats, values: Floats, start: float) -> float:
    def squares(block: slice) -> Floats:
        found: Floats = np.square(np.diff(values[block.start : block.stop + 1]))
        return found

    return math.sqrt(passes.total(squares, len(values) - 1) / (len(values) - 1))


def _times(unit: str, factor: str) -> str:
    numerator, slash, denominator = unit.partition("/")
    return f"{factor if unit == '1' else f'{numerator}.{factor}'}{slash}{denominator}"


MEASURES: Mapping[str, Measure] = {
    "rms": Measure(_rms),
    "peak": Measure(
        lambda time, values, start: abs(float(values[passes.largest_magnitude(values)])), at=passes.largest_magnitude
    ),
    "final": Measure(lambda time, values, start: abs(float(values[-1]))),
    "itae": Measure(_itae, unit=lambda unit: _times(unit, "s2"), fewest=2),
    "effort": Measure(_effort, unit=lambda unit: _times(unit, "s"), fewest=2),
    "chatter": Measure(_chatter, fewest=2),
    "least": Measure(lambda time, values, start: float(values[passes.smallest(values)]), at=passes.smallest),
}
"""Root mean square; largest magnitude; last magnitude; integral of time times magnitude, whose time counts from the
start of the window; integral of the magnitude; root mean square of the change from sample to sample; smallest value.
Integrals are by the trapezoidal rule."""


def settling_times(result: Result, range_band: float, bearing_band: float) -> dict[str, float | None]:
    """Return from when on [s] both errors of each follower stay within their bands [m], [rad]; None if they do not."""
    distance, bearing = result.of_robots("range_error"), result.of_robots("bearing_error")

    def within(block: slice) -> NDArray[np.bool_]:  # NaN is not
        both: NDArray[np.bool_] = np.abs(distance[block]) <= range_band
        both &= np.abs(bearing[block]) <= bearing_band
        return both

    time = result["time"].values
    last = passes.last_outside(len(distance), distance.shape[1], within)
    return {
        robot: float(time[before + 1]) if before + 1 < len(time) else None
        for robot, before in zip(result.robots, last, strict=True)
    }


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


def _pairs(position: Floats, chosen: NDArray[np.bool_]) -> Iterable[tuple[int, int]]:
    """Return all pairs of points (T, N, 2) with one that is chosen; of many those alone that may be nearest, in order.

    While a few samples pass, two points are not nearer than the circles about all their places then.
    """
    samples, number = position.shape[:2]
    count = np.triu(chosen[:, np.newaxis] | chosen, 1) if samples else np.zeros((number, number), dtype=bool)
    if number > _FEW and count.any() and all(np.isfinite(position[block]).all() for block in blocks(samples, number)):
        parts = [slice(start, start + _TOGETHER) for start in range(0, samples, _TOGETHER)]
        limit = min(float(_apart(position[part.start])[count].min()) for part in parts)
        near = np.zeros_like(count)
        for part in parts:
            middle = position[part].mean(axis=0)
            reach = np.sqrt(((position[part] - middle) ** 2).sum(axis=-1).max(axis=0))
            near |= _apart(middle) - reach[:, np.newaxis] - reach <= (1 + _ROUNDING) * limit
            forget()
        count &= near
    one, other = np.nonzero(count)
    return zip(one.tolist(), other.tolist(), strict=True)


def _apart(points: Floats) -> Floats:
    """Return the distances (N, N) of points (N, 2)."""
    x, y = points.T
    return np.asarray(np.sqrt((x[:, np.newaxis] - x) ** 2 + (y[:, np.newaxis] - y) ** 2))


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
    chosen = np.array([not robots or name in robots for name in names], dtype=bool)
    for i, j in _pairs(position, chosen):

        def distances(both: Floats) -> Floats:
            return arrays.hypot(*(both[:, 0] - both[:, 1]).T)

        both = position[:, i : j + 1 : j - i]
        nearest = passes.smallest(both, distances)  # one that is not a number, if there is any
        distance = float(distances(both[nearest : nearest + 1])[0])
        if smallest is None or (not distance >= smallest.distance and not math.isnan(smallest.distance)):
            smallest = Nearest(distance, (names[i], names[j]), float(time[nearest]))
    return smallest
