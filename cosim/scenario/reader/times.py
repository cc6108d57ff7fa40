"""Times in a scenario, measured against the run: within it, in order, and whole numbers of steps where they must be."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

from cosim.quantity import whole_steps
from cosim.scenario.reader.element import Element
from cosim.scenario.written import Written

MAX_TICKS = 10_000_000


@dataclass(frozen=True)
class Times:
    """The communication points of a run.

    Attributes
    ----------
    step : float
        Communication step [s].
    ticks : int
        Communication steps of the run.
    """

    step: float
    ticks: int

    @classmethod
    def of(cls, root: Element) -> Self:
        """Read them from a scenario."""
        simulation = root.child("simulation")
        step, horizon = simulation.positive("step", "s"), simulation.positive("horizon", "s")
        steps = horizon / step
        if steps > MAX_TICKS:
            raise simulation.error(f"the run has {steps:g} communication steps; at most {MAX_TICKS} are possible")
        return cls(step, _whole(simulation, f"horizon {horizon:g} s", steps, step, 1))

    @property
    def horizon(self) -> float:
        """The end of the run [s]."""
        return self.ticks * self.step

    def steps(self, element: Written, name: str, least: int = 0) -> int:
        """Return how many communication steps a time is."""
        time = element.not_negative(name, "s")
        if time > self.horizon + 0.5 * self.step:
            raise element.error(
                f'{name}="{element.get(name)}" of <{element.kind}> is longer than the run of {self.horizon:g} s'
            )
        return _whole(element, f"{name} {time:g} s", time / self.step, self.step, least)

    def beginning(self, element: Written, name: str) -> float:
        """Return when something begins [s], which is not after the end of the run."""
        time = element.not_negative(name, "s")
        if time > self.horizon:
            raise element.error(f"the <{element.kind}> at {time:g} s is after the end of the run at {self.horizon:g} s")
        return time

    def window(self, element: Written, end: float = math.inf) -> tuple[float, float]:
        """Return begin and end of an element [s]; the defaults are the start and a given end."""
        start = self.beginning(element, "from") if "from" in element else 0.0
        stop = element.quantity("to", "s") if "to" in element else end
        if start > stop:
            raise element.error(f"the window ends at {stop:g} s, before it begins at {start:g} s")
        return start, stop

    def span(self, element: Written) -> tuple[float, float]:
        """Return when something that must last begins and ends [s]."""
        start, stop = self.window(element)
        if start == stop:
            raise element.error(f"it begins and ends at {start:g} s: the end must be later")
        return start, stop


def _whole(element: Written, what: str, steps: float, step: float, least: int) -> int:
    whole = round(steps)
    if whole < least or abs(steps - whole) > 1e-9 * max(whole, 1):
        raise element.error(
            f"the {what} is not a whole number of communication steps of {step:g} s, such as "
            + whole_steps(steps, step, least)
        )
    return whole
