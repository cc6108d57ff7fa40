"""What FMUs in another process print: it goes through the log, line by line, and cannot control a terminal."""

from __future__ import annotations

import logging
import os
import select
import threading
import time

from cosim.errors import printable

LOG = logging.getLogger("cosim.fmu")
"""Shows its lines on standard error, unless the program that uses this package wants them elsewhere."""

LINES = 1000
"""Lines of a run that are shown, the first ones."""
CHARACTERS = 500
"""Characters of a line that are shown, the first ones."""

_LOOK = 0.1
"""Interval [s] of the check whether anybody still wants to know."""
_LAST_MOMENT = 1.0
"""Time [s] for what a process has printed before its end; something that has escaped may hold the pipe for longer."""


class Printed:
    """A pipe for what a process prints, and a thread that hands it on to the log, so that nobody waits for the harness.

    Legal call order: `forward` once the process has the pipe; `close` after its end.

    Parameters
    ----------
    whose
        The name of the FMU, or the names.

    Attributes
    ----------
    pipe : int
        The end for the process.
    """

    def __init__(self, whose: str) -> None:
        self._whose = whose
        self._read, self.pipe = os.pipe()
        self._give_up: float | None = None
        self._rest = b""
        self._shown = 0
        self._thread = threading.Thread(target=self._forward, daemon=True)

    def forward(self) -> None:
        """Hand on what is printed from now on."""
        os.close(self.pipe)
        self._thread.start()

    def close(self) -> None:
        """Hand on the rest."""
        self._give_up = time.monotonic() + _LAST_MOMENT
        self._thread.join()

    def _forward(self) -> None:
        printing = select.poll()
        printing.register(self._read, select.POLLIN)
        try:
            while self._give_up is None or time.monotonic() < self._give_up:
                if printing.poll(1000 * _LOOK):
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
        self._shown += 1
        if self._shown > LINES + 1:
            return
        if self._shown > LINES:
            LOG.warning("%s", printable(f"{self._whose} prints more than {LINES} lines; the others are not shown"))
            return
        text = line[: 8 * CHARACTERS].decode(errors="replace").rstrip("\r").expandtabs()
        text = text if len(text) <= CHARACTERS else f"{text[:CHARACTERS]}..."
        LOG.warning("%s", printable(f"{self._whose}: {text}").replace("\n", "?"))
