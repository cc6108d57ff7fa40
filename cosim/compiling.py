"""Tell that code is compiled, if that takes long: Numba is silent for many seconds at the first run on a machine."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


def patience(usual: float) -> float:
    """Return after how many seconds something is told to take long: a usual number, or FORMATION_PATIENCE."""
    try:
        return float(os.environ["FORMATION_PATIENCE"])
    except (KeyError, ValueError):
        return usual


LONG = patience(1.0)
"""Seconds of compilation after which it is told."""

_tellers: list[Callable[[], None]] = []
_started = _taken = 0.0
_depth = 0
_watched = False


@contextmanager
def told(tell: Callable[[], None]) -> Iterator[None]:
    """Call a function once within the block, when compilation has taken long."""
    _tellers.append(tell)
    try:
        yield
    finally:
        if tell in _tellers:
            _tellers.remove(tell)


def tell() -> None:
    """Tell that compilation takes long, to whoever wants to know; once."""
    while _tellers:
        _tellers.pop()()


def watch_numba() -> None:
    """Watch what Numba compiles from now on."""
    global _watched
    if _watched:
        return
    _watched = True
    from numba.core.event import Listener, register

    class Watching(Listener):
        def on_start(self, event: Any) -> None:
            _count(1)

        def on_end(self, event: Any) -> None:
            _count(-1)

    register("numba:compile", Watching())  # type: ignore[no-untyped-call]


def _count(more: int) -> None:
    """Count the functions in compilation, of which one calls for the next, and the time."""
    global _started, _taken, _depth
    now = time.monotonic()
    if _depth == 0:
        _started = now
    _depth += more
    taken = _taken + now - _started
    if _depth == 0:
        _taken = taken
    if taken > LONG:
        tell()
