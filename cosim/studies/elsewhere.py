"""A task that another process has been sent, maybe of another machine: made with the same versions, or not.

Runs of another version of a package would have other numbers.
"""

from __future__ import annotations

import os
import pickle
import platform
import socket
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

from cosim.errors import InputError
from cosim.unforeseen import Lack

if TYPE_CHECKING:
    from cosim.studies.row import Row
    from cosim.studies.worker_process import Processes

LIBRARIES = ("formation-cosim", "formation-controllers", "fmpy", "numpy", "scipy", "numba")
"""The packages that a run's numbers depend on."""


def versions() -> dict[str, str]:
    """Return the versions that a run's numbers depend on: of Python, and of packages, empty for one that is missing."""
    return {"Python": ".".join(platform.python_version_tuple()[:2])} | {name: _version(name) for name in LIBRARIES}


def make(wanted: Mapping[str, str], task: bytes) -> tuple[list[Row], float]:
    """Make a task, in a process that is kept for the next one.

    Parameters
    ----------
    wanted
        The versions with which it has to be made.
    task
        The task, pickled.

    Returns
    -------
    tuple
        Its rows, and the time [s] that it took.

    Raises
    ------
    InputError
        Here are other versions.
    Lack
        The machine of this worker lacks what a run needs.
    """
    own = versions()
    for name, other in wanted.items():
        if own.get(name, "") != other:
            raise InputError(
                f"the worker on {socket.gethostname()} (process {os.getpid()}) has {_named(name, own.get(name, ''))}, "
                f"where this command has {_named(name, other)}: its runs could have other numbers"
            )
    try:
        found: tuple[list[Row], float] = _processes().make(pickle.loads(task))
    except Lack as lack:
        raise Lack(f"the worker on {socket.gethostname()}: {lack}") from None
    return found


@cache
def _processes() -> Processes:
    from cosim.studies.worker_process import Processes

    return Processes()


@cache
def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _named(name: str, its: str) -> str:
    return f"{name} {its}" if its else f"no {name}"
