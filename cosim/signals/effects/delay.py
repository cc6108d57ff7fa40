"""Values as they were some ticks ago, a number of ticks for each channel of every robot."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from cosim.compiled import compiled
from cosim.errors import InputError
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import EffectSource
from cosim.signals.effects.effect import Effect, EffectKind, Floats, Plan, Rows
from cosim.signals.effects.schedule import Schedule


@compiled
def hold_back(tick: int, values: Floats, amount: Floats, memory: Floats) -> None:
    """Replace the present values by those of some ticks ago; before the first tick there was nothing."""
    size = len(memory)
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            memory[tick % size, i, j] = values[i, j]
            values[i, j] = memory[(tick - int(amount[i, j])) % size, i, j]


@compiled
def hold_back_from_first(tick: int, values: Floats, amount: Floats, memory: Floats) -> None:
    """Do the same, where before the first tick the values were those of the first tick."""
    if tick == 0:
        for before in range(len(memory)):
            memory[before] = values
    hold_back(tick, values, amount, memory)


class Delay(EffectKind):
    """``<delay>``."""

    element = "delay"
    order = 0

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self.act = hold_back if rows.at_rest else hold_back_from_first
        self._ticks = np.round(Schedule(self.element, rows, 0.0, np.add).first / rows.step)
        self.remembers = int(self._ticks.max(initial=0)) + 1

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
                    f"the delays of a channel add up to {longest:.12g} s, longer than the run of "
                    f"{times.horizon:.12g} s",
                    delay.where,
                )

    def amounts(self, first: int, out: Floats) -> None:
        """Write the delays in ticks."""
        out[:] = self._ticks

    def plan(self) -> Plan:
        """Return the delays in ticks, which last, as levels."""
        return Plan((0,), self._ticks[np.newaxis])
