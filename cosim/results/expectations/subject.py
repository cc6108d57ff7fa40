"""The signal that an expectation is about."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.errors import nearest
from cosim.results.expectations.kind import Kind
from cosim.results.expectations.recorded import Recorded, units_by_component
from cosim.results.passes import missing
from cosim.results.result import Result, Variable, by_robot
from cosim.scenario.scenario import LEADER

Course: TypeAlias = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Times (T,) [s] and values (T, ...) over a window."""


@dataclass(frozen=True)
class Subject:
    """A signal, or a component of it."""

    signal: str
    component: str = ""

    def __str__(self) -> str:
        """Return how a message names it."""
        return f"{self.component} of {self.signal}" if self.component else self.signal

    def check(self, kind: Kind, known: Mapping[str, Recorded]) -> str:
        """Check that an expectation can be about it; return its unit."""
        name, component = self.signal, self.component
        error = kind.written.error
        if name not in known:
            raise error(f"the result has no signal {name!r}: {nearest(name, list(known))}")
        signal = known[name]
        if component not in signal.units:
            components = [key for key in signal.units if key]
            if not components:
                raise error(f"the signal {name!r} has no components: leave component={component!r} out")
            if not component:
                raise error(f"the signal {name!r} needs component=..., one of {', '.join(components)}")
            raise error(f"the signal {name!r} has no component {component!r}: {nearest(component, components)}")
        if signal.robots == (LEADER,) and kind.written.robots:
            raise error(f"the signal {name!r} is the leader's: leave robots=... out")
        kind.check_robots(signal.robots, f"signal {name!r}")
        return signal.units[component]

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
        if "robot" not in signal.dims:
            return {LEADER: (time, signal.values[samples])}
        courses = by_robot(signal)
        absent = missing(courses)
        rows = {robot: result.row(robot) for robot in kind.followers(result)}
        having = {robot: row for robot, row in rows.items() if not absent[row]}
        chosen = rows if kind.written.robots or not having else having
        return {robot: (time, courses[samples, row]) for robot, row in chosen.items()}

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
