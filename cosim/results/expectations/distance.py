"""The smallest distance between any two followers is above a bound: that of reference points, or that of bodies."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from cosim.clock import in_seconds
from cosim.results.body_distance import smallest_body_distance
from cosim.results.expectations.kind import Kind, Prepare, Recording, RunOther
from cosim.results.expectations.recorded import Recorded
from cosim.results.expectations.shown import Band
from cosim.results.metrics import Nearest, smallest_distance
from cosim.results.result import Result
from cosim.results.verdict import Verdict
from cosim.scenario.scenario import Expectation
from plants import units

REFERENCE_POINTS, BODIES = "distance of reference points", "distance of bodies"
"""What an expectation is about, in place of a recorded signal: the distance to the nearest other follower."""


class Distance(Kind):
    """``<distance>``, which is about the team."""

    element = "distance"

    def __init__(self, written: Expectation) -> None:
        super().__init__(written)
        self.read_bound("above")
        self.of_bodies = written.get("of", "reference_points") == "bodies"
        self.of_places = not self.of_bodies

    @property
    def text(self) -> str:
        """The expectation in words, as verdicts show it."""
        robots = ", ".join(self.written.robots)
        if self.of_bodies:
            of = f"of the bodies of {robots} from those of other" if robots else "between bodies of"
        else:
            of = f"of {robots} from other" if robots else "between"
        return f"distance {of} followers above {self.bound_text}, {self.span}"

    def check(self, own: Recording, prepare: Prepare) -> None:
        """Check that there are two followers, bound and window, and that followers have bodies if these count."""
        self.check_within(own.scenario.horizon)
        if len(own.scenario.followers) < 2:
            raise self.written.error("a single follower has no distance to another")
        self.check_bound("m", "the bound of the distance")
        if self.bound < 0 or (self.bound == 0 and not self.of_bodies):
            least = "is negative" if self.of_bodies else "is not greater than zero"
            raise self.written.error(f"the bound of the distance {least}, so it would hold whatever happens")
        if self.of_bodies and own.shapeless:
            robot, kind = next(iter(own.shapeless.items()))
            raise self.written.error(
                f'of="bodies" of <distance> needs the outline of every follower, but {robot} has none, as the kind of '
                f'vehicle {kind!r} states none: state one in the kind, or leave of="bodies" out for the distance of '
                "reference points"
            )
        self.check_samples(own.scenario)

    def signals(self, known: Mapping[str, Recorded]) -> Collection[str]:
        """Return the poses."""
        return {"pose"}

    def followers(self, result: Result) -> list[str]:
        """Return all: the nearest to one of whom it is expected may be any."""
        return list(result.robots)

    def judge(self, result: Result, run_other: RunOther | None) -> list[Verdict]:
        """Judge the two followers that came nearest to each other."""
        found = self._nearest(result)
        if found is None:
            return [self.above(math.nan, "", self._why_none(self.window(result)))]
        one, other = found.between
        how = f"{one} and {other} overlap first" if self.of_bodies and found.distance == 0 else f"{one} and {other}"
        detail = f"{how} at t = {in_seconds(found.time)}"
        return [self.above(units.convert(found.distance, "m", self.unit), "", detail)]

    def bands(self, result: Result) -> tuple[Band, ...]:
        """Return the distance with its bound."""
        lower = units.convert(self.bound, self.unit, "m")
        return (Band(BODIES if self.of_bodies else REFERENCE_POINTS, "", self.written.start, self.written.stop, lower),)

    def moments(self, result: Result) -> dict[str, float]:
        """Return when the two were nearest."""
        found = self._nearest(result)
        return {} if found is None else {"": found.time}

    def _nearest(self, result: Result) -> Nearest | None:
        nearest = smallest_body_distance if self.of_bodies else smallest_distance
        return nearest(self.window(result), self.written.robots)

    def _why_none(self, window: Result) -> str:
        if self.of_bodies and window.sizes["robot"] > 1 and window.sizes["time"]:
            return "the result does not hold the outline of every follower"
        return "no two followers"
