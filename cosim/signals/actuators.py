"""Actuators: from commanded torques and speeds to acting ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.signals.effects import Effect, Rows, in_use


class Actuators:
    """Delay, rate limit, saturation and loss of effectiveness of every command of every robot, in this order.

    Parameters
    ----------
    channels, effects
        Names of the commands and effects of the actuators, of each robot.
    step
        Communication step [s].
    """

    def __init__(self, channels: Sequence[Sequence[str]], effects: Sequence[Sequence[Effect]], step: float) -> None:
        robots = [""] * len(channels)  # no actuator draws random numbers
        self._effects = in_use(Rows(0, robots, channels, effects, step, at_rest=True))

    def apply(self, tick: int, command: NDArray[np.float64], out: NDArray[np.float64]) -> None:
        """Write the commands (N, entries) that act from a tick to the next into `out`; ticks come in order from 0."""
        out[:] = command
        for effect in self._effects:
            effect.apply(tick, out)
