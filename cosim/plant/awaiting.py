"""Waiting for a process: for something in the pipe from it, or for its end, whichever comes first.

Something that the process has started may hold its pipe. Only Linux tells of the end of a process besides; elsewhere
the end of the pipe has to do.
"""

from __future__ import annotations

import os
import select
import sys
import time
from contextlib import suppress

_PAUSE = 0.001
"""Time [s] between two looks where a pipe cannot be waited for."""


class Awaited:
    """A process that is waited for.

    Parameters
    ----------
    process
        Its number.
    replies
        The pipe from it.

    Attributes
    ----------
    descriptor : int
        Can be read once the process has ended; -1 where there is no such thing.
    """

    def __init__(self, process: int, replies: int) -> None:
        self._replies = replies
        self.descriptor = -1
        if sys.platform == "linux":
            with suppress(OSError):
                self.descriptor = os.pidfd_open(process)
        if sys.platform != "win32":
            self._both, self._reply = select.poll(), select.poll()
            for poll in (self._both, self._reply):
                poll.register(replies, select.POLLIN)
            if self.descriptor >= 0:
                self._both.register(self.descriptor, select.POLLIN)

    def wait(self, seconds: float) -> bool | None:
        """Wait for something in the pipe: False if the process has ended without it, None if nothing has happened.

        The end of the pipe counts as something to be read.
        """
        if sys.platform == "win32":
            return _wait_on_windows(self._replies, seconds)
        if not self._both.poll(1000 * seconds):
            return None
        return bool(self._reply.poll(0))

    def close(self) -> None:
        """Wait no more."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1


if sys.platform == "win32":
    import _winapi
    import msvcrt

    def _wait_on_windows(pipe: int, seconds: float) -> bool | None:
        until = time.monotonic() + seconds
        while True:
            try:
                if _winapi.PeekNamedPipe(msvcrt.get_osfhandle(pipe), 0)[0]:
                    return True
            except OSError:  # its end
                return True
            if time.monotonic() > until:
                return None
            time.sleep(_PAUSE)
