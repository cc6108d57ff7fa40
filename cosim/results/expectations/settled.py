"""From a time on, both errors of each follower stay within their bands."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from cosim.clock import ROUNDING
from cosim.errors import AfterTheEnd
from cosim.results.expectations.kind import Kind, Prepare, Recording, RunOther
from cosim.results.expectations.recorded import Recorded
from cosim.results.expectations.shown import Band
from cosim.results.metrics import settling_times
from cosim.results.result import Result
from cosim.results.verdict import Verdict
from cosim.scenario.scenario import Expectation
from plants import units


class Settled(Kind):
    """``<settled>``."""

    element = "settled"
    holds_with_gaps = True  # a missing sample counts as outside

    def __init__(self, written: Expectation) -> None:
        super().__init__(written)
        self.read_bound("by")
        self.bands_of_errors = written.positive("range", "m"), written.positive("bearing", "rad")

    @property
    def text(self) -> str:
        """The expectation in words, as verdicts show it."""
        distance, bearing = self.bands_of_errors
        return f"settled by {self.bound_text} within {distance:.12g} m and {math.degrees(bearing):.9g} deg"

    @property
    def overview(self) -> str:
        """The expectation in words, as an overview of the scenario shows it."""
        distance, bearing = self.bands_of_errors
        return f"settled by {self.bound_text} within {distance:.12g} m, {math.degrees(bearing):.9g} deg"

    def check(self, own: Recording, prepare: Prepare) -> None:
        """Check that the time is a tick within the run."""
        horizon = own.scenario.horizon
        if not 0 <= (by := self.written.quantity("by", "s")) < horizon:
            raise AfterTheEnd(f"by={by:.12g} s is not within the run of {horizon:.12g} s", self.written.where)
        if problem := own.scenario.clock.off_tick(by):
            raise self.written.error(f'by="{self.written.get("by")}" of <settled> {problem}')

    def signals(self, known: Mapping[str, Recorded]) -> Collection[str]:
        """Return both errors."""
        return {"range_error", "bearing_error"}

    def judge(self, result: Result, run_other: RunOther | None) -> list[Verdict]:
        """Judge each follower."""
        times = settling_times(result, *self.bands_of_errors)
        return [self._judged(times[robot], robot) for robot in self.followers(result)]

    def bands(self, result: Result) -> tuple[Band, ...]:
        """Return both errors with their bands."""
        start, stop = units.convert(self.bound, self.unit, "s"), float(result["time"].values[-1])
        return tuple(
            Band(signal, "", start, stop, -width, width)
            for signal, width in zip(("range_error", "bearing_error"), self.bands_of_errors, strict=True)
        )

    def moments(self, result: Result) -> dict[str, float]:
        """Return from when on each follower is settled; the end of the run if it is not."""
        end, times = float(result["time"].values[-1]), settling_times(result, *self.bands_of_errors)
        return {robot: end if (time := times[robot]) is None else time for robot in self.followers(result)}

    def _judged(self, settled: float | None, robot: str) -> Verdict:
        if settled is None:
            return self.verdict(math.nan, math.nan, False, robot, "outside at the end of the run")
        by = self.written.quantity("by", "s")
        passed = settled <= by + ROUNDING * max(by, 1.0)  # in seconds: in a smaller unit rounding is a larger number
        figure = units.convert(settled, "s", self.unit)
        margin = self.bound - figure
        return self.verdict(figure, max(margin, 0.0) if passed else margin, passed, robot, "")
