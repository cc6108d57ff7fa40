"""Who makes the runs of a study, and what becomes of a chunk that was given to someone."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from dataclasses import dataclass
from typing import TypeAlias

from cosim.errors import InputError
from cosim.studies.elsewhere import make, versions
from cosim.studies.row import Row
from cosim.studies.task import Task
from cosim.unforeseen import Lack

Done: TypeAlias = tuple[list[Row], float]
"""The rows of a task, and the time [s] that it took."""


@dataclass(frozen=True)
class Crew:
    """Makes tasks.

    Attributes
    ----------
    submit : callable
        Begins a task.
    size : callable
        Returns how many tasks are made at a time.
    """

    submit: Callable[[Task], Future[Done]]
    size: Callable[[], int]


def elsewhere(executor: Executor, size: Callable[[], int]) -> Crew:
    """Return a crew whose processes may be on other machines."""
    own = versions()
    return Crew(lambda task: executor.submit(make, own, pickle.dumps(task)), size)


def result(future: Future[Done]) -> Done:
    """Return what has come of a task.

    Raises
    ------
    FormationError
        A worker refuses it, or the executor has lost it.
    """
    try:
        return future.result()
    except (BrokenExecutor, CancelledError) as error:
        raise gone(error) from error
    except (ImportError, AttributeError, pickle.UnpicklingError) as error:
        raise InputError(
            f"a worker cannot read its task, so it has another version of Formation than this command, whose "
            f"formation-cosim is {versions()['formation-cosim']}, or none ({type(error).__name__}: {error})"
        ) from error


def gone(error: BaseException) -> Lack:
    """Return the error that says that an executor has ended."""
    return Lack(
        "the workers, or the scheduler that leads them, have ended in the middle of the study "
        f"({type(error).__name__}): the runs so far are kept, and the same command goes on"
    )
