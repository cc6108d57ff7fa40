"""A measure of a signal, on average over the followers, is at most a factor times the same of another scenario."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping

import numpy as np

from cosim.clock import ROUNDING
from cosim.errors import FormationError, InputError
from cosim.quantity import spelled
from cosim.results.expectations.kind import Kind, Prepare, Recording, RunOther
from cosim.results.expectations.recorded import Recorded
from cosim.results.expectations.shown import Band
from cosim.results.expectations.subject import Subject
from cosim.results.metrics import MEASURES
from cosim.results.result import Result
from cosim.results.verdict import Verdict
from cosim.scenario.scenario import Expectation
from plants import UnitError, units


class Compare(Kind):
    """``<compare>``, which is about the team."""

    element = "compare"

    def __init__(self, written: Expectation) -> None:
        super().__init__(written)
        self.bound = float(written.get("factor", "nan"))
        if self.bound <= 0:
            raise written.error(f'factor="{written.get("factor")}" of <compare> must be greater than zero')
        self.name = written.get("measure")
        self.measure = MEASURES[self.name]
        self.fewest = self.measure.fewest
        self.subject = Subject.of(written)
        self.path = written.path("scenario")
        self.others = (self.path,)

    @property
    def text(self) -> str:
        """The expectation in words, as verdicts show it."""
        over = f" over {', '.join(self.written.robots)}" if self.written.robots else ""
        times = f"at most {spelled(self.bound)} times that of {self.path.name}"
        return f"{self.name} {self.subject}{over} {times}, {self.span}"

    def check(self, own: Recording, prepare: Prepare) -> None:
        """Check factor, signal and window, and that the other scenario can be run and has the same signal."""
        self.check_within(own.scenario.horizon)
        unit = self.measure.unit(self.subject.check(self, own.signals))
        self.check_bound("1", "the factor")
        self._check_other(own, prepare, unit)
        self.check_samples(own.scenario)

    def _check_other(self, own: Recording, prepare: Prepare, unit: str) -> None:
        path, error = self.path, self.written.error
        if os.path.realpath(path) == os.path.realpath(own.scenario.path):
            raise error("a scenario cannot be compared with itself")
        try:
            other = prepare(path)
        except InputError as wrong:
            raise error(f"the other scenario is wrong: {wrong}") from None
        stop, horizon = self.written.stop, other.scenario.horizon
        if stop > horizon + ROUNDING:
            raise error(f"the window ends at {stop:.12g} s, but {path.name} at {horizon:.12g} s")
        try:
            its_unit = self.measure.unit(self.subject.check(self, other.signals))
            self.check_samples(other.scenario)
            units.convert(1.0, its_unit, unit)
        except InputError as wrong:
            raise error(f"in the other scenario, {path.name}: {wrong.message}") from None
        except UnitError as wrong:
            has = f"{str(self.subject)!r} has another unit"
            raise error(f"in the other scenario, {path.name}, {has}: {wrong}") from None

    def signals(self, known: Mapping[str, Recorded]) -> Collection[str]:
        """Return its signals."""
        return self.subject.signals

    def judge(self, result: Result, run_other: RunOther | None) -> list[Verdict]:
        """Judge the team; the expectation fails, even if it is known to, if there is no other run to compare with."""
        unit = self.measure.unit(self.subject.unit(result))
        figure = self._mean(result)
        if run_other is None:
            return [self._without(figure, unit, f"there is no run of {self.path.name} to compare with")]
        try:
            other = run_other(self.path)
        except FormationError as error:
            return [self._without(figure, unit, f"the run of {self.path.name} failed: {error}")]
        reference = units.convert(self._mean(other), self.measure.unit(self.subject.unit(other)), unit)
        bound = self.bound * reference
        margin = bound - figure
        detail = f"{self.path.name}: {f'{reference:.4g} {unit}'.removesuffix(' 1')}"
        return [self.verdict(figure, margin, margin >= 0, "", detail, bound=bound, unit=unit)]

    def bands(self, result: Result) -> tuple[Band, ...]:
        """Return its signal."""
        return self.subject.bands(self.written.start, self.written.stop)

    def _without(self, figure: float, unit: str, why: str) -> Verdict:
        """Return the verdict of a comparison that could not be made; it does not count as the known failure."""
        return self.verdict(figure, math.nan, False, "", why, bound=math.nan, unit=unit, known_failure="")

    def _mean(self, result: Result) -> float:
        courses = self.subject.courses(self, result).values()
        return float(np.mean([self.measure(time, course, self.written.start) for time, course in courses]))
