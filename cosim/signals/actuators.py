"""Actuators: from commanded torques to acting ones."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.scenario.scenario import Effect
from cosim.signals.effects import Delay, Schedule


class Actuators:
    """Delay, rate limit, saturation and loss of effectiveness of every torque of every robot, in this order.

    Parameters
    ----------
    channels, effects
        Names of the torques and effects of the actuators, of each robot.
    step
        Communication step [s].
    """

    def __init__(self, channels: Sequence[Sequence[str]], effects: Sequence[Sequence[Effect]], step: float) -> None:
        self._delay = Delay(effects, channels, step)
        self._rate = Schedule("rate", effects, channels, step, math.inf, np.minimum)
        self._limit = Schedule("saturation", effects, channels, step, math.inf, np.minimum)
        self._factor = Schedule("effectiveness", effects, channels, step, 1.0, np.multiply)
        self._step = step
        self._before = np.zeros((len(channels), 2))

    def apply(self, tick: int, command: NDArray[np.float64], out: NDArray[np.float64]) -> None:
        """Write the torques (N, 2) [N.m] that act from a tick to the next into `out`; ticks come in order from 0."""
        out[:] = self._delay(tick, command, 0.0) if self._delay.used else command
        if self._rate.used:
            most = self._rate.at(tick) * self._step
            change = _clipped(out - self._before, most)
            np.copyto(out, self._before + change, where=np.isfinite(most))
            self._before[:] = out
        if self._limit.used:
            _clipped(out, self._limit.at(tick))
        if self._factor.used:
            out *= self._factor.at(tick)


def _clipped(values: NDArray[np.float64], limit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Clip values in place to plus or minus a limit, and return them; NumPy's own function takes five times as long."""
    np.minimum(values, limit, out=values)
    return np.maximum(values, -limit, out=values)
