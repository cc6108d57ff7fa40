"""The signal that an expectation is about, or its difference from another one."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.errors import nearest
from cosim.results.expectations.kind import Kind
from cosim.results.expectations.recorded import Recorded, absent, units_by_component
from cosim.results.expectations.shown import Band
from cosim.results.result import Result, Variable, by_robot
from cosim.scenario.scenario import LEADER, Expectation
from plants import UnitError, units

Course: TypeAlias = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Times (T,) [s] and values (T, ...) over a window."""


@dataclass(frozen=True)
class Subject:
    """A signal, or a component of it.

    Attributes
    ----------
    minus : Subject or None
        What is subtracted from it.
    robot : str
        Of what is subtracted: the follower whose signal it is; empty for the follower of whom something is expected.
    attribute : str
        Before the names of its attributes, for messages.
    """

    signal: str
    component: str = ""
    minus: Subject | None = None
    robot: str = ""
    attribute: str = ""

    @classmethod
    def of(cls, written: Expectation) -> Self:
        """Return the subject that an expectation has in its attributes."""
        own = cls(written.get("signal"), written.get("component"))
        if not any(name in written for name in ("minus", "minus_component", "minus_robot")):
            return own
        minus = cls(
            written.get("minus", own.signal),
            written.get("minus_component", own.component),
            robot=written.get("minus_robot"),
            attribute="minus_",
        )
        if (minus.signal, minus.component, minus.robot) == (own.signal, own.component, ""):
            raise written.error(
                f"the signal {str(own)!r} minus itself is always zero: name another by minus=... or "
                "minus_component=..., or another follower by minus_robot=..."
            )
        return replace(own, minus=minus)

    def __str__(self) -> str:
        """Return how a message names it."""
        own = f"{self.component} of {self.signal}" if self.component else self.signal
        whose = f" of {self.robot}" if self.robot else ""
        return f"{own}{whose} minus {self.minus}" if self.minus else f"{own}{whose}"

    @property
    def signals(self) -> Collection[str]:
        """The names of the signals that it is computed from."""
        return {self.signal} | ({self.minus.signal} if self.minus else set())

    def bands(self, start: float, stop: float, lower: float = -math.inf, upper: float = math.inf) -> tuple[Band, ...]:
        """Return it with its limits over a window; of a difference both signals, which have none by themselves."""
        if self.minus is None:
            return (Band(self.signal, self.component, start, stop, lower, upper),)
        return tuple(Band(one.signal, one.component, start, stop) for one in (self, self.minus))

    def check(self, kind: Kind, known: Mapping[str, Recorded]) -> str:
        """Check that an expectation can be about it; return its unit."""
        unit, signal = self._check(kind, known), known[self.signal]
        if signal.robots == (LEADER,) and kind.written.robots:
            raise kind.written.error(f"the signal {self.signal!r} is the leader's: leave robots=... out")
        kind.check_robots(signal.robots, f"signal {self.signal!r}")
        if self.minus is not None:
            self.minus._check_subtracted(self, unit, kind, known)
        return unit

    def _check(self, kind: Kind, known: Mapping[str, Recorded]) -> str:
        """Check signal and component; return the unit."""
        name, component = self.signal, self.component
        error = kind.written.error
        if name not in known:
            raise error(f"the result has no signal {name!r}: {nearest(name, list(known))}")
        signal = known[name]
        if component not in signal.units:
            components = [key for key in signal.units if key]
            attribute = f"{self.attribute}component"
            if not components and self.attribute:
                raise error(
                    f"the signal {name!r} has no components: give it as signal=..., and what has some as minus=..."
                )
            if not components:
                raise error(f"the signal {name!r} has no components: leave {attribute}={component!r} out")
            if not component:
                raise error(f"the signal {name!r} needs {attribute}=..., one of {', '.join(components)}")
            raise error(f"the signal {name!r} has no component {component!r}: {nearest(component, components)}")
        return signal.units[component]

    def _check_subtracted(self, own: Subject, unit: str, kind: Kind, known: Mapping[str, Recorded]) -> None:
        """Check that it can be subtracted from a subject, which has a unit."""
        error = kind.written.error
        its_unit, having = self._check(kind, known), known[self.signal].robots
        try:
            units.convert(1.0, its_unit, unit)
        except UnitError as wrong:
            raise error(f"{str(own)!r}, which is in {unit}: {wrong}") from None
        if having == (LEADER,):
            if self.robot:
                raise error(f"the signal {self.signal!r} is the leader's: leave minus_robot=... out")
            return
        if self.robot and self.robot not in having:
            raise error(f"{self.robot!r} has no signal {self.signal!r}: {nearest(self.robot, list(having))}")
        if not self.robot and known[own.signal].robots == (LEADER,):
            raise error(f"the signal {self.signal!r} is each follower's: say whose by minus_robot=...")
        if not self.robot:
            kind.check_robots(having, f"signal {self.signal!r}")
        elif all(self.is_own(own, robot) for robot in kind.written.robots or known[own.signal].robots):
            raise error(f"{str(own)!r} of {self.robot} is always zero: {self._another(own, known)}")

    def _another(self, own: Subject, known: Mapping[str, Recorded]) -> str:
        if len(known[own.signal].robots) == 1:
            return "no other follower has that signal"
        return "name another follower by robots=..."

    def is_own(self, own: Subject, robot: str) -> bool:
        """Return whether it is the very signal of a follower that it is subtracted from."""
        return (self.signal, self.component, self.robot) == (own.signal, own.component, robot)

    def unit(self, result: Result) -> str:
        """Return its unit in a result."""
        signal = result[self.signal]
        if not self.component:
            return str(signal.attrs["units"])
        return units_by_component(self._components(result)[1], signal.attrs["units"])[self.component]

    def courses(self, kind: Kind, result: Result) -> dict[str, Course]:
        """Return its course over the window of an expectation, by the followers that have it."""
        samples, signal = kind.samples(result), self._one(result)
        time = result["time"].values[samples]
        robots = kind.followers(result)
        chosen = robots if kind.written.robots else self._having(robots, result) or robots
        if self.minus is not None:
            differences = self.minus._subtracted(self, self._by_robot(chosen, result), result)
            return {robot: (time, course[samples]) for robot, course in differences.items()}
        if "robot" not in signal.dims:
            return {LEADER: (time, signal.values[samples])}
        courses = by_robot(signal)
        return {robot: (time, courses[samples, result.row(robot)]) for robot in chosen}

    def _having(self, robots: Sequence[str], result: Result) -> Sequence[str]:
        """Return which of some followers have it, and what is subtracted from it."""
        signal = self._one(result)
        if "robot" in signal.dims and not self.robot:
            lacking = absent(signal, result.robots)
            robots = [robot for robot in robots if not lacking[result.row(robot)]]
        return self.minus._having(robots, result) if self.minus else robots

    def _subtracted(
        self, own: Subject, courses: Mapping[str, NDArray[np.float64]], result: Result
    ) -> dict[str, NDArray[np.float64]]:
        """Return the courses of a subject less its own."""
        its = self._by_robot([self.robot] if self.robot else list(courses), result)
        factor = units.convert(1.0, self.unit(result), own.unit(result))
        return {
            robot: course - factor * (its[LEADER] if LEADER in its else its[self.robot or robot])
            for robot, course in courses.items()
            if not self.is_own(own, robot)
        }

    def _by_robot(self, robots: Collection[str], result: Result) -> dict[str, NDArray[np.float64]]:
        """Return its whole course, by the robots that are asked for; one of the leader by its name."""
        signal = self._one(result)
        if "robot" not in signal.dims:
            return {LEADER: signal.values}
        return {robot: signal.at("robot", result.row(robot)).values for robot in robots}

    def _one(self, result: Result) -> Variable:
        """Return the signal, or its component."""
        signal = result[self.signal]
        if not self.component:
            return signal
        dim, labels = self._components(result)
        return signal.at(dim, labels.index(self.component))

    def _components(self, result: Result) -> tuple[str, list[str]]:
        """Return the dimension of the signal's components, and their names."""
        (dim,) = (dim for dim in result[self.signal].dims if dim not in ("time", "robot"))
        return dim, [str(label) for label in result[dim].values]
