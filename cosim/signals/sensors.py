"""Sensors: from a robot's true pose to the pose that controllers get."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.scenario.scenario import Effect
from cosim.signals.effects import Delay, Schedule, tick_at
from cosim.signals.random import random_stream

_BLOCK = 512


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
        self._delay = Delay(effects, channels, step)
        self._bias = Schedule("bias", effects, channels, step, 0.0, np.add)
        self._deviation = Schedule("noise", effects, channels, step, 0.0, np.hypot)
        self._quantum = Schedule("quantisation", effects, channels, step, 0.0, np.maximum)
        self._dropouts = [
            _Dropout(seed, robot, row, own, names, step)
            for row, (robot, names, own) in enumerate(zip(robots, channels, effects, strict=True))
            if any(effect.kind == "dropout" for effect in own)
        ]
        self._streams = [
            [random_stream(seed, robot, f"pose.{name}") for name in names]
            for robot, names in zip(robots, channels, strict=True)
        ]
        self._noise = np.zeros((_BLOCK, len(robots), 4))
        self._last = np.zeros((len(robots), 4))

    def measure(self, tick: int, pose: NDArray[np.float64], out: NDArray[np.float64]) -> None:
        """Write the measured poses (N, 4) of a tick into `out`; ticks come one after the other from 0."""
        out[:] = self._delay(tick, pose, pose) if self._delay.used else pose
        if self._bias.used:
            out += self._bias.at(tick)
        if self._deviation.used:
            row = tick % _BLOCK
            if row == 0:
                for index, streams in enumerate(self._streams):
                    for component, stream in enumerate(streams):
                        self._noise[:, index, component] = stream.standard_normal(_BLOCK)
            out += self._noise[row] * self._deviation.at(tick)
        if self._quantum.used:
            quantum = self._quantum.at(tick)
            coarse = quantum > 0
            out[coarse] = np.round(out[coarse] / quantum[coarse]) * quantum[coarse]
        if self._dropouts:
            for dropout in self._dropouts:
                dropout.hold(tick, out, self._last)
            self._last[:] = out


class _Dropout:
    """The dropouts of one robot; each draws one number a tick for all of its channels."""

    def __init__(
        self, seed: int, robot: str, row: int, effects: Sequence[Effect], channels: Sequence[str], step: float
    ) -> None:
        own = [effect for effect in effects if effect.kind == "dropout"]
        self._row = row
        self._parts = [
            (
                random_stream(seed, robot, f"pose.dropout.{index}"),
                effect.amount,
                [channels.index(channel) for channel in effect.channels or channels],
                tick_at(effect.start, step),
                tick_at(effect.stop, step),
            )
            for index, effect in enumerate(own)
        ]
        self._drawn = np.ones((len(own), _BLOCK))

    def hold(self, tick: int, measured: NDArray[np.float64], last: NDArray[np.float64]) -> None:
        """Put the last values in the place of those that are lost; the first measurement is never lost."""
        if tick % _BLOCK == 0:
            for (stream, *_), drawn in zip(self._parts, self._drawn, strict=True):
                drawn[:] = stream.random(_BLOCK)
        for (_, probability, columns, start, stop), drawn in zip(self._parts, self._drawn, strict=True):
            if tick > 0 and start <= tick < stop and drawn[tick % _BLOCK] < probability:
                measured[self._row, columns] = last[self._row, columns]
