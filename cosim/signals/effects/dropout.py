"""Measurements that are lost, all channels at once; the one before is then held."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cosim.clock import tick_at
from cosim.compiled import compiled
from cosim.signals.effects.effect import Floats, Part, Plan, Rows
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
        self._names = tuple(f"{rows.robots[row]}/{purpose.rpartition('.')[2]}" for row, purpose, *_ in self._drawn())
        self._marked: list[NDArray[np.uint64]] = []
        self._losses = [
            (random_stream(rows.seed, rows.robots[row], purpose), probability, row, columns, start, stop)
            for row, purpose, probability, columns, start, stop in self._drawn()
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

    def _drawn(self) -> Iterator[tuple[int, str, float, list[int], int, int]]:
        """Yield row, purpose, probability, columns, first tick and the tick behind the last one of each effect."""
        rows = self.rows
        for row, (effects, names) in enumerate(zip(rows.effects, rows.channels, strict=True)):
            for index, effect in enumerate(effect for effect in effects if effect.kind == self.element):
                columns = [names.index(channel) for channel in effect.channels or names]
                start, stop = tick_at(effect.start, rows.step), tick_at(effect.stop, rows.step)
                yield row, f"pose.dropout.{int(effect.stream or index)}", effect.amount, columns, start, stop

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

    def plan(self) -> Plan:
        """Return the streams of losses."""
        rows = self.rows
        losses = tuple(
            (rows.robots[row], purpose, probability, tuple(row * rows.width + c for c in columns), start, stop)
            for row, purpose, probability, columns, start, stop in self._drawn()
        )
        return Plan((0,), np.zeros((1, len(rows.effects), rows.width)), losses=losses)
