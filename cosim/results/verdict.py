"""Verdicts on expectations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from cosim.errors import Location

_TEXTS = ("expectation", "robot", "unit", "known_failure", "detail")


@dataclass(frozen=True)
class Verdict:
    """An expectation and its outcome.

    Attributes
    ----------
    expectation : str
        The expectation, in words.
    robot : str
        The follower, or "leader"; empty if it is about the team.
    figure, bound : float
        The figure and its bound, in `unit`; NaN if there is none.
    unit : str
        The unit in which the bound is written; empty for a pure number.
    margin : float
        By how much it holds, in `unit`; negative if it does not.
    passed : bool
        Whether it holds.
    known_failure : str
        Why it is known not to hold; empty if it should.
    detail : str
        When, between whom, against what; or why there is no figure.
    where : Location
        Its place in the scenario.
    judged : bool
        Whether there was enough to judge it by; if not, it does not hold.
    """

    expectation: str
    robot: str
    figure: float
    bound: float
    unit: str
    margin: float
    passed: bool
    known_failure: str
    detail: str
    where: Location
    judged: bool = True

    @property
    def as_marked(self) -> bool:
        """Whether it holds, or fails as it is known to."""
        return self.passed != bool(self.known_failure)

    @property
    def outcome(self) -> str:
        """The outcome, in words."""
        if not self.judged:
            return "not judged"
        if not self.known_failure:
            return "holds" if self.passed else "FAILS"
        return f"{'holds, though marked as failing' if self.passed else 'fails as known'}: {self.known_failure}"

    @property
    def finding(self) -> str:
        """Robot, figure and margin in words."""
        told = "; ".join(text for text in (self.robot, self.detail) if text)
        if not math.isfinite(self.figure):
            numbers = "no figure"
        elif math.isnan(self.margin):
            numbers = f"{self.figure:.4g} {self.unit}".strip()
        else:
            numbers = f"{f'{self.figure:.4g} {self.unit}'.strip()}, margin {f'{self.margin:.3g} {self.unit}'.strip()}"
        return f"{numbers} ({told})" if told else numbers

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Self:
        """Return the verdict that was written as data, with None for NaN; raises TypeError or KeyError if none was."""
        if not isinstance(data["passed"], bool) or not all(isinstance(data[name], str) for name in _TEXTS):
            raise TypeError("no verdict: a text, or whether it passed, is missing")
        numbers = {name: math.nan if data[name] is None else data[name] for name in ("figure", "bound", "margin")}
        return cls(**{**data, **numbers, "where": Location(**data["where"])})

    def __str__(self) -> str:
        """Return expectation and outcome, in a line."""
        return f"{self.expectation}: {self.finding}"
