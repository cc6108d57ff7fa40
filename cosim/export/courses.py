"""The signals of a result as courses: a robot's numbers over time, each with a name and a unit."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cosim.results.expectations.recorded import units_by_component
from cosim.results.result import Result, Variable
from cosim.scenario.scenario import LEADER

_OF_LEADER = re.compile(r"(measured_|)leader_(.+)")
_OF_VEHICLE = {"pose": "pose_name", "velocity": "velocity_name", "torque": "torque_name", "command": "command_name"}
"""By the dimension ``..._component``, the coordinate with each vehicle's own names of its components."""


@dataclass(frozen=True, eq=False)
class Course:
    """A component of a signal of a robot, over time.

    Attributes
    ----------
    robot, signal, component : str
        Whose it is, the signal's name without ``leader_``, and the component's, which is empty for a signal without
        components.
    unit : str
        Its unit; "1" for a pure number.
    about : str
        Its description.
    values : ndarray (T,)
        Its values; a view.
    """

    robot: str
    signal: str
    component: str
    unit: str
    about: str
    values: NDArray[np.float64] = field(repr=False)

    @property
    def path(self) -> tuple[str, ...]:
        """Robot, signal and component, if it has any."""
        return tuple(part for part in (self.robot, self.signal, self.component) if part)


def courses_of(result: Result) -> Iterator[Course]:
    """Yield all signals of a result, robot by robot, the leader first.

    Left out is whatever a robot does not have, which is NaN at all times: components of other kinds of vehicles, and
    signals of other control laws.
    """
    rows = {robot: row for row, robot in enumerate((LEADER, *result.robots))}
    signals = {name: one for name, one in result.data_vars.items() if one.dims[:1] == ("time",)}
    for robot, row in rows.items():
        for name, variable in signals.items():
            if ("robot" in variable.dims) == (robot == LEADER):
                continue
            match = _OF_LEADER.fullmatch(name)
            called = match[1] + match[2] if match and robot == LEADER else name
            yield from _components(result, variable, called, robot, row)


def _components(result: Result, variable: Variable, signal: str, robot: str, row: int) -> Iterator[Course]:
    about = str(variable.attrs.get("long_name", signal))
    labels, units = _labels(result, variable), str(variable.attrs.get("units", "1"))
    own = own_names(result, variable, row)
    values = variable.values if robot == LEADER else variable.values[:, row - 1]
    values = values.reshape(len(values), len(labels))
    unit_of = units_by_component(labels, units)
    for k, name in enumerate(own):
        if name is not None and not np.isnan(values[:, k]).all():
            yield Course(robot, signal, name, unit_of[labels[k]] or "1", about, values[:, k])


def _labels(result: Result, variable: Variable) -> Sequence[str]:
    """Return the names of a signal's components; one that is empty if it has none."""
    dims = [dim for dim in variable.dims if dim not in ("time", "robot")]
    if not dims:
        return [""]
    if len(dims) == 1 and dims[0] in result:
        return [str(label) for label in result[dims[0]].values]
    return [str(number) for number in range(int(np.prod([result.sizes[dim] for dim in dims])))]


def own_names(result: Result, variable: Variable, row: int) -> Sequence[str | None]:
    """Return how a vehicle, by its row in the result, names the components of a signal; None for one that it lacks."""
    names = _OF_VEHICLE.get(variable.dims[-1].removesuffix("_component"), "")
    if names not in result or "vehicle" not in result:
        return _labels(result, variable)
    return [str(name) or None for name in result[names].values[row]]
