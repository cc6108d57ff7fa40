"""Segments grow while they are fast, and soon are short when they are slow."""

from itertools import count
from typing import Any

import pytest

from cosim.master.segment import LONGEST, MOST, Segment


class Fast:
    def some(self, most: int) -> bool:
        return True


def test_a_plant_that_becomes_slow_soon_gets_short_segments(monkeypatch: pytest.MonkeyPatch) -> None:
    segment, ticks = Segment(), Fast()
    run: Any = segment.run
    for _ in range(100):
        assert run(ticks)
    assert segment.ticks == MOST
    clock = count(0.0, 2 * LONGEST)
    monkeypatch.setattr("time.perf_counter", lambda: next(clock))
    for _ in range(8):
        assert run(ticks)
    assert segment.ticks == 1
