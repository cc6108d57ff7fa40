"""The plants of a run as the master sees them, and what starts them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, closing
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.known import Known
from cosim.master.robot import RobotSetup
from cosim.master.robot_plants import member
from cosim.plant.fleet import Fleet
from cosim.plant.fleet_step import CompiledFleet
from cosim.plant.member import Member
from cosim.plant.message import RobotMessage
from cosim.plant.saved import FleetState
from cosim.plant.spec import Value


class AnyFleet(Protocol):
    """Plants that the master steps together; see `cosim.plant.fleet.Fleet`.

    ``process`` names the process in which FMUs run that have none of their own: the harness, or a supervised one.
    """

    process: str
    messages: list[str]
    logged: list[RobotMessage]

    @property
    def companions(self) -> tuple[int, ...]:
        """The numbers of the processes that step plants besides this one."""

    def step(self, tick: int, step: float, given: NDArray[np.float64]) -> None:
        """Hold the inputs and advance every plant by one communication step."""

    def compiled(self, given: NDArray[np.float64]) -> CompiledFleet | None:
        """Return what compiled code needs in place of `step`; None if plants must be stepped from Python."""

    def settle(self, tick: int, step: float, found: int) -> None:
        """Keep the messages of a step of `compiled` code, and raise its failures."""

    def change(self, index: int, values: Sequence[Value], tick: int, step: float) -> None:
        """Give parameters of a plant other values, once the tick is recorded."""

    def saved(self, time: float) -> FleetState:
        """Return the state of all plants at a communication point [s]."""

    def restore(self, state: FleetState, tick: int, step: float) -> None:
        """Let plants that have just been started go on from a saved state."""


StartFleet: TypeAlias = Callable[
    [Sequence[RobotSetup], float, NDArray[np.float64], Sequence[tuple[int, ...]]], AbstractContextManager[AnyFleet]
]
"""Starts the plants of robots for a run until a time [s]: a robot's state is written into its row of an array from then
on, pose and velocities in its columns. The plants are those of a block, at whose end they may be ended."""


def start_fleet(
    robots: Sequence[RobotSetup], horizon: float, state: NDArray[np.float64], columns: Sequence[tuple[int, ...]]
) -> AbstractContextManager[AnyFleet]:
    """Start the FMUs of robots, and end them with the block."""
    return closing(Fleet(members_of(robots, horizon, columns), state))


def members_of(
    robots: Sequence[RobotSetup], horizon: float, columns: Sequence[tuple[int, ...]], known: Known | None = None
) -> list[Member]:
    """Return the plants of robots; what is known of them from other runs is not worked out again."""
    return [member(robot, horizon, own, known) for robot, own in zip(robots, columns, strict=True)]
