"""Moments in which a signal must not raise: what has just been made would be lost."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals by which a user, or the end of a terminal or of a machine, stops a command."""


@contextmanager
def undisturbed() -> Iterator[None]:
    """Let signals that stop a command wait until the block has ended; then they do what they do outside of it.

    Outside of the main thread, where Python handles no signals, the block changes nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    holds = False
    handlers = {number: handler for number in SIGNALS if callable(handler := signal.getsignal(number))}

    def remember(number: int, frame: FrameType | None) -> None:
        if holds:
            came.append(number)
        else:  # while handlers are replaced
            handlers[signal.Signals(number)](number, frame)

    try:
        for number in handlers:
            signal.signal(number, remember)
        holds = True
        yield
    finally:
        holds = False
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for received in came:
            signal.raise_signal(signal.Signals(received))
