"""Numbers that compiled code moves, and functions that it calls with arguments in memory."""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from cosim.compiled import COMPILED, compiled
from cosim.frames import Bound, call_bound
from cosim.master.moves import Move, Spots, add, move, move_finite, moves_between, spots, spots_by_tick

Floats = NDArray[np.float64]


def test_any_numbers_are_moved_to_any_places() -> None:
    random = np.random.default_rng(3)
    for _ in range(200):
        ticks, rows, columns = random.integers(1, 9, 3)
        table, now = random.normal(size=(ticks, rows, columns)), np.zeros((rows, columns + 2))
        size = int(random.integers(0, rows * columns + 1))
        of = random.permutation(rows * columns)[:size]
        to = random.permutation(now.size)[:size]
        if random.random() < 0.5:
            of, to = np.sort(of), np.sort(to)
        expected, tick = now.copy(), int(random.integers(ticks))
        expected.reshape(-1)[to] = table[tick].reshape(-1)[of]
        source = spots_by_tick(table)
        places, targets = source.first.reshape(-1)[of], spots(now).first.reshape(-1)[to]
        found = np.array(moves_between(Spots(targets), Spots(places, source.tick)))
        found = found.astype(np.int64).reshape(-1, len(Move))
        assert move_finite(found, 0, len(found), tick)
        np.testing.assert_array_equal(now, expected)
        add(found, 0, len(found), tick)
        expected.reshape(-1)[to] *= 2
        np.testing.assert_array_equal(now, expected)


@pytest.mark.parametrize("width", [3, 30])
def test_rows_of_an_array_are_one_move(width: int) -> None:
    table, now = np.random.default_rng(1).normal(size=(5, 7, width + 1)), np.zeros((7, width))
    moves = np.array(moves_between(spots(now), spots_by_tick(table[..., 1:])), dtype=np.int64)
    assert len(moves) == 1
    move(moves, 0, 1, 4)
    np.testing.assert_array_equal(now, table[4, :, 1:])


def test_rows_of_two_widths_that_alternate_are_two_moves() -> None:
    """As the recorded signals of robots do."""
    of, to, recorded = np.arange(24.0).reshape(4, 6), np.zeros((4, 4)), [0, 2, 3, 4]
    moves = np.array(moves_between(spots(to), spots(of)[:, recorded]), dtype=np.int64)
    assert moves[:, Move.ROWS].tolist() == [4, 4]
    move(moves, 0, len(moves), 0)
    np.testing.assert_array_equal(to, of[:, recorded])


@pytest.mark.parametrize("strange", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_moved_and_told(strange: float) -> None:
    for size, place in [(3, 1), *((7, place) for place in range(7))]:
        of, to = np.full(size, 1e308), np.zeros(size)
        of[place] = strange
        moves = np.array(moves_between(spots(to), spots(of)), dtype=np.int64)
        assert not move_finite(moves, 0, 1, 0)
        np.testing.assert_array_equal(to, of)
        of[place] = -0.0
        assert move_finite(moves, 0, 1, 0)


class Own(NamedTuple):
    flags: tuple[bool, bool]
    single: np.float32
    table: Floats
    record: NDArray[np.void]
    count: int
    nothing: tuple[()]
    last: bool


@compiled
def fill(own: Own, factor: float, out: Floats) -> None:
    out[0], out[1] = factor * own.table[1, 2], own.single
    out[2], out[3] = own.flags[1], own.count
    out[4], out[5] = own.record[1]["x"], own.last
    if factor < 0.0:
        raise ValueError("negative")


def own_values() -> Own:
    record = np.zeros(2, [("i", np.int64), ("x", np.float64)])
    record["x"] = 5.5
    return Own((False, True), np.float32(0.5), np.arange(12.0).reshape(2, 6)[:, ::2], record, -7, (), True)


def test_a_function_is_called_with_whatever_arguments_it_has() -> None:
    out = np.zeros(6)
    bound = Bound(fill, own_values(), 2.0, out)
    assert call_bound(*bound.numbers) == 0
    np.testing.assert_array_equal(out, [20.0, 0.5, 1.0, -7.0, 5.5, 1.0])


def test_an_exception_is_told() -> None:
    bound = Bound(fill, own_values(), -2.0, np.zeros(6))
    if COMPILED:
        assert call_bound(*bound.numbers) != 0
    else:
        with pytest.raises(ValueError, match="negative"):
            call_bound(*bound.numbers)


def test_other_arguments_are_refused() -> None:
    with pytest.raises(TypeError, match="not called with a str"):
        Bound(fill, "text", 1.0, np.zeros(6))
