"""Ctrl-C without loss: a run ends at the end of a tick, and a file that is being written is completed."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any, Self

from cosim.undisturbed import SIGNALS as SIGNALS


class HeldSignals:
    """While the block lasts, the signals that stop a command do not raise but are counted in `received`.

    An exception raised by a signal could strike anywhere: within a callback of compiled code that swallows it, or
    while a result is made or written. A block within a block begins with the signals of the outer one, and hands it
    back its own. Signals that are ignored, as SIGHUP by nohup, stay so. Outside of the main thread, where Python
    handles no signals, the block changes nothing.

    Parameters
    ----------
    supervised
        Whether another process supervises this one and ends it at a second signal, which then breaks nothing here.
    """

    def __init__(self, supervised: bool = False) -> None:
        self.received = 0
        self._supervised = supervised
        self._holds = False
        self._breaks = False
        self._outer: HeldSignals | None = None
        self._previous: dict[signal.Signals, Callable[[int, FrameType | None], Any] | int | None] = {}

    def __enter__(self) -> Self:
        """Hold the signals."""
        if threading.current_thread() is threading.main_thread():
            found = {number: signal.getsignal(number) for number in SIGNALS}
            self._previous = {number: old for number, old in found.items() if old not in (signal.SIG_IGN, None)}
            self._outer = _holder(self._previous)
            for number in self._previous:  # a signal in between is passed on, whichever handlers are in place
                signal.signal(number, self._remember)
        self._holds = True
        if self._outer is not None:
            self.received += self._outer.received
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._outer is not None:
            self._outer.received = max(self._outer.received, self.received)
        self._holds = False
        for number, handler in self._previous.items():  # likewise
            signal.signal(number, handler)

    def breakable(self, action: Callable[[], object]) -> None:
        """Call code of others, which may never return: a second signal ends it, and nothing else."""
        try:
            try:
                self._breaks = not self._supervised
                action()
            finally:
                self._breaks = False
        except KeyboardInterrupt:  # of a signal, wherever above it has struck, or of the code itself
            self.received = max(self.received, 1)

    def _remember(self, number: int, frame: FrameType | None) -> None:
        if not self._holds:
            self._pass_on(number, frame)
            return
        self.received += 1
        if self._breaks and self.received > 1:
            self._breaks = False  # no other one strikes while this one is dealt with
            raise KeyboardInterrupt

    def _pass_on(self, number: int, frame: FrameType | None) -> None:
        """Do what happens to a signal outside of the block."""
        handler = self._previous[signal.Signals(number)]
        if callable(handler):
            handler(number, frame)
        elif handler == signal.SIG_DFL:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(signal.Signals(number))


def _holder(handlers: dict[signal.Signals, Any]) -> HeldSignals | None:
    """Return the block that holds the signals already."""
    outer = (getattr(handler, "__self__", None) for handler in handlers.values())
    return next((holder for holder in outer if isinstance(holder, HeldSignals)), None)
