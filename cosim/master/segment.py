"""How many ticks are run at once."""

from __future__ import annotations

import time

from cosim.master.ticks import Ticks

SHORTEST, LONGEST = 0.02, 0.2
"""A segment takes about so long [s]: long enough to be fast, short enough to answer Ctrl-C and to show progress."""

MOST = 1024
"""Ticks of a segment at most: a plant may become slow within it, and one that takes fifty times as long then makes it
last a second."""


class Segment:
    """The length of the next segment, which follows from the time that the last one took."""

    def __init__(self) -> None:
        self.ticks = 8

    def run(self, ticks: Ticks, most: int = MOST) -> bool:
        """Run a segment of so many ticks at most; return whether that was possible."""
        started, count = time.perf_counter(), min(self.ticks, most)
        if not ticks.some(count):
            return False
        taken = time.perf_counter() - started
        if taken < SHORTEST and count == self.ticks:
            self.ticks = min(2 * count, MOST)
        elif taken > LONGEST:
            self.ticks = max(int(count * SHORTEST / taken), 1)
        return True
