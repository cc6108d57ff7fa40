"""What lies between a robot's true pose and the pose that its controller is given."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_BLOCK = 512


def random_stream(seed: int, robot: str, channel: str) -> np.random.Generator:
    """Return the stream of random numbers of one channel of one robot.

    The stream depends on the seed and the two names alone: adding a robot or a sensor leaves all others as they are.
    """
    digest = hashlib.sha256(f"{robot}/{channel}".encode()).digest()
    words = np.frombuffer(digest, dtype="<u4")
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=tuple(words.tolist()))))


class PoseSensor:
    """White Gaussian noise on every pose entry of every robot.

    Parameters
    ----------
    seed, robots, channels
        Name the random streams: one for each robot and pose entry.
    deviation : sequence of float
        Standard deviation of each pose entry [m, m, rad, rad].
    """

    def __init__(self, seed: int, robots: Sequence[str], channels: Sequence[str], deviation: Sequence[float]) -> None:
        self._deviation = np.asarray(deviation, dtype=float)
        self._streams = [[random_stream(seed, robot, f"pose.{name}") for name in channels] for robot in robots]
        self._noise = np.zeros((_BLOCK, len(robots), len(channels)))

    def measure(self, tick: int, pose: NDArray[np.float64], out: NDArray[np.float64]) -> None:
        """Write the measured poses (N, 4) of a tick into `out`; ticks come one after the other from 0."""
        row = tick % _BLOCK
        if row == 0 and self._deviation.any():
            for index, streams in enumerate(self._streams):
                for component, stream in enumerate(streams):
                    self._noise[:, index, component] = stream.standard_normal(_BLOCK) * self._deviation[component]
        np.add(pose, self._noise[row], out=out)
