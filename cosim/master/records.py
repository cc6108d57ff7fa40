"""What is recorded of a run, for whoever looks at it while the run goes on, in another thread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from cosim.results.result import Result
from cosim.scenario.scenario import Scenario


class Part(Protocol):
    """Makes the result of some of the ticks that are recorded."""

    def __call__(self, ticks: slice, before: Result | None = None, *, described: bool = False) -> Result:
        """Return the result of some ticks.

        Parameters
        ----------
        ticks
            Which ones.
        before
            The result of earlier ones, whose last bearings go on in these.
        described
            Also say who is who, and where the run comes from.
        """


@dataclass(frozen=True)
class Records:
    """What is recorded of a run.

    Attributes
    ----------
    scenario : Scenario
        The scenario that is run.
    count : callable
        Returns how many ticks are recorded.
    part : Part
        Makes the result of some of them.
    """

    scenario: Scenario
    count: Callable[[], int]
    part: Part
