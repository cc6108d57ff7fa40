"""Runs on a cluster that Dask leads: its scheduler is there already, and its workers."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, ParamSpec, TypeVar

from cosim.errors import InputError, shown
from cosim.studies.crew import Crew, elsewhere, gone

_ANSWER = 10.0
"""Time limit [s] for the scheduler's answer; one on a busy machine has taken more than five."""
_FIRST_WORKER = 10.0
"""Time limit [s] for the first worker."""
_P = ParamSpec("_P")
_T = TypeVar("_T")


@contextmanager
def of_scheduler(address: str, workers: int | None = None) -> Iterator[Crew]:
    """Make runs on the workers of a scheduler.

    Parameters
    ----------
    address
        Its address, such as ``tcp://10.0.0.1:8786``.
    workers
        How many runs are made at a time; without it, as many as its workers have threads.

    Raises
    ------
    InputError
        Dask is not installed here, the scheduler does not answer, or it has no worker.
    """
    try:
        import distributed
    except ImportError:
        raise InputError(
            "a scheduler needs the package distributed; install it: python -m pip install 'formation-cosim[cluster]'"
        ) from None
    for name in ("distributed", "distributed.client", "distributed.core"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what becomes of the study is told in sentences
    client = _client(distributed.Client, address)
    with client:
        try:
            client.wait_for_workers(1, timeout=_FIRST_WORKER)
        except TimeoutError:
            raise InputError(
                f"the scheduler at {shown(address)!r} has no worker: start some, `dask worker {shown(address)}`"
            ) from None

        crew = elsewhere(client.get_executor(pure=False), lambda: workers or max(sum(client.nthreads().values()), 1))
        yield Crew(_told(crew.submit), _told(crew.size))


def _client(connect: Any, address: str) -> Any:
    """Return a client of a scheduler; whoever listens there may be something else, which never answers."""
    found: list[Any] = []

    def begin() -> None:
        try:
            found.append(connect(address, timeout=_ANSWER, set_as_default=False, name="formation-study"))
        except (OSError, ValueError, TypeError) as error:
            found.append(error)

    thread = threading.Thread(target=begin, daemon=True)
    thread.start()
    thread.join(2 * _ANSWER)
    client = found[0] if found else TimeoutError("what listens there is no scheduler, or of another version of Dask")
    if isinstance(client, Exception):
        raise InputError(
            f"no scheduler of Dask answers at {shown(address)!r} ({_cause(client)}): "
            "`dask scheduler` prints its address, such as tcp://127.0.0.1:8786"
        ) from client
    return client


def _told(ask: Callable[_P, _T]) -> Callable[_P, _T]:
    """Return what asks the scheduler something, and says so if it is gone."""

    def asked(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        try:
            return ask(*args, **kwargs)
        except (OSError, RuntimeError) as error:
            raise gone(error) from error

    return asked


def _cause(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
