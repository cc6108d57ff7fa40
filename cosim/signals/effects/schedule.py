"""The amount of a kind of effect on every channel, which changes at a few ticks."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator

import numpy as np

from cosim.clock import tick_at
from cosim.compiled import part
from cosim.signals.effects.effect import Floats, Plan, Rows


class Schedule:
    """The amount of one kind of effect on every channel of every robot, tick by tick.

    Parameters
    ----------
    kind
        The kind of effect.
    rows
        The robots.
    idle
        The amount where there is no effect.
    combine
        How amounts that act at the same time add up, as a function of two arrays or numbers.
    """

    def __init__(self, kind: str, rows: Rows, idle: float, combine: Callable[..., Floats]) -> None:
        self._shape = (len(rows.effects), rows.width)
        self._idle = idle
        self._combine = combine
        self._spans = [
            (
                tick_at(e.start, rows.step),
                tick_at(e.stop, rows.step),
                row,
                [names.index(c) for c in e.channels or names],
                e.amount,
            )
            for row, (own, names) in enumerate(zip(rows.effects, rows.channels, strict=True))
            for e in own
            if e.kind == kind
        ]
        self._switches = sorted({0} | {tick for start, stop, *_ in self._spans for tick in (start, stop)})
        self._amounts = [self._at(tick) for tick in self._switches]

    def _at(self, tick: int) -> Floats:
        amount = np.full(self._shape, self._idle)
        for start, stop, row, columns, own in self._spans:
            if start <= tick < stop:
                before = amount[row, columns]
                amount[row, columns] = own if (before == self._idle).all() else self._combine(before, own)
        return amount

    def fill(self, first: int, out: Floats) -> None:
        """Write the amounts (ticks, robots, channels) from a tick on."""
        for ticks, amount in self.pieces(first, len(out)):
            out[ticks] = amount

    def pieces(self, first: int, count: int) -> Iterator[tuple[slice, Floats]]:
        """Yield the amounts (robots, channels) in so many ticks from one on, with the part of these that has them."""
        piece = bisect_right(self._switches, first) - 1
        last = bisect_left(self._switches, first + count)
        ends = [*(switch - first for switch in self._switches[piece + 1 : last]), count]
        begin = 0
        for end, amount in zip(ends, self._amounts[piece:last], strict=True):
            yield slice(begin, end), amount
            begin = end

    def plan(self) -> Plan:
        """Return the amounts as levels."""
        return Plan(tuple(self._switches), np.array(self._amounts))

    @property
    def first(self) -> Floats:
        """The amounts (robots, channels) at the first tick."""
        return self._amounts[0]


@part
def clipped(value: float, limit: float) -> float:
    """Return a value clipped to plus or minus a limit."""
    if value > limit:
        return limit
    return -limit if value < -limit else value
