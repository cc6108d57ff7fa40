"""Keeps the floating-point settings of this thread from changes by an FMU."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_Environment = ctypes.c_char * 512
"""More than a ``fenv_t`` has anywhere."""


def _functions() -> tuple[Callable[..., int], Callable[..., int]] | None:
    try:
        library = ctypes.cdll.ucrtbase if sys.platform == "win32" else ctypes.CDLL(None)
        return library.fegetenv, library.fesetenv
    except (OSError, AttributeError):
        return None


_FUNCTIONS = _functions()


@contextmanager
def kept_arithmetic() -> Iterator[None]:
    """Restore the rounding mode and traps of this thread at the end of the block.

    Some libraries change that when they are loaded, such as those that are compiled for fast mathematics.
    """
    if _FUNCTIONS is None:
        yield
        return
    get, put = _FUNCTIONS
    environment = _Environment()
    get(environment)
    try:
        yield
    finally:
        put(environment)
