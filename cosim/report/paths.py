"""How far apart the paths of the same robots are in two runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.clock import ROUNDING
from cosim.results.result import Result
from cosim.scenario.scenario import LEADER

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Paths:
    """The paths of the leader and of the followers.

    Attributes
    ----------
    time : ndarray
        The times of the samples (T,) [s].
    places : dict
        The reference point (T, 2) of each robot [m], by its name.
    """

    time: Floats
    places: Mapping[str, Floats]

    @classmethod
    def of(cls, result: Result) -> Paths:
        """Return the paths of a result."""
        leader, poses = result["leader_pose"].values[:, :2], result["pose"].values[:, :, :2]
        followers = {robot: poses[:, row] for row, robot in enumerate(result.robots)}
        return cls(result["time"].values, {LEADER: leader, **followers})


def with_distances(runs: Iterable[tuple[Result, dict[str, Any]]]) -> list[dict[str, Any]]:
    """Return what a page shows of runs, each with the distances of its paths from those of each run before."""
    found: list[tuple[Paths, dict[str, Any]]] = []
    for result, content in runs:
        paths = Paths.of(result)
        found.append((paths, {**content, "apart": [apart(earlier, paths) for earlier, _ in found]}))
    return [content for _, content in found]


def apart(first: Paths, other: Paths) -> list[dict[str, Any]]:
    """Return, for each robot that both runs have, how far apart its two paths are.

    Returns
    -------
    list of dict
        The greatest ``distance`` first [m], at ``time`` [s], and that at the ``end`` of the shorter run, or None if a
        path has no number there. Between the samples of the other run its path is taken to be straight; before them,
        there is none.
    """
    end = min(first.time[-1], other.time[-1]) + ROUNDING
    times = first.time[: np.searchsorted(first.time, end, side="right")]
    same = len(times) <= len(other.time) and np.array_equal(times, other.time[: len(times)])
    found = []
    for robot in [robot for robot in first.places if robot in other.places]:
        own, theirs = first.places[robot][: len(times)], other.places[robot]
        there = theirs[: len(times)] if same else _between(times, other.time, theirs)
        distances = np.hypot(*(own - there).T)
        is_known = np.isfinite(distances)
        if is_known.any():
            at = int(np.argmax(np.where(is_known, distances, -1.0)))
            last = float(distances[-1]) if is_known[-1] else None
            found.append({"robot": robot, "distance": float(distances[at]), "time": float(times[at]), "end": last})
    return sorted(found, key=lambda one: -one["distance"])


def _between(times: Floats, known: Floats, places: Floats) -> Floats:
    return np.stack([np.interp(times, known, places[:, axis], left=np.nan) for axis in range(2)], axis=1)
