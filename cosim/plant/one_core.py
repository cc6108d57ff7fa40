"""One core for a thread and for a process that never work at the same time.

To wake up another core takes longer than most steps of a plant.
"""

from __future__ import annotations

import os
import sys
import time
from types import TracebackType
from typing import Self

from cosim.plant.bells import core_now

TOGETHER = 0.5
"""Time [s] after which both are let go for a while, so that the system can move them to a core that is free."""


class OneCore:
    """Keeps the calling thread and the main thread of a process on one core, except now and then.

    Only Linux can do so; elsewhere, or if the system refuses it, nothing happens. At the end of the block both may work
    where they could before.

    Parameters
    ----------
    process
        The number of the process; None for none.
    """

    def __init__(self, process: int | None) -> None:
        self._threads = () if process is None else (0, process)  # 0: the calling thread
        self._allowed: dict[int, set[int]] = {}  # of those that are kept together
        self._until = 0.0

    def settle(self) -> None:
        """Bring both to the core on which this thread works; or let them go, if they have been together for long."""
        if sys.platform != "linux" or not self._threads:
            return
        if self._allowed:
            if time.monotonic() > self._until:
                self._let_go()
            return
        core = core_now()
        try:
            allowed = {thread: os.sched_getaffinity(thread) for thread in self._threads}
            if all(core in cores for cores in allowed.values()):
                self._allowed = allowed
                for thread in self._threads:
                    os.sched_setaffinity(thread, {core})
        except OSError:
            self._let_go()
        self._until = time.monotonic() + TOGETHER

    def _let_go(self) -> None:
        if sys.platform != "linux":
            return
        for thread, allowed in self._allowed.items():
            try:
                os.sched_setaffinity(thread, allowed)
            except OSError:  # the process has ended
                self._threads = ()
        self._allowed = {}

    def __enter__(self) -> Self:
        """Return it; nothing has happened yet."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._let_go()
