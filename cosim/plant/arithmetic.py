"""The floating-point arithmetic of this thread, kept from what an FMU does to it."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_SIZE = 512
"""Bytes, more than a ``fenv_t`` has anywhere."""


def _functions() -> tuple[Any, Any] | None:
    try:
        library = ctypes.cdll.ucrtbase if sys.platform == "win32" else ctypes.CDLL(None)
        return library.fegetenv, library.fesetenv
    except (OSError, AttributeError):
        return None


_FUNCTIONS = _functions()


@contextmanager
def kept_arithmetic() -> Iterator[None]:
    """Restore at the end of the block how numbers are rounded, and what is trapped, by this thread.

    Some libraries change that when they are loaded, such as those that are compiled for fast mathematics.
    """
    if _FUNCTIONS is None:
        yield
        return
    get, put = _FUNCTIONS
    environment = ctypes.create_string_buffer(_SIZE)
    get(environment)
    try:
        yield
    finally:
        put(environment)
