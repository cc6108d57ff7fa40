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

    def run(self, ticks: Ticks) -> bool:
        """Run a segment; return whether that was possible."""
        started = time.perf_counter()
        if not ticks.some(self.ticks):
            return False
        taken = time.perf_counter() - started
        if taken < SHORTEST:
            self.ticks = min(2 * self.ticks, MOST)
        elif taken > LONGEST:
            self.ticks = max(int(self.ticks * SHORTEST / taken), 1)
        return True
