"""The ticks of a run in compiled code: sense, control, actuate, record and step, segment by segment.

`advance` runs a segment of ticks in one call. Where Python has a share in a tick - a law in plain Python, a plant that
CVODE integrates, commands by hand - it runs one part of one tick. The numbers are the same bit for bit.

Whatever only moves numbers is a table of moves, and whatever a law or a plant does is called by its address. So there
is one `advance` for all scenarios, and it is compiled once.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum, IntFlag
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import borrowing
from cosim.control.exchange import Exchange
from cosim.frames import Bound, call_bound
from cosim.master.moves import Spots, add, move, move_finite, moves_between
from cosim.plant.fleet_step import CompiledFleet
from cosim.signals.chain import ChainArrays, apply

Floats: TypeAlias = NDArray[np.float64]
Places: TypeAlias = NDArray[np.int64]


class Ended(IntEnum):
    """Why a segment has ended: it is complete; the plants; a law's inputs, its function, its commands."""

    COMPLETE, PLANTS, INPUTS, RAISED, COMMANDS = range(5)


class Part(IntFlag):
    """Parts of a tick: measure; let the laws command; let that act, and record it; record the laws' signals; step."""

    SENSE, CONTROL, ACT, SIGNALS, GIVE, STEP, LEAD = (1 << bit for bit in range(7))
    ALL = 127


class Stage(IntEnum):
    """When numbers are moved.

    The true poses before they are measured; the inputs of the laws, and their commands; what acts on robots before the
    actuators, and besides; records; signals of the laws; inputs of the plants; where a given leader is.
    """

    SENSE, TAKE, COMMAND, ACT, BESIDES, RECORD, SIGNALS, GIVE, LEAD = range(9)


_COMPLETE, _PLANTS, _INPUTS, _RAISED, _COMMANDS = map(int, Ended)
_P_SENSE, _P_CONTROL, _P_ACT, _P_SIGNALS, _P_GIVE, _P_STEP, _P_LEAD = (1 << bit for bit in range(7))
_SENSE, _TAKE, _COMMAND, _ACT, _BESIDES, _RECORD, _SIGNALS, _GIVE, _LEAD = map(int, Stage)


class Loop(NamedTuple):
    """Everything that the ticks of a run need.

    Attributes
    ----------
    step, ticks, period
        The communication step [s], the number of the last tick, and the ticks of a period of control.
    moves, stages : ndarray
        Moves, see `cosim.master.moves`, and the first one of each `Stage`.
    laws : ndarray
        The numbers of a `Bound` for each law with its team.
    sensors, measured, actuators, acting
        The chains, and the values (robots, entries) that they change.
    fleet : CompiledFleet
        The plants.
    """

    step: float
    ticks: int
    period: int
    moves: Places
    stages: Places
    laws: Places
    sensors: ChainArrays
    measured: Floats
    actuators: ChainArrays
    acting: Floats
    fleet: CompiledFleet


class Wiring:
    """Who takes which number from where, and which laws are called. Whoever uses its arrays keeps it.

    Attributes
    ----------
    given : ndarray
        The inputs of the plants.
    laws : list of Bound
        The laws.
    elsewhere : Exchange or None
        The exchange with those that are in other environments.
    """

    def __init__(self) -> None:
        self._moves: list[list[tuple[int, ...]]] = [[] for _ in Stage]
        self._kept: list[object] = []
        self._arrays: tuple[Places, Places, Places] | None = None
        self.given: Floats = np.zeros(0)
        self.laws: list[Bound] = []
        self.elsewhere: Exchange | None = None

    def move(self, stage: Stage, to: Spots, of: Spots, *kept: object) -> None:
        """Move numbers at a stage of each tick; the arrays in which they are must be kept as long."""
        self._moves[stage] += moves_between(to, of)
        self._kept += kept
        self._arrays = None

    def arrays(self) -> tuple[Places, Places, Places]:
        """Return moves, stages and laws for a `Loop`."""
        if self._arrays is None:
            self._arrays = self._in_arrays()
        return self._arrays

    def _in_arrays(self) -> tuple[Places, Places, Places]:
        moves = [move for own in self._moves for move in own]
        stages = np.cumsum([0, *map(len, self._moves)], dtype=np.int64)
        laws: Sequence[tuple[int, ...]] = [law.numbers for law in self.laws]
        return (
            np.array(moves, dtype=np.int64).reshape(-1, 8),
            stages,
            np.array(laws, dtype=np.int64).reshape(-1, 3),
        )


@borrowing
def advance(loop: Loop, parts: int, first: int, last: int) -> tuple[int, int]:
    """Run parts of ticks until one of them, or until an FMU says something.

    Returns
    -------
    tuple of int
        The next tick, or the one in which the segment has ended; and why, of `Ended`.
    """
    moves, stages, laws, fleet = loop.moves, loop.stages, loop.laws, loop.fleet
    for tick in range(first, last):
        if parts & _P_SENSE:
            move(moves, stages[_SENSE], stages[_SENSE + 1], tick)
            apply(loop.sensors, tick, loop.measured)
        if parts & _P_CONTROL and tick % loop.period == 0:
            if not move_finite(moves, stages[_TAKE], stages[_TAKE + 1], tick):
                return tick, _INPUTS
            for k in range(len(laws)):
                if call_bound(laws[k, 0], laws[k, 1], laws[k, 2]) != 0:
                    return tick, _RAISED
            if not move_finite(moves, stages[_COMMAND], stages[_COMMAND + 1], tick):
                return tick, _COMMANDS
        if parts & _P_ACT:
            move(moves, stages[_ACT], stages[_ACT + 1], tick)
            apply(loop.actuators, tick, loop.acting)
            add(moves, stages[_BESIDES], stages[_BESIDES + 1], tick)
            move(moves, stages[_RECORD], stages[_RECORD + 1], tick)
        if parts & _P_SIGNALS:
            move(moves, stages[_SIGNALS], stages[_SIGNALS + 1], tick)
        if tick == loop.ticks:
            return tick + 1, _COMPLETE
        if parts & _P_GIVE:
            move(moves, stages[_GIVE], stages[_GIVE + 1], tick)
        if parts & _P_STEP:
            fleet.clock[0], fleet.clock[1] = tick * loop.step, loop.step
            if call_bound(fleet.call[0], fleet.call[1], fleet.call[2]) != 0 or fleet.found[0] != 0:
                return tick, _PLANTS
        if parts & _P_LEAD:
            move(moves, stages[_LEAD], stages[_LEAD + 1], tick + 1)
        if parts & _P_STEP and fleet.said[0] != 0:
            return tick + 1, _COMPLETE
    return last, _COMPLETE
