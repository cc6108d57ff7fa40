"""White Gaussian noise that is added to pose entries, with a stream of random numbers for each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cosim.signals.effects.bias import add
from cosim.signals.effects.effect import Floats, OfEntries, Plan, Rows
from cosim.signals.effects.schedule import Schedule
from cosim.signals.normal import NormalStreams
from cosim.signals.random import Streams
from plants import arrays


class Noise(OfEntries):
    """``<noise>``."""

    element = "noise"
    order = 2
    act = staticmethod(add)

    def __init__(self, rows: Rows) -> None:
        super().__init__(rows)
        self._deviation = Schedule(self.element, rows, 0.0, arrays.hypot)
        found = [
            (row, column, robot, name)
            for row, (robot, names) in enumerate(zip(rows.robots, rows.channels, strict=True))
            for column, name in enumerate(names)
            if any(effect.kind == self.element and name in (effect.channels or names) for effect in rows.effects[row])
        ]
        self._streams = NormalStreams([(robot, f"pose.{name}") for *_, robot, name in found])
        self._columns = np.array([row * rows.width + column for row, column, *_ in found], dtype=np.int64)
        self.restart(rows)

    def restart(self, rows: Rows) -> None:
        """Begin all streams anew."""
        super().restart(rows)
        self._streams.begin(rows.seed)

    def mark(self) -> None:
        """Keep the states of the streams."""
        self._streams.mark()

    @property
    def marked(self) -> Streams:
        """The states that were kept."""
        return self._streams.marked

    def go_on(self, streams: Streams) -> None:
        """Let the streams go on from states."""
        self._streams.go_on(streams)

    def amounts(self, first: int, out: Floats) -> None:
        """Write random numbers with the standard deviations; channels without noise stay at zero."""
        for ticks, deviation in self._deviation.pieces(first, len(out)):
            self._streams.draw(deviation.ravel()[self._columns], out[ticks].reshape(-1, deviation.size), self._columns)

    def plan(self) -> Plan:
        """Return the standard deviations as levels, and the streams."""
        streams = zip(self._streams.names, self._columns.tolist(), strict=True)
        return replace(self._deviation.plan(), normal=tuple((*name, column) for name, column in streams))
