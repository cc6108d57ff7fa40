"""Moments in which a signal must not raise, as what has just been made would be lost, and processes that hear none."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from types import FrameType
from typing import Any

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals by which a user, or the end of a terminal or of a machine, stops a command."""

_waiting: list[int] = []
"""Signals that wait until a block of the main thread has ended."""


def disturbed() -> bool:
    """Return whether a signal waits until a block of this thread has ended: it should take no longer than it must."""
    return bool(_waiting) and _is_main()


class Ending(ExitStack[None]):
    """A stack of what is to be done in the end, which no signal interrupts.

    It is done as well once the stack is lost: a signal may strike where a constructor has just handed it over.
    """

    def __init__(self) -> None:
        super().__init__()
        self._process = os.getpid()

    def __del__(self) -> None:
        left = getattr(self, "_exit_callbacks", True)
        if left and self._process == os.getpid() and not sys.is_finalizing():  # a process that was forked has it, too
            with suppress(Exception):
                self.close()

    def __exit__(self, *about: Any) -> None:
        """Do it all; a signal that comes does then what it does."""
        try:
            with undisturbed():
                super().__exit__(*about)
        except KeyboardInterrupt:  # of a signal that came just before the block, or in it
            with undisturbed():
                self.close()
            raise


@contextmanager
def undisturbed() -> Iterator[None]:
    """Let signals that stop a command wait until the block has ended; then they do what they do outside of it.

    Outside of the main thread, where Python handles no signals, the block changes nothing.
    """
    if not _is_main():
        yield
        return
    came: list[int] = []
    holds = False
    handlers = {number: handler for number in SIGNALS if callable(handler := signal.getsignal(number))}

    def remember(number: int, frame: FrameType | None) -> None:
        if holds:
            came.append(number)
            _waiting.append(number)
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
            _waiting.remove(received)
        for received in came:
            signal.raise_signal(signal.Signals(received))


@contextmanager
def deaf() -> Iterator[None]:
    """Start processes that ignore the signals that stop a command: this process ends them.

    Service managers and batch systems send such a signal to all processes of a command at once. A plant whose process
    ended by that would be told as one that has failed. A process that starts others itself calls `stay_deaf`.
    """
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    try:
        signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)  # what a process is started with it keeps
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def stay_deaf() -> None:
    """Let this process, which was started in `deaf`, go on to ignore the signals, but not what it starts itself."""
    if sys.platform == "win32":
        return
    for number in SIGNALS:
        signal.signal(number, _pay_no_heed)  # a program that it starts would keep SIG_IGN
        signal.siginterrupt(number, False)
    block, unblock = (partial(signal.pthread_sigmask, how, SIGNALS) for how in (signal.SIG_BLOCK, signal.SIG_UNBLOCK))

    def listen() -> None:
        for number in SIGNALS:
            signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
        unblock()

    os.register_at_fork(before=block, after_in_parent=unblock, after_in_child=listen)
    unblock()


def _pay_no_heed(number: int, frame: FrameType | None) -> None:
    pass


def _is_main() -> bool:
    return threading.current_thread() is threading.main_thread()
