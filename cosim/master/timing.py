"""Where the time of a run goes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def timed(parts: dict[str, float], part: str) -> Iterator[None]:
    """Add the seconds that the block takes to one of the parts."""
    started = time.perf_counter()
    try:
        yield
    finally:
        parts[part] = parts.get(part, 0.0) + time.perf_counter() - started
