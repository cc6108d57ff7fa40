"""One core for a thread and for processes, as long as they are faster so.

To wake up another core takes longer than most steps of a plant. To look for its answer does not, while both are free.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence

from cosim.closing import Closing
from cosim.plant.bells import core_now

TOGETHER = 0.5
"""Time [s] between two trials. In each all are let go for a while: the system can move them to a core that is free."""
TRIAL = 0.01
"""Time [s] for which it is tried whether they are faster on one core or on several."""


class OneCore(Closing):
    """Keeps the calling thread and the main threads of processes on one core, except now and then.

    It is tried again and again whether they get on faster so. Only Linux can do it; elsewhere, or if the system refuses
    it, nothing happens. At the end of the block all may work where they could before.

    Parameters
    ----------
    companions
        The numbers of the processes.
    """

    def __init__(self, companions: Sequence[int]) -> None:
        linux = sys.platform == "linux"
        self._threads = (0, *companions) if companions and linux else ()  # 0: the calling thread
        self._allowed: dict[int, set[int]] = {}  # of those that are kept together
        self._trying = False
        self._apart = 0.0  # ticks a second when they were let go
        self._since, self._until, self._tick = 0.0, 0.0, 0

    def settle(self, tick: int) -> None:
        """Bring all to the core on which this thread works, or let them go, as is due at a tick."""
        now = time.monotonic()
        if not self._threads or now < self._until:
            return
        speed = (tick - self._tick) / (now - self._since) if now > self._since else 0.0
        self._since, self._tick = now, tick
        if not self._trying:
            self._trying, self._apart, self._until = True, 0.0, now + TRIAL
            self._keep(False)
        elif not self._apart:
            self._apart, self._until = speed, now + TRIAL
            self._keep(True)
        else:
            self._trying, self._until = False, now + TOGETHER
            self._keep(speed > self._apart)

    def _keep(self, together: bool) -> None:
        if together == bool(self._allowed) or sys.platform != "linux":
            return
        if not together:
            self.close()
            return
        core = core_now()
        try:
            allowed = {thread: os.sched_getaffinity(thread) for thread in self._threads}
            if all(core in cores for cores in allowed.values()):
                self._allowed = allowed
                for thread in self._threads:
                    os.sched_setaffinity(thread, {core})
        except OSError:
            self.close()

    def close(self) -> None:
        """Let all work where they could before."""
        if sys.platform != "linux":
            return
        for thread, allowed in self._allowed.items():
            try:
                os.sched_setaffinity(thread, allowed)
            except OSError:  # the process has ended
                self._threads = ()
        self._allowed = {}
