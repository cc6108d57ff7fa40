"""A sine that counts from its beginning; zero outside its window."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cosim.scenario.scenario import WaveSource
from cosim.signals.waves.wave import Sampling, Wave
from plants import arrays


class Sine(Wave):
    """``<sine>``."""

    element = "sine"

    def __init__(self, written: WaveSource) -> None:
        super().__init__(written)
        self.period = written.positive("period", "s")
        self.phase = written.quantity("phase", "rad") if "phase" in written else 0.0

    def samples(self, sampling: Sampling) -> NDArray[np.float64]:
        """Return the values."""
        since = sampling.times - self.written.start
        course = np.full(len(since), self.amount(sampling))
        course *= arrays.sin(2 * math.pi / self.period * since + self.phase)
        return np.where(self.acting(sampling.times), course, 0.0)
