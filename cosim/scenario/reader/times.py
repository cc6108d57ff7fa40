"""Times in a scenario, measured against the run: within it, in order, and whole numbers of steps where they must be."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

from cosim.clock import ROUNDING, Clock, whole
from cosim.errors import AfterTheEnd
from cosim.quantity import whole_steps
from cosim.scenario.reader.element import Element
from cosim.scenario.written_element import Written

MAX_TICKS = 10_000_000
LONGEST = 1e100
"""Largest time [s]: the third power of a larger one may be infinite, and so may its number of steps."""


@dataclass(frozen=True)
class Times(Clock):
    """The communication points of a run, against which the times in elements are checked."""

    @classmethod
    def of(cls, simulation: Element) -> Self:
        """Read them from the <simulation> of a scenario."""
        step, horizon = simulation.positive("step", "s"), simulation.positive("horizon", "s")
        _not_too_long(simulation, "step", step)
        _not_too_long(simulation, "horizon", horizon)
        steps = horizon / step
        if steps > MAX_TICKS:
            raise simulation.error(f"the run has {steps:g} communication steps; at most {MAX_TICKS} are possible")
        return cls(step, _whole(simulation, f"horizon {horizon:.12g} s", steps, step, 1))

    def steps(self, element: Written, name: str, least: int = 0) -> int:
        """Return how many communication steps a time is."""
        time = element.not_negative(name, "s")
        if time > self.horizon + 0.5 * self.step:
            raise element.error(
                f'{name}="{element.get(name)}" of <{element.kind}> is longer than the run of {self.horizon:.12g} s'
            )
        return _whole(element, f"{name} {time:.12g} s", time / self.step, self.step, least)

    def exact(self, element: Written, name: str) -> float:
        """Return the time [s] of a jump; refuse a time that falls on no tick."""
        time = element.quantity(name, "s")
        if problem := self.off_tick(time):
            raise element.error(f'{name}="{element.get(name)}" of <{element.kind}> {problem}')
        return self.meant(time)

    def beginning(self, element: Written, name: str, *, exact: bool = True) -> float:
        """Return the time [s] at which an element begins; refuse a time after the end of the run."""
        time = self.meant(element.not_negative(name, "s"))
        if exact:
            self.exact(element, name)
        if time > self.horizon + ROUNDING:
            raise AfterTheEnd(
                f"the <{element.kind}> at {time:.12g} s is after the end of the run at {self.horizon:.12g} s",
                element.where,
            )
        return time

    def window(self, element: Written, end: float = math.inf, *, exact: bool = True) -> tuple[float, float]:
        """Return begin and end of an element [s]; the defaults are the start and a given end.

        Both must fall on ticks where something jumps there (`exact`); something that rises from one to the other does
        what is written between ticks, too.
        """
        start = self.beginning(element, "from", exact=exact) if "from" in element else 0.0
        stop = end
        if "to" in element:
            stop = self.meant(_not_too_long(element, "to", element.quantity("to", "s")))
            if exact:
                self.exact(element, "to")
        if start > stop:
            raise element.error(f"the window ends at {stop:.12g} s, before it begins at {start:.12g} s")
        return start, stop

    def span(self, element: Written, *, exact: bool) -> tuple[float, float]:
        """Return the window of what takes its time, so that its end must be later than its begin."""
        start, stop = self.window(element, exact=exact)
        if start == stop:
            raise element.error(f"it begins and ends at {start:.12g} s: the end must be later")
        return start, stop


def _not_too_long(element: Written, name: str, time: float) -> float:
    if time > LONGEST:
        raise element.error(f'{name}="{element.get(name)}" of <{element.kind}> is longer than {LONGEST:.12g} s')
    return time


def _whole(element: Written, what: str, steps: float, step: float, least: int) -> int:
    number = whole(steps)
    if number is None or number < least:
        raise element.error(
            f"the {what} is not a whole number of communication steps of {step:.12g} s, such as "
            + whole_steps(steps, step, least)
        )
    return number
