"""The base of all kinds of expectations: they are read, checked before the run and judged after it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar, TypeAlias

from cosim.clock import ROUNDING
from cosim.errors import AfterTheEnd
from cosim.quantity import spelled, split
from cosim.results.expectations.recorded import Recorded
from cosim.results.expectations.shown import Band
from cosim.results.result import Result
from cosim.results.verdict import Verdict
from cosim.scenario.scenario import Expectation, Scenario
from plants import UnitError, units


@dataclass(frozen=True)
class Recording:
    """A scenario and what its run will record.

    Attributes
    ----------
    scenario : Scenario
        The scenario.
    signals : dict
        The signals, by name.
    shapeless : dict
        The kind of vehicle of each follower that has no outline.
    """

    scenario: Scenario
    signals: Mapping[str, Recorded]
    shapeless: Mapping[str, str] = field(default_factory=dict)


Prepare: TypeAlias = Callable[[Path], Recording]
"""Returns the signals of another scenario, from its file; raises `InputError` if it cannot be run."""
RunOther: TypeAlias = Callable[[Path], Result]
"""Runs another scenario that has been prepared, from its file; raises `FormationError` if the run fails."""


class Kind(ABC):
    """A kind of expectation: an instance is one element of a scenario, with its attributes read.

    A kind is one module of this folder, which is found by itself, and an entry of the schema.

    Attributes
    ----------
    element : str
        The element's name; empty for a base of several kinds.
    fewest : int
        Samples that its window must hold.
    lasts : bool
        Whether its window must be longer than an instant.
    bound, unit : float, str
        The number that a figure is held against, in the unit in which it is written.
    others : tuple of Path
        Files of other scenarios that are run for it.
    of_bodies : bool
        Whether it is judged by the outlines in a result besides the signals.
    of_places : bool
        Whether x and y are all that it needs of a pose.
    holds_with_gaps : bool
        Whether it holds for sure if it does although samples are missing.
    by_any : bool
        Whether a follower that has some of its signals is judged by these.
    """

    element: ClassVar[str] = ""
    lasts: ClassVar[bool] = True
    fewest: int = 1
    bound: float = 0.0
    unit: str = "1"
    others: tuple[Path, ...] = ()
    of_bodies: bool = False
    of_places: bool = False
    holds_with_gaps: ClassVar[bool] = False
    by_any: ClassVar[bool] = False

    def __init__(self, written: Expectation) -> None:
        self.written = written

    @property
    @abstractmethod
    def text(self) -> str:
        """The expectation in words, as verdicts show it."""

    @property
    def overview(self) -> str:
        """The expectation in words, as an overview of the scenario shows it."""
        return self.text

    @abstractmethod
    def check(self, own: Recording, prepare: Prepare) -> None:
        """Refuse, with its place, an expectation that could not be judged after the run."""

    @abstractmethod
    def judge(self, result: Result, run_other: RunOther | None) -> list[Verdict]:
        """Return the verdict on each follower, or one on the team; None instead of `run_other`: nothing is run."""

    @abstractmethod
    def signals(self, known: Mapping[str, Recorded]) -> Collection[str]:
        """Return which signals of a run it is judged by, of all that are recorded."""

    # What shows why

    def bands(self, result: Result) -> tuple[Band, ...]:
        """Return the signals that it is about, with their limits."""
        return ()

    def moments(self, result: Result) -> Mapping[str, float]:
        """Return the times [s] that decide the verdicts, by follower; "" for a verdict on the team."""
        return {}

    # Reading and checking

    def read_bound(self, name: str) -> None:
        """Read the bound from an attribute that is a quantity."""
        self.bound, self.unit = split(self.written.get(name))

    def check_bound(self, unit: str, what: str) -> None:
        """Check that the bound is a finite number in a unit that fits."""
        try:
            bound = units.convert(self.bound, self.unit, unit)
        except UnitError as error:
            raise self.written.error(f"{what}, which is in {unit}: {error}") from None
        if not math.isfinite(bound):
            raise self.written.error(f"{what} is not a finite number")

    def check_robots(self, having: Collection[str], what: str) -> None:
        """Check that some follower has something, and every follower that is named."""
        if not having:
            raise self.written.error(f"no follower has a {what}")
        for robot in self.written.robots:
            if robot not in having:
                raise self.written.error(f"{robot!r} has no {what}; those that have: {', '.join(sorted(having))}")

    def check_within(self, horizon: float) -> None:
        """Check that the window is within the run."""
        start, stop = self.written.start, self.written.stop
        if stop > horizon + ROUNDING or start > stop or (self.lasts and start == stop):
            raise AfterTheEnd(
                f"the window from {start:.12g} s to {stop:.12g} s is not within the run of {horizon:.12g} s",
                self.written.where,
            )

    def check_samples(self, scenario: Scenario) -> None:
        """Check that the window holds samples of a scenario."""
        start, stop = self.written.start, self.written.stop
        if scenario.clock.samples_within(start, stop) < self.fewest:
            raise self.written.error(
                f"the window from {start:.12g} s to {stop:.12g} s holds too few of the samples of "
                f"{scenario.path.name}, which are {scenario.step:.12g} s apart"
            )

    # Judging

    def not_judged(self, robot: str, why: str) -> Verdict:
        """Return the verdict where nothing can be said; it holds in no way, not even as a known failure."""
        return replace(self.verdict(math.nan, math.nan, False, robot, why, known_failure=""), judged=False)

    @property
    def nothing_to_judge(self) -> Verdict:
        """The verdict where no follower has what it is about."""
        return self.not_judged("", "no follower has the signal, so that there is nothing to judge")

    @property
    def span(self) -> str:
        """The window in words."""
        return f"{self.written.start:.12g} to {self.written.stop:.12g} s"

    def window(self, result: Result) -> Result:
        """Return the samples of a result within the window."""
        return result.between(self.written.start - ROUNDING, self.written.stop + ROUNDING)

    def samples(self, result: Result) -> slice:
        """Return which samples of a result are within the window."""
        return result.samples(self.written.start - ROUNDING, self.written.stop + ROUNDING)

    def deciding(self, result: Result) -> slice:
        """Return which samples of a result must be there for it to be judged."""
        return self.samples(result)

    @property
    def bound_text(self) -> str:
        """The bound as it is written."""
        return spelled(self.bound, self.unit)

    def followers(self, result: Result) -> list[str]:
        """Return the followers of a result of whom it is expected."""
        chosen = self.written.robots
        return [robot for robot in result.robots if not chosen or robot in chosen]

    @cached_property
    def _said(self) -> str:
        return self.text

    def below(self, figure: float, robot: str, detail: str) -> Verdict:
        """Return the verdict on a figure, in the bound's unit, that must be less than the bound."""
        margin = self.bound - figure
        return self.verdict(figure, margin, margin > 0, robot, detail)

    def above(self, figure: float, robot: str, detail: str) -> Verdict:
        """Return the verdict on a figure, in the bound's unit, that must be greater than the bound."""
        margin = figure - self.bound
        return self.verdict(figure, margin, margin > 0, robot, detail)

    def verdict(
        self,
        figure: float,
        margin: float,
        passed: bool,
        robot: str,
        detail: str,
        *,
        bound: float | None = None,
        unit: str | None = None,
        known_failure: str | None = None,
    ) -> Verdict:
        """Return a verdict; bound, unit and known failure are those written, unless others are given.

        Nothing holds by an infinite figure, or against an infinite bound.
        """
        shown, held = self.unit if unit is None else unit, self.bound if bound is None else bound
        finite = math.isfinite(figure) and math.isfinite(held)
        if math.isinf(figure) or math.isinf(held):
            detail = "; ".join(part for part in ("a sample is infinite, or too large", detail) if part)
        return Verdict(
            expectation=self._said,
            robot=robot,
            figure=figure,
            bound=held,
            unit="" if shown == "1" else shown,
            margin=margin if finite else math.nan,
            passed=passed and finite,
            known_failure=self.written.get("fails") if known_failure is None else known_failure,
            detail=detail,
            where=self.written.where,
        )
