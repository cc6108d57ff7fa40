"""Ctrl-C without loss: a run ends at the end of a tick, and a file that is being written is completed."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Self

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class HeldSignals:
    """While the block lasts, SIGINT and SIGTERM do not raise but are remembered in `received`.

    An exception raised by a signal could strike anywhere, also within a callback of compiled code that swallows it.
    Outside of the main thread, where Python handles no signals, the block changes nothing.

    Parameters
    ----------
    patience
        Number of signals that are remembered. The next one raises KeyboardInterrupt, so that a user can end a block
        that hangs. None: no limit.
    """

    def __init__(self, patience: int | None = None) -> None:
        self.received = 0
        self._patience = patience
        self._previous: dict[signal.Signals, Callable[[int, FrameType | None], object] | int | None] = {}

    def __enter__(self) -> Self:
        """Hold the signals."""
        if threading.current_thread() is threading.main_thread():
            self._previous = {number: signal.signal(number, self._remember) for number in _SIGNALS}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def _remember(self, _number: int, _frame: FrameType | None) -> None:
        self.received += 1
        if self._patience is not None and self.received > self._patience:
            raise KeyboardInterrupt
