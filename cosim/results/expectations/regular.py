"""No follower comes near a singularity of its controller, by the controller's signals."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.results.expectations.kind import Kind, Prepare, Recording, RunOther
from cosim.results.expectations.recorded import Recorded
from cosim.results.passes import extremes_of_each, missing, sign_changes, smallest
from cosim.results.result import Result
from cosim.results.verdict import Verdict

Floats: TypeAlias = NDArray[np.float64]


class Regular(Kind):
    """``<regular>``."""

    element = "regular"

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
        worst: dict[str, tuple[tuple[bool, float], float, str, str]] = {}
        thresholds: dict[str, float] = {}
        samples = self.samples(result)
        for name, signal in result.data_vars.items():
            if not signal.attrs.get("singular_at_zero"):
                continue
            thresholds[name] = threshold = float(signal.attrs.get("singular_below", 0.0))
            courses = result.of_robots(name)
            absent = missing(courses)  # another robot's controller has it
            rows = {robot: row for robot in self.followers(result) if not absent[row := result.row(robot)]}
            found = _nearness_of_each(courses[samples], list(rows.values()))
            for robot, (least, at, jumps) in zip(rows, found, strict=True):
                rank = (least - threshold > 0, least / threshold if threshold else math.inf)
                if robot not in worst or math.isnan(least) or rank < worst[robot][0]:
                    how = "changes sign" if jumps else "nearest to zero"
                    time = result["time"].values[samples][at]
                    worst[robot] = rank, least, name, f"{name} {how} at t = {time:.2f} s"
        return [
            self.verdict(
                least,
                margin=least - thresholds[name],
                passed=passed,
                robot=robot,
                detail=detail,
                bound=thresholds[name],
                unit=str(result[name].attrs["units"]),
            )
            for robot in self.followers(result)
            if robot in worst
            for (passed, _), least, name, detail in [worst[robot]]
        ]


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
