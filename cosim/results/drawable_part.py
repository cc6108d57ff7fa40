"""The drawable part of a result that has diverged: the samples before, at a legible scale."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.results.result import Result, Variable
from cosim.storage import blocks

Floats: TypeAlias = NDArray[np.float64]
Samples: TypeAlias = slice | NDArray[np.intp]
"""Which samples of a course."""
Part: TypeAlias = Callable[[Samples], Floats]
"""Returns some samples of a course."""

_LARGEST = 1e12
"""No motion that means anything reaches it; far larger numbers overflow when they are drawn."""
_LATE = 0.9
_GROWTH = 10.0


def drawable(result: Result) -> Result:
    """Return a result that can be drawn; values that are left out are NaN.

    Numbers that are not finite or enormous are left out. If the run ended early, so are numbers more than ten times as
    large as any in its first nine tenths: they would flatten the rest of the curve.
    """
    drawn = {name: replace(result[name], values=part(slice(None))) for name, part in drawable_parts(result).items()}
    return replace(result, data_vars={**result.data_vars, **drawn})


def drawable_parts(result: Result) -> dict[str, Part]:
    """Return, for each signal, a function that returns some samples of `drawable`: a long one is never made whole."""
    ended_early = result.attrs["status"] != "completed"
    return {
        name: _of_path(signal, ended_early) if name in ("pose", "leader_pose") else _of_signal(signal, ended_early)
        for name, signal in result.data_vars.items()
        if signal.dims[:1] == ("time",)
    }


def _of_signal(signal: Variable, ended_early: bool) -> Part:
    def raw(which: Samples) -> Floats:
        return np.array(signal.values[which], dtype=float)

    return _bounded(raw, signal, ended_early)


def _of_path(signal: Variable, ended_early: bool) -> Part:
    """Return a function for poses: a point of a path is drawn or not."""
    first = _first_known(signal.values)

    def distance(which: Samples) -> Floats:
        with np.errstate(over="ignore", invalid="ignore"):
            x, y = np.moveaxis(signal.values[which] - first, -1, 0)[:2]
            return np.asarray(np.hypot(x, y))

    most = _largest(distance, len(signal.values), first[..., 0].size) if ended_early else _LARGEST

    def points(which: Samples) -> Floats:
        values = np.array(signal.values[which], dtype=float)
        values[~(distance(which) <= most)] = np.nan
        return values

    return _bounded(points, signal, ended_early)


def _first_known(poses: Floats) -> Floats:
    """Return, for each robot, the first pose whose place is known (1, ...); of one that has none, the first."""
    first = np.array(poses[:1], dtype=float)
    of_robots = first.reshape(-1, first.shape[-1])
    unknown = ~(np.isfinite(of_robots[:, 0]) & np.isfinite(of_robots[:, 1]))
    for block in blocks(len(poses), first.size):
        if not unknown.any():
            break
        values = poses[block].reshape(-1, *of_robots.shape)
        is_known = np.isfinite(values[..., 0]) & np.isfinite(values[..., 1])
        for robot in np.flatnonzero(unknown & is_known.any(axis=0)):
            of_robots[robot] = values[:, robot][is_known[:, robot]][0]
            unknown[robot] = False
    return first


def _bounded(part: Part, signal: Variable, ended_early: bool) -> Part:
    """Leave out what is too large; components have other units, so each has a limit of its own."""
    components = signal.values.ndim > 1 + ("robot" in signal.dims)
    size = signal.values[:1].size

    def courses(which: Samples) -> Floats:
        values = part(which)
        return values if components else values[..., np.newaxis]

    def most(component: int) -> float:
        return _largest(lambda which: np.abs(courses(which)[..., component]), len(signal.values), size)

    count = signal.values.shape[-1] if components else 1
    limits = np.array([most(one) if ended_early else _LARGEST for one in range(count)])

    def bounded(which: Samples) -> Floats:
        values = courses(which)  # a copy
        values[~(np.abs(values) <= limits)] = np.nan
        return values if components else values[..., 0]

    return bounded


def _largest(magnitude: Part, samples: int, size: int) -> float:
    """Return up to which magnitude a course of a run that ended early is drawn."""
    largest = 0.0
    for block in blocks(min(int(_LATE * (samples - 1)) + 1, samples), size):
        early = magnitude(block)
        largest = max(largest, early[early <= _LARGEST].max(initial=0.0))
    return min(_GROWTH * largest, _LARGEST) if largest > 0.0 else _LARGEST
