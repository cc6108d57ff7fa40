"""The crews there are: processes of this machine, those of an executor or of a cluster, and this process itself."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager

from cosim.studies.cluster import of_scheduler
from cosim.studies.crew import Crew, Done, elsewhere
from cosim.studies.task import Task, close_all, rows_of
from cosim.studies.worker_process import Processes


def crew_of(
    workers: int | None = None, executor: Executor | None = None, scheduler: str | None = None
) -> AbstractContextManager[Crew]:
    """Return who makes the runs, as long as the block lasts.

    Parameters
    ----------
    workers
        How many runs are made at a time; without it, one a processor. 0: this process makes them.
    executor
        An executor of `concurrent.futures`, in place of processes of this machine.
    scheduler
        The address of a scheduler of Dask, likewise.
    """
    if scheduler is not None:
        return of_scheduler(scheduler, workers)
    if executor is not None:
        size = workers or getattr(executor, "_max_workers", None) or usual_workers()
        return _of_executor(executor, size)
    return _here() if workers == 0 else _of_processes(workers or usual_workers())


def usual_workers() -> int:
    """Return how many processes there are without a choice: as many as processors that this one may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _of_processes(count: int) -> Iterator[Crew]:
    with processes(count) as (threads, own):
        yield Crew(lambda task: threads.submit(own.make, task), lambda: count)


@contextmanager
def processes(count: int) -> Iterator[tuple[ThreadPoolExecutor, Processes]]:
    """Return processes of this machine, and as many threads that wait for them; at the end of the block all end."""
    own = Processes()
    threads = ThreadPoolExecutor(count, "formation-study")
    try:
        yield threads, own
    finally:
        threads.shutdown(wait=False, cancel_futures=True)
        own.close()
        threads.shutdown()


@contextmanager
def _of_executor(executor: Executor, size: int) -> Iterator[Crew]:
    yield elsewhere(executor, lambda: size)


@contextmanager
def _here() -> Iterator[Crew]:
    def submit(task: Task) -> Future[Done]:
        future: Future[Done] = Future()
        began = time.perf_counter()
        rows = list(rows_of(task))
        future.set_result((rows, time.perf_counter() - began))
        return future

    try:
        yield Crew(submit, lambda: 1)
    finally:
        close_all()  # the plants of the last runs are in this process
