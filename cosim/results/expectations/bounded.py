"""The base of expectations that compare a measure of a signal with a bound."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cosim.clock import in_seconds
from cosim.results.expectations.kind import Kind, Prepare, Recording, RunOther
from cosim.results.expectations.recorded import Recorded
from cosim.results.expectations.shown import Band
from cosim.results.expectations.subject import Subject
from cosim.results.metrics import Measure
from cosim.results.passes import largest_magnitude
from cosim.results.result import Result
from cosim.results.verdict import Verdict
from cosim.scenario.scenario import Expectation
from plants import units


class Bounded(Kind):
    """A measure of a signal of each follower is below a bound.

    Attributes
    ----------
    measure : Measure
        The measure.
    attribute : str
        The attribute with the bound, and how the measure must be to it.
    """

    measure: ClassVar[Measure]
    attribute: ClassVar[str] = "below"

    def __init__(self, written: Expectation) -> None:
        super().__init__(written)
        self.read_bound(self.attribute)
        self.subject = Subject.of(written)
        self.fewest = self.measure.fewest

    @property
    def text(self) -> str:
        """The expectation in words, as verdicts show it."""
        return f"{self.element} {self.subject} {self.attribute} {self.bound_text}, {self.span}"

    def check(self, own: Recording, prepare: Prepare) -> None:
        """Check signal, bound and window."""
        self.check_within(own.scenario.horizon)
        what = f"the bound of the {self.element} of {str(self.subject)!r}"
        self.check_bound(self.measure.unit(self.subject.check(self, own.signals)), what)
        if self.attribute == "below" and self.bound <= 0:
            raise self.written.error(f"{what} is not greater than zero, so the expectation cannot hold")
        self.check_samples(own.scenario)

    def signals(self, known: Mapping[str, Recorded]) -> Collection[str]:
        """Return its signals."""
        return self.subject.signals

    def judge(self, result: Result, run_other: RunOther | None) -> list[Verdict]:
        """Judge each follower that has such a signal."""
        unit = self.measure.unit(self.subject.unit(result))
        hold = self.below if self.attribute == "below" else self.above
        verdicts = []
        for robot, (time, course) in self.subject.courses(self, result).items():
            figure = units.convert(self.measure(time, course, self.written.start), unit, self.unit)
            verdicts.append(hold(figure, robot, self.detail(time, course, figure)))
        return verdicts

    def bands(self, result: Result) -> tuple[Band, ...]:
        """Return its signal, with the bound if single values are held against it."""
        lower, upper = self.limits(units.convert(self.bound, self.unit, self.measure.unit(self.subject.unit(result))))
        start = self.written.start if self.lasts else self.written.stop
        return self.subject.bands(start, self.written.stop, lower, upper)

    def limits(self, bound: float) -> tuple[float, float]:
        """Return the limits of single values for a bound in the signal's unit; infinite if none is held against it."""
        return -math.inf, math.inf

    def moments(self, result: Result) -> dict[str, float]:
        """Return when the figures came about; of a figure that sums up, when the signal was largest."""
        found = {}
        for robot, (time, course) in self.subject.courses(self, result).items():
            if len(time):
                at = self.measure.at(course)
                found[robot] = float(time[largest_magnitude(course) if at is None else at])
        return found

    def detail(self, time: NDArray[np.float64], course: NDArray[np.float64], figure: float) -> str:
        """Return when the figure came about, where that is one time; or why there is none."""
        if math.isnan(figure):
            return f"a sample is {'infinite' if np.isinf(course).any() else 'not a number'}"
        at = self.measure.at(course)
        return "" if at is None else f"at t = {in_seconds(time[at])}"
