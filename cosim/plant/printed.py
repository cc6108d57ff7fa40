"""What FMUs in another process print: it goes through the log, line by line, and cannot control a terminal."""

from __future__ import annotations

import ctypes
import logging
import os
import secrets
import select
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TextIO, TypeVar

from cosim.errors import printable

LOG = logging.getLogger("cosim.fmu")
"""Shows its lines on standard error, unless the program that uses this package wants them elsewhere."""

LAW_LOG = logging.getLogger("cosim.controller")
"""Likewise for lines that laws in other environments print."""
LOGGED = (LOG.name, LAW_LOG.name)
"""The names of both."""
LINES = 1000
"""Lines of a process that are shown, the first ones."""
CHARACTERS = 500
"""Characters of a line that are shown, the first ones."""

_LOOK = 0.5
"""Interval [s] of the check whether anybody still wants to know."""
_LAST_MOMENT = 1.0
"""Time [s] for what a process has printed before its end; something that has escaped may hold the pipe for longer."""
_IOLBF = 1

T = TypeVar("T")


class Printed:
    """A pipe for what a process prints, and a thread that hands it on to the log, so that nobody waits for the harness.

    Legal call order: `of` once, `close` after the end of the process.

    Parameters
    ----------
    whose
        The name of the FMU, or the names.
    log
        Where the lines go.

    Attributes
    ----------
    mark : str
        For `hand_on` in the process: what it logs there is logged here again, with nothing put in front.
    """

    def __init__(self, whose: str, log: logging.Logger = LOG) -> None:
        self._whose, self._log = whose, log
        self.mark = f"\0{secrets.token_hex(16)}\0"
        self._read, self._pipe = os.pipe()
        self._give_up: float | None = None
        self._rest = b""
        self._shown = 0
        self._thread = threading.Thread(target=self._forward, daemon=True)

    def of(self, start: Callable[[int], T]) -> T:
        """Start a process with a function that gets its end of the pipe; what is printed is handed on from then on.

        Where the system starts no further thread, what is printed is lost.
        """
        try:
            self._thread.start()
        except RuntimeError:
            for end in (self._read, self._pipe):
                os.close(end)
            self._pipe = os.open(os.devnull, os.O_WRONLY)
        try:
            return start(self._pipe)
        finally:
            os.close(self._pipe)

    def close(self) -> None:
        """Hand on the rest."""
        self._give_up = time.monotonic() + _LAST_MOMENT
        if self._thread.ident is not None:  # it has started
            self._thread.join(_LAST_MOMENT + 2 * _LOOK)

    def _forward(self) -> None:
        if sys.platform != "win32":
            signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())  # they are for the main thread
            printing = select.poll()
            printing.register(self._read, select.POLLIN)
        try:
            while self._give_up is None or time.monotonic() < self._give_up:
                if sys.platform == "win32" or printing.poll(1000 * _LOOK):
                    if not (part := os.read(self._read, 65536)):
                        break
                    self._take(part)
                elif self._give_up is not None:
                    break
            if self._rest:
                self._show(self._rest)
        finally:
            os.close(self._read)

    def _take(self, part: bytes) -> None:
        *lines, rest = part.split(b"\n")
        for line in lines:
            self._show(self._rest + line)
            self._rest = b""
        self._rest = (self._rest + rest)[: 8 * CHARACTERS]

    def _show(self, line: bytes) -> None:
        line, logged, entry = line.partition(self.mark.encode())
        if logged:
            name, _, message = entry.decode(errors="replace").partition(" ")
            if name in LOGGED:
                logging.getLogger(name).warning("%s", printable(message))
            if not line:  # which the process has begun and not ended
                return
        self._shown += 1
        if self._shown > LINES + 1:
            return
        if self._shown > LINES:
            told = f"{self._whose} prints more than {LINES} lines; the others are not shown"
            self._log.warning("%s", printable(told))
            return
        text = line[: 8 * CHARACTERS].decode(errors="replace").rstrip("\r").expandtabs()
        text = text if len(text) <= CHARACTERS else f"{text[:CHARACTERS]}..."
        self._log.warning("%s", printable(f"{self._whose}: {text}").replace("\n", "?"))


def hand_on(mark: str, stream: TextIO) -> None:
    """Let everything that this process logs go to a stream, for the `Printed` of this mark in another process."""
    to = logging.StreamHandler(stream)
    to.setFormatter(logging.Formatter(f"{mark}%(name)s %(message)s"))
    for log in map(logging.getLogger, LOGGED):
        log.handlers, log.propagate = [to], False  # files of others are closed here


def line_by_line() -> None:
    """Let C code of this process print each line as it comes, so that a crash loses none."""
    if sys.platform == "win32":
        return
    library = ctypes.CDLL(None)
    with suppress(ValueError):  # it calls its standard output otherwise
        library.setvbuf(ctypes.c_void_p.in_dll(library, "stdout"), None, _IOLBF, ctypes.c_size_t(0))
