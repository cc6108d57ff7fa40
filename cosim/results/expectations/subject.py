"""The signal that an expectation is about."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.errors import nearest
from cosim.results.expectations.kind import Kind
from cosim.results.expectations.recorded import Recorded, units_by_component
from cosim.scenario.scenario import LEADER

if TYPE_CHECKING:
    import xarray as xr

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

    def unit(self, result: xr.Dataset) -> str:
        """Return its unit in a result."""
        signal = result[self.signal]
        if not self.component:
            return str(signal.attrs["units"])
        (dim,) = (dim for dim in signal.dims if dim not in ("time", "robot"))
        components = [str(label) for label in signal[dim].values]
        return units_by_component(components, signal.attrs["units"])[self.component]

    def courses(self, kind: Kind, result: xr.Dataset) -> dict[str, Course]:
        """Return its course over the window of an expectation, by the followers that have it."""
        signal = result[self.signal]
        if self.component:
            (dim,) = (dim for dim in signal.dims if dim not in ("time", "robot"))
            signal = signal.sel({dim: self.component})
        if "robot" in signal.dims:
            courses = {robot: signal.sel(robot=robot) for robot in kind.followers(result)}
        else:
            courses = {LEADER: signal}
        having = {robot: course for robot, course in courses.items() if not np.isnan(course.values).all()}
        chosen = courses if kind.written.robots or not having else having
        windows = {robot: course.sel(time=kind.window) for robot, course in chosen.items()}
        return {robot: (window["time"].values, window.values) for robot, window in windows.items()}
