"""No follower comes near a singularity of its controller, by the controller's signals."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.clock import in_seconds
from cosim.results.expectations.kind import Kind, Prepare, Recording, RunOther
from cosim.results.expectations.recorded import Recorded, absent
from cosim.results.expectations.shown import Band
from cosim.results.passes import extremes_of_each, sign_changes, smallest
from cosim.results.result import Result
from cosim.results.verdict import Verdict

Floats: TypeAlias = NDArray[np.float64]


class Regular(Kind):
    """``<regular>``."""

    element = "regular"
    by_any = True

    @property
    def text(self) -> str:
        """The expectation in words, as verdicts show it."""
        return f"regular, {self.span}"

    @property
    def overview(self) -> str:
        """The expectation in words, as an overview of the scenario shows it."""
        return f"no singularity, {self.span}"

    def check(self, own: Recording, prepare: Prepare) -> None:
        """Check that controllers tell how near a singularity is."""
        self.check_within(own.scenario.horizon)
        telling = {robot for signal in own.signals.values() if signal.tells_singularity for robot in signal.robots}
        if not telling:
            raise self.written.error("no follower has a controller that signals singularities: remove <regular>")
        self.check_robots(telling, "controller that signals singularities")
        self.check_samples(own.scenario)

    def signals(self, known: Mapping[str, Recorded]) -> Collection[str]:
        """Return those that tell of a singularity."""
        return [name for name, signal in known.items() if signal.tells_singularity]

    def judge(self, result: Result, run_other: RunOther | None) -> list[Verdict]:
        """Judge each follower by the signal that comes nearest to zero, as measured by the signal's threshold."""
        nearest = self._nearest(result)
        return [
            self.verdict(
                found.least,
                margin=found.least - found.threshold,
                passed=found.rank[0],
                robot=robot,
                detail=str(found),
                bound=found.threshold,
                unit=str(result[found.signal].attrs["units"]),
            )
            for robot in self.followers(result)
            if (found := nearest.get(robot)) is not None
        ]

    def bands(self, result: Result) -> tuple[Band, ...]:
        """Return the signals that tell of a singularity, which belong outside of their thresholds."""
        return tuple(
            Band(name, "", self.written.start, self.written.stop, -threshold, threshold, inside=False)
            for name, threshold in _thresholds(result).items()
            if result[name].values.ndim == 2
        )

    def moments(self, result: Result) -> dict[str, float]:
        """Return when each follower is nearest to a singularity."""
        return {robot: found.time for robot, found in self._nearest(result).items()}

    def _nearest(self, result: Result) -> dict[str, _Nearest]:
        worst: dict[str, _Nearest] = {}
        samples = self.samples(result)
        time = result["time"].values[samples]
        for name, threshold in _thresholds(result).items():
            courses = result.of_robots(name)
            lacking = absent(result[name], result.robots)  # another robot's controller has it
            rows = {robot: row for robot in self.followers(result) if not lacking[row := result.row(robot)]}
            found = _nearness_of_each(courses[samples], list(rows.values()))
            for robot, (least, at, jumps) in zip(rows, found, strict=True):
                rank = (least - threshold > 0, least / threshold if threshold else math.inf)
                if robot not in worst or math.isnan(least) or rank < worst[robot].rank:
                    worst[robot] = _Nearest(rank, least, threshold, name, jumps, float(time[at]))
        return worst


class _Nearest(NamedTuple):
    """Where a follower comes nearest to a singularity: how near by which signal, and when; `rank` orders several."""

    rank: tuple[bool, float]
    least: float
    threshold: float
    signal: str
    jumps: bool
    time: float

    def __str__(self) -> str:
        """Return signal and time, in words."""
        how = "changes sign" if self.jumps else "is not a number" if math.isnan(self.least) else "nearest to zero"
        return f"{self.signal} {how} at t = {in_seconds(self.time)}"


def _thresholds(result: Result) -> dict[str, float]:
    """Return the signals that tell of a singularity, each with the magnitude below which it is near."""
    return {
        name: float(signal.attrs.get("singular_below", 0.0))
        for name, signal in result.data_vars.items()
        if signal.attrs.get("singular_at_zero")
    }


_Nearness: TypeAlias = tuple[float, int, bool]
"""How near to zero a signal comes, zero if it jumps over it; at which sample; whether it jumps."""


def _nearness_of_each(courses: Floats, chosen: Sequence[int]) -> list[_Nearness]:
    """Return how near to zero each that is chosen of courses (T, courses, ...) comes."""
    if courses.ndim > 2:
        return [_nearness(courses[:, course]) for course in chosen]
    found = []
    for course, ends in zip(chosen, extremes_of_each(courses, chosen), strict=True):
        low, high = (float(courses[at, course]) for at in ends)
        if low > 0.0:  # far on one side, as most are
            found.append((low, ends[0], False))
        elif high < 0.0:
            found.append((-high, ends[1], False))
        else:
            found.append(_nearness(courses[:, course]))
    return found


def _nearness(values: Floats) -> _Nearness:
    """Return how near to zero a course (T, ...) comes that may be on both sides of it."""
    numbers = values if values.ndim > 1 else values[:, np.newaxis]
    jumps, first = sign_changes(numbers)
    if jumps:
        return 0.0, first, True
    at = smallest(numbers, lambda part: np.abs(part).min(axis=1))
    return float(np.abs(numbers[at]).min()), at, False
