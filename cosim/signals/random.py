"""Streams of random numbers, each named by its purpose."""

from __future__ import annotations

import hashlib
from functools import lru_cache

import numpy as np


def random_stream(seed: int, robot: str, channel: str) -> np.random.Generator:
    """Return the stream of random numbers of one channel of one robot.

    The stream depends on the seed and the two names alone: adding a robot or a sensor leaves all others as they are.
    """
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=_words(robot, channel))))


@lru_cache(4096)
def _words(robot: str, channel: str) -> tuple[int, ...]:
    digest = hashlib.sha256(f"{robot}/{channel}".encode()).digest()
    return tuple(np.frombuffer(digest, dtype="<u4").tolist())
