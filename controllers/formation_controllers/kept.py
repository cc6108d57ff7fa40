"""Where Numba keeps compiled functions: a folder from which code is loaded, so that only the user may write there."""

from __future__ import annotations

import os
import stat
import sys
import warnings
from functools import cache

_OTHERS = stat.S_IWGRP | stat.S_IWOTH


@cache
def trusted(folder: str, sources: str) -> bool:
    """Return whether compiled functions may be loaded from a folder; if not, warn once.

    Who can write to the sources needs no compiled functions to do harm. Beyond that, the folder must belong to this
    user or to the administrator, and others must not be able to write there. An empty folder of this user is new, as
    Numba has made it, and is made the user's alone.

    Parameters
    ----------
    folder
        Where the compiled functions are.
    sources
        The folder of their sources.
    """
    if sys.platform == "win32":  # the user's folders have lists of rights there
        return True
    kept, written = os.stat(folder), os.stat(sources)
    known = kept.st_uid in (os.geteuid(), 0, written.st_uid)
    if known and not kept.st_mode & ~written.st_mode & _OTHERS:
        return True
    if kept.st_uid == os.geteuid() and not os.listdir(folder):
        os.chmod(folder, 0o700)
        return True
    warnings.warn(
        f"functions are compiled at each start, because others can write to {folder}, where they would be kept:"
        " remove that folder, or choose one of your own (the environment variable NUMBA_CACHE_DIR)",
        RuntimeWarning,
        stacklevel=3,
    )
    return False
