"""The smallest distance between the reference points of any two followers is above a bound."""

from __future__ import annotations

import math

from cosim.results.expectations.kind import Kind, Prepare, Recording, RunOther
from cosim.results.metrics import smallest_distance
from cosim.results.result import Result
from cosim.results.verdict import Verdict
from cosim.scenario.scenario import Expectation
from plants import units


class Distance(Kind):
    """``<distance>``, which is about the team."""

    element = "distance"

    def __init__(self, written: Expectation) -> None:
        super().__init__(written)
        self.read_bound("above")

    @property
    def text(self) -> str:
        """The expectation in words, as verdicts show it."""
        return f"distance between followers above {self.bound_text}, {self.span}"

    def check(self, own: Recording, prepare: Prepare) -> None:
        """Check that there are two followers, bound and window."""
        self.check_within(own.scenario.horizon)
        if len(own.scenario.followers) < 2:
            raise self.written.error("a single follower has no distance to another")
        self.check_bound("m", "the bound of the distance")
        if self.bound <= 0:
            raise self.written.error(
                "the bound of the distance is not greater than zero, so it would hold whatever happens"
            )
        self.check_samples(own.scenario)

    def judge(self, result: Result, run_other: RunOther | None) -> list[Verdict]:
        """Judge the two followers that came nearest to each other."""
        found = smallest_distance(self.window(result), self.written.robots)
        if found is None:
            return [self.above(math.nan, "", "no two followers")]
        distance, (one, other), time = found
        return [self.above(units.convert(distance, "m", self.unit), "", f"{one} and {other} at t = {time:.2f} s")]
