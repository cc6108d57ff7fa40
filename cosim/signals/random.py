"""Streams of random numbers, each named by its purpose."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_WORD = (1 << 64) - 1
_POOL = 4
"""Words of the pool of NumPy's `SeedSequence`, up to which a seed before a spawn key is filled with zeros."""


def random_stream(seed: int, robot: str, channel: str) -> np.random.Generator:
    """Return the stream of random numbers of one channel of one robot.

    The stream depends on the seed and the two names alone: adding a robot or a sensor leaves all others as they are.
    """
    # As NumPy puts seed and spawn key together, SeedSequence(seed, spawn_key=names), in half the time.
    sequence = np.random.SeedSequence(np.concatenate((words_of(seed), words_of_names(robot, channel))))
    return np.random.Generator(np.random.PCG64(sequence))


class Streams(NamedTuple):
    """The states of streams of random numbers, each (4,) words of 64 bits: two of PCG64's state, two of its increment.

    Attributes
    ----------
    names : tuple of str
        The streams' names.
    states : ndarray
        Their states (streams, 4).
    """

    names: tuple[str, ...]
    states: NDArray[np.uint64]

    @property
    def by_name(self) -> dict[str, NDArray[np.uint64]]:
        """The state of each stream, by its name."""
        return dict(zip(self.names, self.states, strict=True))


NO_STREAMS = Streams((), np.zeros((0, 4), np.uint64))


def state_of(stream: np.random.Generator) -> NDArray[np.uint64]:
    """Return the state of a stream of `random_stream`, as in `Streams`."""
    state = stream.bit_generator.state["state"]
    words = [part >> shift & _WORD for part in (state["state"], state["inc"]) for shift in (64, 0)]
    return np.array(words, dtype=np.uint64)


def go_on(stream: np.random.Generator, state: NDArray[np.uint64]) -> None:
    """Let a stream of `random_stream` go on from a state."""
    high, low, more, less = map(int, state)
    numbers = {"state": high << 64 | low, "inc": more << 64 | less}
    stream.bit_generator.state = {"bit_generator": "PCG64", "state": numbers, "has_uint32": 0, "uinteger": 0}


@lru_cache(64)
def words_of(seed: int) -> NDArray[np.uint32]:
    """Return a seed in words, the lowest first, and at least as many as NumPy's pool has."""
    size = max(-(-seed.bit_length() // 32), _POOL)
    return np.frombuffer(seed.to_bytes(4 * size, "little"), dtype="<u4").astype(np.uint32)


@lru_cache(4096)
def words_of_names(robot: str, channel: str) -> NDArray[np.uint32]:
    """Return the words that stand for the two names of a stream."""
    digest = hashlib.sha256(f"{robot}/{channel}".encode()).digest()
    return np.frombuffer(digest, dtype="<u4").astype(np.uint32)
