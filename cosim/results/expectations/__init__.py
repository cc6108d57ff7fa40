"""Expectations: conditions for a run to pass, checked before the run and judged after it.

Each kind of expectation is a module of this folder, with a class that names its element in the schema. Two functions
are handed in for other scenarios: one that returns their signals, and one that runs them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import TYPE_CHECKING

from cosim.errors import AfterTheEnd
from cosim.kinds_by_element import kinds_in
from cosim.results.expectations.kind import Kind, Prepare, Recording, RunOther
from cosim.results.expectations.recorded import Recorded, recorded
from cosim.results.result import Result
from cosim.results.verdict import Verdict
from cosim.scenario.scenario import Expectation, Scenario

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "KINDS",
    "Kind",
    "Prepare",
    "Recorded",
    "Recording",
    "RunOther",
    "check",
    "judge",
    "needed",
    "needs_outlines",
    "recorded",
    "understood",
]


KINDS: Mapping[str, type[Kind]] = kinds_in(__name__, __path__, Kind)
"""The kinds of expectations, by the element's name."""


@lru_cache(256)
def understood(written: Expectation) -> Kind:
    """Return an expectation with its attributes read.

    Raises
    ------
    InputError
        A value makes no sense, with the place in the scenario.
    """
    return KINDS[written.kind](written)


def check(
    scenario: Scenario, signals: Mapping[str, Recorded], prepare: Prepare, shapeless: Mapping[str, str] | None = None
) -> None:
    """Check that every expectation of a scenario can be judged when it has run.

    Parameters
    ----------
    scenario
        The scenario.
    signals
        The signals that its run will record, by name.
    prepare
        Returns the signals of another scenario.
    shapeless
        The kind of vehicle of each follower that has no outline.

    Raises
    ------
    InputError
        An expectation is about a signal, component, follower or body that is not there, its bound has a unit that does
        not fit, its window holds no sample, or what it compares with cannot be run; with the place in the scenario.
    """
    for expectation in scenario.expectations:
        try:
            understood(expectation).check(Recording(scenario, signals, shapeless or {}), prepare)
        except AfterTheEnd as error:
            raise error.advised(scenario.changes) from None


def needed(expectations: Iterable[Expectation], known: Mapping[str, Recorded]) -> frozenset[str]:
    """Return which of the signals that a run records its expectations are judged by."""
    return frozenset(signal for written in expectations for signal in understood(written).signals(known))


def needs_outlines(expectations: Iterable[Expectation]) -> bool:
    """Return whether expectations are judged by the outlines in a result, besides signals."""
    return any(understood(written).of_bodies for written in expectations)


def judge(
    expectations: Iterable[Expectation], result: xr.Dataset | Result, run_other: RunOther | None
) -> tuple[Verdict, ...]:
    """Return the verdict on each expectation and follower; on an expectation about the team, one.

    A follower whose controller has no such signal is left out. An expectation that is then about nobody does not hold.

    Parameters
    ----------
    expectations
        Those of a scenario, which `check` has accepted.
    result
        Its result, complete.
    run_other
        Runs another scenario; None if none is to be run: a comparison then has no figure and does not hold.

    Raises
    ------
    RunInterrupted
        The user pressed Ctrl-C while another scenario ran.
    """
    arrays = Result.of(result)
    kinds = map(understood, expectations)
    return tuple(verdict for kind in kinds for verdict in kind.judge(arrays, run_other) or [kind.nothing_to_judge])
