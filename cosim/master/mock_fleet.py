"""A fleet made from a function: the master runs in milliseconds, with no FMU."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.master.robot import RobotSetup
from cosim.plant.fleet import HARNESS
from cosim.plant.message import RobotMessage
from cosim.plant.saved import FleetState
from cosim.plant.spec import Value

Motion: TypeAlias = Callable[[float, NDArray[np.float64]], NDArray[np.float64]]
"""Returns pose and pseudo-velocities (plants, ...) at a time [s], from the inputs that were held until then."""


class MockFleet:
    """Plants whose motion is a function of time and inputs.

    Parameters
    ----------
    motion
        The function; of the inputs it gets NaN at the start.
    robots, horizon, state, columns
        As for a `cosim.master.fleets.StartFleet`: ``functools.partial(MockFleet, motion)`` is one.

    Attributes
    ----------
    changes : list of tuple
        Time [s], plant and values of each change of parameters.
    closed : bool
        Whether the plants have ended.
    """

    def __init__(
        self,
        motion: Motion,
        robots: Sequence[RobotSetup],
        horizon: float,
        state: NDArray[np.float64],
        columns: Sequence[tuple[int, ...]],
    ) -> None:
        self.process, self.companions = HARNESS, ()
        self.messages: list[str] = []
        self.logged: list[RobotMessage] = []
        self.changes: list[tuple[float, str, Sequence[Value]]] = []
        self.closed = False
        self._names = [robot.name for robot in robots]
        self._motion = motion
        self._state = state
        inputs = sum(len(robot.kind.command) + len(robot.inputs) for robot in robots)
        self._state[:] = motion(0.0, np.full(inputs, np.nan))

    def step(self, tick: int, step: float, given: NDArray[np.float64]) -> None:
        """Move the plants to where they are at the next communication point."""
        self._state[:] = self._motion((tick + 1) * step, given)

    def compiled(self, given: NDArray[np.float64]) -> None:
        """Return None: the function is Python."""

    def settle(self, tick: int, step: float, found: int) -> None:
        """Do nothing: no step is compiled."""

    def change(self, index: int, values: Sequence[Value], tick: int, step: float) -> None:
        """Take note of parameters that change."""
        self.changes.append((tick * step, self._names[index], values))

    def saved(self, time: float) -> FleetState:
        """Return nothing but the messages: the motion is a function."""
        return FleetState((), tuple(self.messages), tuple(self.logged), ())

    def restore(self, state: FleetState, tick: int, step: float) -> None:
        """Take over the messages."""
        self.messages, self.logged = list(state.messages), list(state.logged)

    def __enter__(self) -> Self:
        """Return the plants."""
        return self

    def __exit__(self, *_: object) -> None:
        self.closed = True
