"""A file that one command at a time has open."""

from __future__ import annotations

import sys
from io import FileIO
from pathlib import Path

from cosim.errors import InputError


def lock(file: FileIO, path: Path, remedy: str = "wait until it ends, or give another --out") -> None:
    """Refuse a file that another process has locked; elsewhere than on POSIX nothing is locked.

    The lock is held until the file is closed, or the process ends in whatever way.

    Raises
    ------
    InputError
        Another process has it.
    """
    if sys.platform == "win32":
        return
    import fcntl

    held = False
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:  # others come from a file system without locks
        held = isinstance(error, BlockingIOError)
    if held:  # raised here, it is not taken for something that the machine lacks
        raise InputError(f"{path} is in use by another command: {remedy}")
