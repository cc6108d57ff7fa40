"""The magnitude of a signal at the end of a window is below a bound."""

from __future__ import annotations

from cosim.results.expectations.bounded import Bounded
from cosim.results.metrics import MEASURES
from cosim.results.result import Result


class Final(Bounded):
    """``<final>``, whose window may be an instant."""

    element = "final"
    measure = MEASURES["final"]
    lasts = False

    def limits(self, bound: float) -> tuple[float, float]:
        """Return the limits of the magnitude."""
        return -bound, bound

    def deciding(self, result: Result) -> slice:
        """Return the last sample of the window."""
        samples = self.samples(result)
        return slice(max(samples.stop - 1, samples.start), samples.stop)

    def moments(self, result: Result) -> dict[str, float]:
        """Return the end of the window."""
        return dict.fromkeys(self.subject.courses(self, result), self.written.stop)
