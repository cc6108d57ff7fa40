"""Sensors: from a robot's true pose to the pose that controllers get."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.signals.effects import Effect, Rows, in_use


class PoseSensor:
    """Delay, bias, white Gaussian noise, quantisation and dropout of every pose entry of every robot, in this order.

    Parameters
    ----------
    seed, robots, channels
        Name the random streams: one for each robot and pose entry, and one for each of its dropouts.
    effects
        The effects of each robot's sensor.
    step
        Communication step [s].
    """

    def __init__(
        self,
        seed: int,
        robots: Sequence[str],
        channels: Sequence[Sequence[str]],
        effects: Sequence[Sequence[Effect]],
        step: float,
    ) -> None:
        self._effects = in_use(Rows(seed, robots, channels, effects, step, at_rest=False))

    def measure(self, tick: int, pose: NDArray[np.float64], out: NDArray[np.float64]) -> None:
        """Write the measured poses (N, entries) of a tick into `out`; ticks come one after the other from 0."""
        out[:] = pose
        for effect in self._effects:
            effect.apply(tick, out)
