"""What is recorded of a run, for whoever looks at it while the run goes on, in another thread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from cosim.errors import Failure
from cosim.master.setup import Setup
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
    setup : Setup
        Its set-up.
    count : callable
        Returns how many ticks are recorded.
    part : Part
        Makes the result of some of them.
    whole : callable
        Makes the result of all of them once there are no more, from why the run has not reached its end, if so.
    """

    scenario: Scenario
    setup: Setup
    count: Callable[[], int]
    part: Part
    whole: Callable[[Failure | None], Result]
