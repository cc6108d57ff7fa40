"""Temporary folders. What a killed process left is removed by the next one that makes a folder of the same kind.

What an interrupt of Python has kept a process from removing is removed when it ends.

A process holds a lock (flock) on each of its folders for as long as it lives, and the folder's name has its number.
Only folders of the same user are removed whose lock is free and whose process lives no more: an FMU within the process
may have closed the descriptor of the lock. Windows has no such locks; there the folders of a killed process stay.
"""

import atexit
import os
import re
import secrets
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

if sys.platform != "win32":
    import fcntl

_locks: dict[Path, tuple[int, tuple[int, int] | None]] = {}
"""The descriptor of each folder of this process, and the device and inode by which to know it again; -1 for none."""


def make(base: Path, prefix: str) -> Path:
    """Make a folder that this user alone can read; `remove` removes it.

    Parameters
    ----------
    base
        Where. Folders of killed processes with the same prefix are removed there first.
    prefix
        How its name begins.
    """
    _remove_left(base, prefix)
    while True:
        folder = base / f"{prefix}{os.getpid()}-{secrets.token_hex(4)}"
        _locks[folder] = -1, None  # before it is there: an interrupt may come at any moment
        try:
            folder.mkdir(0o700)
        except OSError as error:
            del _locks[folder]
            if isinstance(error, FileExistsError):
                continue
            raise
        try:
            descriptor = _lock(folder)
        except (BlockingIOError, FileNotFoundError):  # another process has come before the lock, and removes it
            del _locks[folder]
            continue
        except OSError:  # a file system without locks
            return folder
        if descriptor is None:
            return folder
        if folder.exists():
            _locks[folder] = descriptor, _identity(descriptor)
            return folder
        del _locks[folder]
        os.close(descriptor)


def remove(folder: Path) -> None:
    """Remove a folder of `make`, as far as that is possible; what a thread still writes into is removed at exit."""
    shutil.rmtree(folder, ignore_errors=True)
    if folder in _locks and folder.exists():
        return
    descriptor, identity = _locks.pop(folder, (-1, None))
    with suppress(OSError):  # an FMU may have closed it, and another file may have its number now
        if identity is not None and _identity(descriptor) == identity:
            os.close(descriptor)


def remembered() -> list[Path]:
    """Return the folders that this process has made and not removed."""
    return list(_locks)


@atexit.register
def _remove_at_exit() -> None:
    for made in remembered():
        if f"{os.getpid()}-" in made.name:  # and no other process has forked this one
            remove(made)


@contextmanager
def folder(base: Path, prefix: str) -> Iterator[Path]:
    """Make a folder that is removed at the end of the block; see `make`."""
    made = make(base, prefix)
    try:
        yield made
    finally:
        remove(made)


@cache
def _remove_left(base: Path, prefix: str) -> None:
    if sys.platform == "win32":
        return
    name = re.compile(re.escape(prefix) + r"(\d{1,9})-\w+")
    with suppress(OSError), os.scandir(base) as entries:
        for entry in entries:
            if (match := name.fullmatch(entry.name)) and not _lives(int(match[1])):
                with suppress(OSError):
                    _remove_if_left(Path(entry.path))


def _remove_if_left(folder: Path) -> None:
    if sys.platform == "win32" or folder.lstat().st_uid != os.geteuid():
        return
    descriptor = _lock(folder)
    try:
        shutil.rmtree(folder, ignore_errors=True)
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _lives(process: int) -> bool:
    """Return whether a process lives. An earlier one may have had this one's number: the lock tells them apart."""
    if process == os.getpid():
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass
    try:  # where there is such a file: an ended one that nobody has waited for is no longer alive
        return Path(f"/proc/{process}/stat").read_text("utf-8", "replace").rpartition(") ")[2][:1] != "Z"
    except OSError:
        return True


def _lock(folder: Path) -> int | None:
    """Lock a folder, no link to one, until its descriptor is closed; None on Windows."""
    if sys.platform == "win32":
        return None
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def _identity(descriptor: int) -> tuple[int, int]:
    status = os.fstat(descriptor)
    return status.st_dev, status.st_ino
