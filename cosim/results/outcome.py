"""The outcome of one run among many, as data: it can be pickled, and a failure is a value too."""

from __future__ import annotations

from dataclasses import dataclass

from cosim.errors import Failure
from cosim.results.follower_figures import FollowerFigures
from cosim.results.result import Result
from cosim.results.verdict import Verdict


@dataclass(frozen=True)
class RunOutcome:
    """How a run ended, and how well.

    Attributes
    ----------
    status : str
        ``completed``; or ``failed``: a plant or controller failed, or the motion diverged.
    verdicts : tuple of Verdict
        On the scenario's expectations; empty if it failed.
    figures : tuple of FollowerFigures
        Of each follower, up to where the run came.
    failure : Failure or None
        Robot, time and reason; None if it completed.
    plant_messages : tuple of str
        The FMUs' messages, each with robot and time.
    result : Result or None
        The signals that were to be recorded; None if these were only those that are needed.
    """

    status: str
    verdicts: tuple[Verdict, ...]
    figures: tuple[FollowerFigures, ...]
    failure: Failure | None = None
    plant_messages: tuple[str, ...] = ()
    result: Result | None = None

    @property
    def passed(self) -> bool:
        """Whether the run completed and all expectations hold."""
        return self.failure is None and all(verdict.passed for verdict in self.verdicts)

    @property
    def message(self) -> str:
        """Why it failed, with robot and time; empty if it completed."""
        return "" if self.failure is None else str(self.failure)
