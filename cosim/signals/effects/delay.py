"""Values as they were some ticks ago, a number of ticks for each channel of every robot."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import EffectSource
from cosim.signals.effects.effect import Effect, EffectKind, Rows
from cosim.signals.effects.schedule import Schedule


class Delay(EffectKind):
    """``<delay>``."""

    element = "delay"
    order = 0

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self._ticks = np.round(Schedule(self.element, rows, 0.0, np.add).at(0) / rows.step).astype(int)
        self._memory = np.zeros((int(self._ticks.max(initial=0)) + 1, *self._ticks.shape))
        self._index = np.indices(self._ticks.shape)

    @classmethod
    def read(cls, written: EffectSource, channels: Mapping[str, str], times: Times) -> Iterator[Effect]:
        """Read the effect, which lasts for the whole run."""
        delay = times.steps(written, "time") * times.step
        yield Effect(cls.element, delay, written.channels, 0.0, math.inf, written.where, "s")

    @classmethod
    def check(cls, effects: Sequence[Effect], channels: Mapping[str, str], times: Times) -> None:
        """Check that the delays of a channel, which add up, are not longer than the run."""
        total = dict.fromkeys(channels, 0.0)
        for delay in effects:
            for channel in delay.channels or total:
                total[channel] = total.get(channel, 0.0) + delay.amount
            longest = max(total.values())
            if longest > times.horizon + 0.5 * times.step:
                raise InputError(
                    f"the delays of a channel add up to {longest:g} s, longer than the run of {times.horizon:g} s",
                    delay.where,
                )

    def apply(self, tick: int, values: NDArray[np.float64]) -> None:
        """Replace the present values by the values of some ticks ago."""
        size = len(self._memory)
        if tick == 0:
            self._memory[:] = 0.0 if self.rows.at_rest else values
        self._memory[tick % size] = values
        values[:] = self._memory[(tick - self._ticks) % size, *self._index]
