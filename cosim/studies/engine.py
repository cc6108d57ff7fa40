"""The runs of a study on any executor of `concurrent.futures`: in chunks, each some seconds long.

A worker that ends in the middle of a chunk costs no more than the run that has ended it: the runs that were in the
works are repeated one by one, each in a process that is supervised, and the others go on as before.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import pickle
import struct
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import suppress
from pathlib import Path

from cosim.studies.plan import Run
from cosim.studies.row import Row
from cosim.studies.task import Job, Task, begin_worker, broken_row, run_task

Pending = tuple[Run, str]
"""A run, and its key."""
CHUNK = 1.5
"""Time [s] that a chunk shall take."""
_LARGEST = 500
"""Runs of a chunk, at most."""
_OFTEN = 3
"""Workers that have ended after which all runs are made in supervised processes."""


class Workers:
    """Processes that run chunks.

    Parameters
    ----------
    job
        What the tasks share.
    count
        How many processes.
    scratch
        A folder, in which each worker notes what it is about.
    executor
        Another executor, in place of processes of this machine.
    """

    def __init__(self, job: Job, count: int, scratch: Path, executor: Executor | None = None) -> None:
        self._own = job
        self._job = pickle.dumps(job)
        self._job_id = hashlib.sha256(self._job).hexdigest()
        self._count = count
        self._notes = scratch
        self._given = executor
        self._pool: Executor | None = None
        self._ended = 0
        self._each = 1  # runs of a chunk

    def run(self, ask: Callable[[int], Sequence[Pending]], take: Callable[[Sequence[Row]], bool]) -> None:
        """Make all runs that are asked for; the processes stay for the next time, unless the study ends.

        Parameters
        ----------
        ask
            Returns runs to begin next, at most as many; none if there is none until more rows have come.
        take
            Gets the rows of each chunk; returns whether the study goes on.
        """
        waiting: deque[Pending] = deque()
        suspects: deque[Pending] = deque()
        flying: dict[Future[tuple[list[Row], float]], Sequence[Pending]] = {}
        goes_on = True
        try:
            while goes_on:
                if suspects and not flying:
                    goes_on = take([self._alone(suspects.popleft())])
                    continue
                while not suspects and len(flying) < 2 * self._count:
                    chunk = [waiting.popleft() for _ in range(min(self._each, len(waiting)))] or ask(self._each)
                    if not chunk:
                        break
                    flying[self._submit(chunk)] = chunk
                if not flying:
                    break
                done, _ = wait(flying, timeout=1.0, return_when=FIRST_COMPLETED)
                for future in done:
                    chunk = flying.pop(future)
                    try:
                        rows, seconds = future.result()
                    except BrokenExecutor:
                        lost = [chunk, *flying.values()]
                        flying.clear()
                        suspects, rest = self._sorted_out([one for part in lost for one in part])
                        waiting.extendleft(reversed(rest))
                        break
                    self._each = min(max(round(CHUNK * len(rows) / max(seconds, 1e-6)), 1), _LARGEST)
                    goes_on = take(rows) and goes_on
        finally:
            if flying:
                self.close(at_once=True)

    def close(self, at_once: bool = False) -> None:
        """End the processes, in the middle of their chunks if asked for."""
        pool, self._pool = self._pool, None
        if pool is None:
            return
        if at_once and self._given is None:
            for process in list((getattr(pool, "_processes", None) or {}).values()):
                process.kill()
        pool.shutdown(wait=self._given is None, cancel_futures=True)

    def _submit(self, chunk: Sequence[Pending], alone: bool = False) -> Future[tuple[list[Row], float]]:
        if self._pool is None:
            self._pool = self._given or ProcessPoolExecutor(
                self._count, multiprocessing.get_context("spawn"), begin_worker, (str(self._notes), os.getpid())
            )
        runs, keys = zip(*chunk, strict=True)
        return self._pool.submit(run_task, Task(self._job_id, self._job, runs, keys, alone or self._ended > _OFTEN))

    def _sorted_out(self, lost: Sequence[Pending]) -> tuple[deque[Pending], list[Pending]]:
        """Return the runs that a worker was about when one ended, and the others that are lost."""
        self.close(at_once=True)
        self._ended += 1
        about = set(notes_in(self._notes))
        suspects = deque(one for one in lost if one[0].number in about)
        return suspects or deque(lost), [one for one in lost if one[0].number not in about] if suspects else []

    def _alone(self, one: Pending) -> Row:
        """Make one run, which may end its worker."""
        run, key = one
        try:
            rows, _ = self._submit([one], alone=True).result()
            return rows[0]
        except BrokenExecutor:
            self.close(at_once=True)
            self._ended += 1
            why = "the process of this run has ended without a word"
            return broken_row(self._own, run, key, why)


def notes_in(folder: Path) -> list[int]:
    """Return the numbers of the runs that workers were about, and remove their notes."""
    found = []
    for file in folder.glob("about-*"):
        with suppress(OSError, struct.error):
            found.append(struct.unpack("<q", file.read_bytes())[0])
            file.unlink()
    return [number for number in found if number]
