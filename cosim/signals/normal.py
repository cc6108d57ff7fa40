"""Streams of normal numbers, drawn side by side in compiled code: the numbers of NumPy's generators, sooner.

NumPy's `SeedSequence` makes the first state of the seed and the name of a stream, PCG64 (O'Neill, HMC-CS-2014-0905)
makes whole numbers, and the ziggurat of Marsaglia and Tsang (doi:10.18637/jss.v005.i08) makes normal numbers of these.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import COMPILED, compiled, part
from cosim.signals.random import Streams, go_on, random_stream, state_of, words_of, words_of_names

Floats: TypeAlias = NDArray[np.float64]
Words: TypeAlias = NDArray[np.uint64]

ZIGGURAT: Any = None
"""NumPy's tables, which Numba has; None where NumPy's own code draws: without Numba, or with one that lacks them."""
if COMPILED:
    with suppress(ImportError):
        ZIGGURAT = import_module("numba.np.random._constants")


class NormalStreams:
    """Streams of standard normal numbers, each named by a robot and its purpose as for `random_stream`.

    Parameters
    ----------
    names
        The names of the streams.

    Attributes
    ----------
    names : sequence
        The same.
    """

    def __init__(self, names: Sequence[tuple[str, str]]) -> None:
        self.names = names
        self._words = np.array([words_of_names(*name) for name in names], dtype=np.uint32).reshape(len(names), -1)
        self._states = np.zeros((4, len(names)), dtype=np.uint64)
        self._marked = self._states.T
        self._joined = tuple(map("/".join, names))
        self._plain: list[np.random.Generator] = []

    def begin(self, seed: int) -> None:
        """Begin all streams with a seed."""
        if ZIGGURAT is not None:
            begin_all(words_of(seed), self._words, self._states)
        else:
            self._plain = [random_stream(seed, *name) for name in self.names]

    def mark(self) -> None:
        """Keep the states of the streams as they are, for `marked`."""
        if ZIGGURAT is not None:
            self._marked = self._states.T.copy()
        else:
            self._marked = np.array([state_of(stream) for stream in self._plain], dtype=np.uint64).reshape(-1, 4)

    @property
    def marked(self) -> Streams:
        """The states of the streams that were kept."""
        return Streams(self._joined, self._marked)

    def go_on(self, streams: Streams) -> None:
        """Let those streams go on from a state that have one there."""
        states = streams.by_name
        for index, name in enumerate(self._joined):
            if name in states and ZIGGURAT is not None:
                self._states[:, index] = states[name]
            elif name in states:
                go_on(self._plain[index], states[name])

    def draw(self, deviations: Floats, out: Floats, columns: NDArray[np.int64]) -> None:
        """Write the next numbers of each stream, times its standard deviation, into its column (ticks, ...)."""
        if ZIGGURAT is not None:
            draw_all(deviations, out, columns, self._states)
            return
        for deviation, column, stream in zip(deviations, columns, self._plain, strict=True):
            out[:, column] = deviation * stream.standard_normal(len(out))


# Seeds: NumPy's SeedSequence ---------------------------------------------------------------------------------------

_LOW = np.uint64(0xFFFFFFFF)
_HALF, _WORD = np.uint64(16), np.uint64(32)
_INIT_A, _MULT_A = np.uint64(0x43B0D7E5), np.uint64(0x931E8875)
_INIT_B, _MULT_B = np.uint64(0x8B51F9DD), np.uint64(0x58F38DED)
_MIX_L, _MIX_R = np.uint64(0xCA01F9DD), np.uint64(0x4973F715)


@part
def _hashed(word: np.uint64, constant: np.uint64, factor: np.uint64) -> tuple[np.uint64, np.uint64]:
    """Return a hash of a word of 32 bits, and the constant for the next one."""
    following = (constant * factor) & _LOW
    value = ((word ^ constant) * following) & _LOW
    return value ^ (value >> _HALF), following


@part
def _mixed(one: np.uint64, other: np.uint64) -> np.uint64:
    value = (_MIX_L * one - _MIX_R * other) & _LOW
    return value ^ (value >> _HALF)


@compiled
def begin_all(seed: NDArray[np.uint32], names: NDArray[np.uint32], states: Words) -> None:
    """Write the first states (4, streams): both words of the state, and both of the increment.

    Parameters
    ----------
    seed
        Its words of 32 bits, at least four.
    names
        The words of each stream's name (streams, words).
    """
    pool, words = np.zeros(4, dtype=np.uint64), np.zeros(4, dtype=np.uint64)
    count = len(seed)
    for stream in range(len(names)):
        constant = _INIT_A
        for place in range(4):
            pool[place], constant = _hashed(np.uint64(seed[place]), constant, _MULT_A)
        for source in range(4):
            for place in range(4):
                if source != place:
                    hashed, constant = _hashed(pool[source], constant, _MULT_A)
                    pool[place] = _mixed(pool[place], hashed)
        for source in range(4, count + names.shape[1]):
            word = np.uint64(seed[source]) if source < count else np.uint64(names[stream, source - count])
            for place in range(4):
                hashed, constant = _hashed(word, constant, _MULT_A)
                pool[place] = _mixed(pool[place], hashed)
        constant = _INIT_B
        for place in range(4):
            low, constant = _hashed(pool[2 * place & 3], constant, _MULT_B)
            high, constant = _hashed(pool[(2 * place + 1) & 3], constant, _MULT_B)
            words[place] = low | (high << _WORD)
        states[2, stream] = (words[2] << _ONE) | (words[3] >> _TOP)
        states[3, stream] = (words[3] << _ONE) | _ONE
        low = states[3, stream] + words[1]  # from a state of zero, a step leads to the increment
        states[0, stream] = states[2, stream] + words[0] + (_ONE if low < words[1] else _ZERO)
        states[1, stream] = low
        _next(states, stream)


# Whole numbers: PCG64 ----------------------------------------------------------------------------------------------

_ZERO, _ONE, _TOP = np.uint64(0), np.uint64(1), np.uint64(63)
_FACTOR_HIGH, _FACTOR_LOW = np.uint64(0x2360ED051FC65DA4), np.uint64(0x4385DF649FCCF645)
_ROTATION = np.uint64(58)


def _make_high_of_product() -> Callable[[np.uint64, np.uint64], np.uint64]:
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    @intrinsic
    def product(_: Any, one: Any, other: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            wide = ir.IntType(128)
            whole = builder.mul(*(builder.zext(value, wide) for value in values))
            return builder.trunc(builder.lshr(whole, ir.Constant(wide, 64)), ir.IntType(64))

        return types.uint64(types.uint64, types.uint64), generate

    return product  # type: ignore[return-value]


if COMPILED:
    _high_of_product = _make_high_of_product()


@part
def _next(states: Words, stream: int) -> np.uint64:
    """Return the next 64 bits of a stream."""
    high, low = states[0, stream], states[1, stream]
    product = low * _FACTOR_LOW
    high = _high_of_product(low, _FACTOR_LOW) + high * _FACTOR_LOW + low * _FACTOR_HIGH + states[2, stream]
    low = product + states[3, stream]
    high += _ONE if low < product else _ZERO
    states[0, stream], states[1, stream] = high, low
    by, mixed = high >> _ROTATION, high ^ low
    rotated: np.uint64 = (mixed >> by) | (mixed << ((_ZERO - by) & _TOP))
    return rotated


# Normal numbers: the ziggurat of NumPy -----------------------------------------------------------------------------

_LAYER, _SIGNED_LAYER, _PLACE = np.uint64(0xFF), np.uint64(0x1FF), np.uint64(0x000FFFFFFFFFFFFF)
_EIGHT, _NINE, _ELEVEN = np.uint64(8), np.uint64(9), np.uint64(11)
_UNIT = 1.0 / float(1 << 53)

if ZIGGURAT is not None:
    _HEIGHTS, _INSIDE = ZIGGURAT.fi_double, ZIGGURAT.ki_double
    _SIGNED = np.concatenate((ZIGGURAT.wi_double, -ZIGGURAT.wi_double))
    _TAIL: float
    _TAIL_SCALE: float
    _TAIL, _TAIL_SCALE = ZIGGURAT.ziggurat_nor_r, ZIGGURAT.ziggurat_nor_inv_r


@compiled
def draw_all(deviations: Floats, out: Floats, columns: NDArray[np.int64], states: Words) -> None:
    """Write the next numbers of each stream, times its standard deviation, into its column (ticks, ...)."""
    for tick in range(len(out)):
        for stream in range(len(columns)):
            bits = _next(states, stream)
            place = (bits >> _NINE) & _PLACE
            number = place * _SIGNED[bits & _SIGNED_LAYER]
            if place >= _INSIDE[bits & _LAYER]:  # one in a hundred
                number = _beyond(states, stream, bits, number)
            out[tick, columns[stream]] = deviations[stream] * number


@compiled
def _beyond(states: Words, stream: int, bits: np.uint64, number: float) -> float:
    """Return a number that begins with bits in which it is not certainly below the curve."""
    while True:
        layer, place = bits & _LAYER, (bits >> _NINE) & _PLACE
        if place < _INSIDE[layer]:
            return number
        if layer == _ZERO:
            while True:
                across = -_TAIL_SCALE * math.log1p(-_part_of_one(states, stream))
                up = -math.log1p(-_part_of_one(states, stream))
                if up + up > across * across:
                    return -(_TAIL + across) if (place >> _EIGHT) & _ONE else _TAIL + across
        height = (_HEIGHTS[layer - _ONE] - _HEIGHTS[layer]) * _part_of_one(states, stream) + _HEIGHTS[layer]
        if height < math.exp(-0.5 * number * number):
            return number
        bits = _next(states, stream)
        number = ((bits >> _NINE) & _PLACE) * _SIGNED[bits & _SIGNED_LAYER]


@part
def _part_of_one(states: Words, stream: int) -> float:
    return float(_next(states, stream) >> _ELEVEN) * _UNIT
