"""Errors that nobody foresaw, in one sentence: a fault of Formation itself, or a machine that lacks something.

Every command, and every test of a scenario, turns whatever ends it into a `FormationError` here. No traceback reaches a
user: that of a fault is kept in a file.
"""

from __future__ import annotations

import errno
import mmap
import os
import platform
import sys
import tempfile
import traceback
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

from cosim.errors import FormationError, InputError, printable

LACKING = 71
"""The exit status of every error that follows from a lack of the machine."""
_LACKS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file grows beyond the largest size that is allowed",
    errno.EIO: "the disk or the device does not work",
    errno.ENOMEM: "the memory has run out",
    errno.EAGAIN: "the system starts no further process",
    errno.EMFILE: "the process may open no further file",
    errno.ENFILE: "the system opens no further file",
}
_OF_PATHS = (errno.ENAMETOOLONG, errno.ELOOP, errno.EACCES, errno.EPERM, errno.EROFS)
"""Errors of the system about a path that someone has given: nothing of ours has such a path."""
_LIBRARIES = ("formation-cosim", "formation-controllers", "fmpy", "numpy", "numba", "lxml", "h5netcdf", "xarray")
_LARGE = 2**28
"""Bytes of the largest library."""


class Fault(FormationError):
    """A fault of Formation itself, not of anything that the user gave."""

    exit_status = 70


class Lack(FormationError):
    """The machine lacks what a command needs."""

    exit_status = LACKING


def foreseen(error: BaseException, about: str = "") -> FormationError:
    """Return the error that a user sees.

    Parameters
    ----------
    error
        Whatever has ended a command or the run of a scenario.
    about
        The file whose turn it was; empty if it was no file's.
    """
    if isinstance(error, FormationError):
        return error
    during = f"{about}: " if about else ""
    if lack := lack_of(error):
        named = error.filename if isinstance(error, OSError) else None
        return Lack(f"{during}{lack} ({named or _place(error)})")
    if isinstance(error, OSError) and error.errno in _OF_PATHS and error.filename is not None:
        return InputError(f"{during}{error.filename}: {error.strerror}")
    if isinstance(error, FileNotFoundError) and not _has_working_folder():
        return InputError(f"{during}the folder in which the command was given is gone; change to another one")
    if not _has_memory():  # a library that cannot be loaded then says anything
        return Lack(f"{during}{_LACKS[errno.ENOMEM]} ({_place(error)})")
    if isinstance(error, SystemExit):
        return Fault(f"{during}code that Formation has called ended the process ({_place(error)}); {_reported(error)}")
    text = " ".join(str(error).split())
    said = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return Fault(f"{during}a fault of Formation itself, {said[:200]} ({_place(error)}); {_reported(error)}")


def status_of(error: FormationError) -> int:
    """Return the exit status that an error leads to: its kind's, unless it follows from a lack of the machine."""
    return LACKING if lack_of(error) else error.exit_status


def lack_of(error: BaseException) -> str:
    """Return what the machine lacks if an error, or one from which it follows, is of this kind; otherwise nothing."""
    for cause in _with_causes(error):
        if isinstance(cause, MemoryError):
            return _LACKS[errno.ENOMEM]
        if isinstance(cause, OSError) and cause.errno in _LACKS:
            return _LACKS[cause.errno]
        if isinstance(cause, RuntimeError) and "can't start new thread" in str(cause):
            return "the system starts no further thread"
    return ""


def _has_working_folder() -> bool:
    try:
        os.getcwd()
    except FileNotFoundError:
        return False
    return True


def _has_memory() -> bool:
    """Return whether the system would give as much memory as the largest library takes."""
    try:
        mmap.mmap(-1, _LARGE).close()
    except (OSError, MemoryError):
        return False
    return True


def _with_causes(error: BaseException) -> Iterator[BaseException]:
    seen: set[int] = set()
    following: BaseException | None = error
    while following is not None and id(following) not in seen:
        seen.add(id(following))
        yield following
        following = following.__cause__ or following.__context__


def _place(error: BaseException) -> str:
    """Return the line of code that raised an error."""
    frames = traceback.extract_tb(error.__traceback__)
    return f"{frames[-1].filename}:{frames[-1].lineno}" if frames else "at an unknown place"


def _reported(error: BaseException) -> str:
    """Keep the traceback of a fault in a file; return the end of a sentence that asks to report it."""
    path = ""
    with (
        suppress(OSError),
        tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", errors="backslashreplace", prefix="formation-fault-", suffix=".txt", delete=False
        ) as file,
    ):
        path = file.name
        file.write(_report(error))
    if not path:
        return "its traceback could not be kept; please report it, with the files that the command has read"
    return f"please report it, with {path} and the files that the command has read"


def _report(error: BaseException) -> str:
    lines = [
        "A fault of Formation. Please report it with this file and with the files that the command has read",
        "(the scenario, its bases, bindings, tables and FMUs), so that the fault can be seen again.",
        "",
        f"command   {' '.join(map(repr, sys.argv))}",
        f"system    {platform.platform()}, Python {platform.python_version()}",
    ]
    for name in _LIBRARIES:
        with suppress(PackageNotFoundError):
            lines.append(f"library   {name} {version(name)}")
    told = "".join(traceback.format_exception(error))
    return printable("\n".join([*lines, "", told]))
