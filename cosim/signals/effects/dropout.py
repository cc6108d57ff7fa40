"""Measurements that are lost, all channels at once; the one before is then held."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.clock import tick_at
from cosim.compiled import compiled
from cosim.signals.effects.effect import Floats, Part, Rows
from cosim.signals.random import Streams, go_on, random_stream, state_of


@compiled
def hold(tick: int, values: Floats, amount: Floats, memory: Floats) -> None:
    """Put the last values in the place of those that are lost, where the amount is not zero."""
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            if amount[i, j] != 0.0:
                values[i, j] = memory[0, i, j]
            memory[0, i, j] = values[i, j]


class Dropout(Part):
    """``<dropout>``."""

    element = "dropout"
    order = 4
    attribute = "probability"
    act = staticmethod(hold)
    remembers = 1

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self.restart(rows)

    def restart(self, rows: Rows) -> None:
        """Begin all streams anew."""
        super().restart(rows)
        own = [[effect for effect in effects if effect.kind == self.element] for effects in rows.effects]
        named = [(rows.robots[row], index) for row, each in enumerate(own) for index, _ in enumerate(each)]
        self._names = tuple(f"{robot}/{index}" for robot, index in named)
        self._marked: list[NDArray[np.uint64]] = []
        self._losses = [
            (
                random_stream(rows.seed, rows.robots[row], f"pose.dropout.{index}"),
                effect.amount,
                row,
                [rows.channels[row].index(channel) for channel in effect.channels or rows.channels[row]],
                tick_at(effect.start, rows.step),
                tick_at(effect.stop, rows.step),
            )
            for row, effects in enumerate(own)
            for index, effect in enumerate(effects)
        ]

    def mark(self) -> None:
        """Keep the states of the streams."""
        self._marked = [state_of(stream) for stream, *_ in self._losses]

    @property
    def marked(self) -> Streams:
        """The states that were kept."""
        return Streams(self._names, np.array(self._marked, dtype=np.uint64).reshape(-1, 4))

    def go_on(self, streams: Streams) -> None:
        """Let the streams go on from states."""
        states = streams.by_name
        for name, (stream, *_) in zip(self._names, self._losses, strict=True):
            if name in states:
                go_on(stream, states[name])

    def amounts(self, first: int, out: Floats) -> None:
        """Write one where a measurement is lost; each effect draws a number a tick for all of its channels.

        The first measurement is never lost.
        """
        out[:] = 0.0
        ticks = np.arange(first, first + len(out))
        for stream, probability, row, columns, start, stop in self._losses:
            lost = (stream.random(len(out)) < probability) & (ticks > 0) & (start <= ticks) & (ticks < stop)
            for column in columns:
                out[lost, row, column] = 1.0
