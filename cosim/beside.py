"""Work in a thread beside other work."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


@contextmanager
def beside(function: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> Iterator[Callable[[], T]]:
    """Call a function while the block works; yield how to wait for its result.

    Where the system starts no further thread, it is called when its result is wanted.
    """
    with ThreadPoolExecutor(1) as threads:
        try:
            result = threads.submit(function, *arguments, **named).result
        except RuntimeError:
            yield partial(function, *arguments, **named)
        else:
            yield result
