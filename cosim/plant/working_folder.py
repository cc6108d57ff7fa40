"""The working directory of the process: FMPy changes it while it loads a library, and an FMU may go where it likes.

All threads share it. So no thread looks where it is, to return there, while another one loads a library.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_changed = threading.RLock()
"""Held while the working directory is changed, or looked up to return to it."""


@contextmanager
def returning() -> Iterator[None]:
    """Return to the working directory at the end of the block, from where an FMU may have gone."""
    with _changed:
        folder = os.getcwd()
    try:
        yield
    finally:
        with _changed, suppress(OSError):  # it may be gone
            os.chdir(folder)


@contextmanager
def loading() -> Iterator[None]:
    """Let no other thread do either in the block, at the end of which the working directory is what it was."""
    with _changed, returning():
        yield


def _begin_anew() -> None:
    """Forget the threads of the process that this one was forked from."""
    global _changed
    _changed = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_anew)
