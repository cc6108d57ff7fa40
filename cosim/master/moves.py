"""Numbers that are moved at every tick from one place in memory to another, as compiled code moves them."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import COMPILED, borrowing, part

Places: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True)
class Spots:
    """Where numbers are: their addresses at tick 0, and by how much these grow from tick to tick."""

    first: Places
    tick: int = 0

    def __getitem__(self, index: Any) -> Spots:
        return Spots(self.first[index], self.tick)


def spots(array: NDArray[np.float64]) -> Spots:
    """Return where the numbers of an array are, which are the same at all ticks."""
    return Spots(_offsets(array.shape, array.strides) + array.__array_interface__["data"][0])


@lru_cache(1024)
def _offsets(shape: tuple[int, ...], strides: tuple[int, ...]) -> Places:
    """Return where the numbers of an array are, counted from the first one."""
    offsets = np.zeros((), dtype=np.int64)
    for size, stride in zip(shape, strides, strict=True):
        offsets = np.add.outer(offsets, stride * np.arange(size, dtype=np.int64))
    return offsets


def spots_by_tick(array: NDArray[np.float64]) -> Spots:
    """Return where the numbers (ticks, ...) of an array are, with a part for each tick."""
    return Spots(spots(array[0]).first, array.strides[0]) if len(array) else Spots(np.zeros(0, dtype=np.int64))


class Move(IntEnum):
    """The columns of a move: rows of numbers, some columns each, from one address to another.

    The addresses grow from tick to tick and from row to row.
    """

    TO, TO_TICK, TO_ROW, OF, OF_TICK, OF_ROW, ROWS, COLUMNS = range(8)


_TO, _TO_TICK, _TO_ROW, _OF, _OF_TICK, _OF_ROW, _ROWS, _COLUMNS = map(int, Move)
_FEW = 32
"""Up to so many numbers are copied fastest here, by fours and then one by one."""


def moves_between(to: Spots, of: Spots) -> list[tuple[int, ...]]:
    """Return the moves, few of them, from some places to as many others; no place is moved to twice."""
    targets, sources = to.first.reshape(-1), of.first.reshape(-1)
    if not len(targets):
        return []
    to_first, of_first = int(targets[0]), int(sources[0])
    rows = _rows((targets - to_first).tobytes(), (sources - of_first).tobytes())
    return [(to_first + t, to.tick, tr, of_first + s, of.tick, sr, n, width) for t, s, n, width, tr, sr in rows]


@lru_cache(1024)
def _rows(to: bytes, of: bytes) -> list[list[int]]:
    """Return the rows of moves between places that are counted from the first ones.

    Each is to, from, the number of rows, the columns, and by how much the first two grow from row to row.
    """
    targets, sources = np.frombuffer(to, dtype=np.int64), np.frombuffer(of, dtype=np.int64)
    breaks = np.flatnonzero((np.diff(targets) != 8) | (np.diff(sources) != 8)) + 1
    firsts = np.concatenate(([0], breaks))
    lengths = np.diff(np.concatenate((firsts, [len(targets)])))
    rows: list[list[int]] = []
    alike = np.argsort(lengths, kind="stable")  # rows of one length beside each other, as signals of robots alternate
    for target, source, length in zip(
        targets[firsts][alike].tolist(), sources[firsts][alike].tolist(), lengths[alike].tolist(), strict=True
    ):
        if rows and rows[-1][3] == length:
            last = rows[-1]
            grown = target - last[0] - last[4] * (last[2] - 1), source - last[1] - last[5] * (last[2] - 1)
            if last[2] == 1 or grown == (last[4], last[5]):
                last[4:], last[2] = grown, last[2] + 1
                continue
        rows.append([target, source, 1, length, 0, 0])
    return rows


@part
def _move_four(to: int, of: int) -> bool:
    """Move four numbers, and return whether one is not finite; all are read first, as vector instructions do it."""
    a, b, c, d = load(of), load(of + 8), load(of + 16), load(of + 24)
    store(to, a)
    store(to + 8, b)
    store(to + 16, c)
    store(to + 24, d)
    return (a - a) + (b - b) + (c - c) + (d - d) != 0.0


@borrowing
def move(moves: Places, first: int, last: int, tick: int) -> None:
    """Do some of the moves for a tick."""
    for m in range(first, last):
        to = moves[m, _TO] + tick * moves[m, _TO_TICK]
        of = moves[m, _OF] + tick * moves[m, _OF_TICK]
        to_row, of_row, columns = moves[m, _TO_ROW], moves[m, _OF_ROW], moves[m, _COLUMNS]
        for _ in range(moves[m, _ROWS]):
            if columns > _FEW:
                copy(to, of, 8 * columns)
            else:
                fours = columns & ~3
                for j in range(0, fours, 4):
                    _move_four(to + 8 * j, of + 8 * j)
                for j in range(fours, columns):
                    store(to + 8 * j, load(of + 8 * j))
            to += to_row
            of += of_row


@borrowing
def move_finite(moves: Places, first: int, last: int, tick: int) -> bool:
    """Do some of the moves for a tick; return whether all the numbers are finite."""
    strange = 0
    for m in range(first, last):
        to = moves[m, _TO] + tick * moves[m, _TO_TICK]
        of = moves[m, _OF] + tick * moves[m, _OF_TICK]
        to_row, of_row, columns = moves[m, _TO_ROW], moves[m, _OF_ROW], moves[m, _COLUMNS]
        fours = columns & ~3
        for _ in range(moves[m, _ROWS]):
            for j in range(0, fours, 4):
                strange |= _move_four(to + 8 * j, of + 8 * j)
            for j in range(fours, columns):
                number = load(of + 8 * j)
                strange |= number - number != 0.0
                store(to + 8 * j, number)
            to += to_row
            of += of_row
    return strange == 0


@borrowing
def add(moves: Places, first: int, last: int, tick: int) -> None:
    """Do some of the moves for a tick, and add each number to the one that is there."""
    for m in range(first, last):
        to = moves[m, _TO] + tick * moves[m, _TO_TICK]
        of = moves[m, _OF] + tick * moves[m, _OF_TICK]
        for _ in range(moves[m, _ROWS]):
            for j in range(moves[m, _COLUMNS]):
                store(to + 8 * j, load(to + 8 * j) + load(of + 8 * j))
            to += moves[m, _TO_ROW]
            of += moves[m, _OF_ROW]


# Memory -----------------------------------------------------------------------------------------------------------


def _load_plain(address: int) -> float:
    return ctypes.c_double.from_address(int(address)).value


def _store_plain(address: int, number: float) -> None:
    ctypes.c_double.from_address(int(address)).value = number


def _copy_plain(to: int, of: int, size: int) -> None:
    ctypes.memmove(int(to), int(of), int(size))


def _memory() -> tuple[Callable[[int], float], Callable[[int, float], None], Callable[[int, int, int], None]]:
    from llvmlite import ir
    from numba import types
    from numba.core.cgutils import raw_memcpy
    from numba.extending import intrinsic

    place = ir.DoubleType().as_pointer()

    @intrinsic
    def load(_: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.load(builder.inttoptr(values[0], place))

        return types.float64(types.int64), generate

    @intrinsic
    def store(_: Any, address: Any, number: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            builder.store(values[1], builder.inttoptr(values[0], place))
            return context.get_dummy_value()

        return types.void(types.int64, types.float64), generate

    @intrinsic
    def copy(_: Any, to: Any, of: Any, size: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            target, source = (builder.inttoptr(value, ir.IntType(8).as_pointer()) for value in values[:2])
            raw_memcpy(builder, target, source, values[2], 1)  # type: ignore[no-untyped-call]
            return context.get_dummy_value()

        return types.void(types.int64, types.int64, types.int64), generate

    return load, store, copy  # type: ignore[return-value]


load, store, copy = _memory() if COMPILED else (_load_plain, _store_plain, _copy_plain)
"""``load(address)``, ``store(address, number)`` and ``copy(to, from, bytes)``."""
