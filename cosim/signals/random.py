"""Streams of random numbers, each named by its purpose."""

from __future__ import annotations

import hashlib

import numpy as np


def random_stream(seed: int, robot: str, channel: str) -> np.random.Generator:
    """Return the stream of random numbers of one channel of one robot.

    The stream depends on the seed and the two names alone: adding a robot or a sensor leaves all others as they are.
    """
    digest = hashlib.sha256(f"{robot}/{channel}".encode()).digest()
    words = np.frombuffer(digest, dtype="<u4")
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=tuple(words.tolist()))))
