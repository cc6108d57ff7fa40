"""The end of a process with everything that it has started, wherever that has gone in the meantime.

On Linux a process may adopt what its descendants leave behind, so that all of them stay its descendants for as long as
it lives. What outlives it is known by a mark: a variable in the environment with which it has begun, or a pipe that it
holds. Elsewhere the process group alone is ended: what has left it goes on. No sandbox: a process that gets rid of its
mark, and whose ancestors end by themselves, escapes.
"""

from __future__ import annotations

import os
import secrets
import signal
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

_PR_SET_CHILD_SUBREAPER = 36
_ROUNDS = 1000
"""Upper limit for searches, one each millisecond, until nothing new is found: something may start processes as fast."""
_ORPHAN_CHECK = 1.0
"""Interval [s] of the check that the process that has started this one still runs."""
_LINUX = sys.platform == "linux"
_PROC = Path("/proc")


def new_mark() -> str:
    """Return the name of a variable for the environment of a process that is about to start, whatever its value."""
    return f"FORMATION_PROCESS_TREE_{secrets.token_hex(16)}"


def adopt() -> None:
    """Let what a descendant of this process leaves behind become this one's child, where the system can do that."""
    if not _LINUX:
        return
    import ctypes

    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def leave_terminal() -> None:
    """Let this process and what it starts have no terminal: what an FMU wrote there would look like the command's."""
    if os.name != "posix":
        return
    import fcntl
    import termios

    with suppress(OSError):
        terminal = os.open("/dev/tty", os.O_RDWR | os.O_NOCTTY)
        try:
            fcntl.ioctl(terminal, termios.TIOCNOTTY)
        finally:
            os.close(terminal)


def end(root: int, mark: str, pipe: int | None = None) -> None:
    """End a child of this process, its process group, and everything that it has started.

    The child itself remains to be waited for.

    Parameters
    ----------
    root
        The child, which has begun with `adopt` and leads a process group.
    mark
        Its mark; see `new_mark`.
    pipe
        A descriptor of a pipe of which nobody but it and what it has started hold the other end.
    """
    if os.name != "posix":
        return
    _signal(root, signal.SIGSTOP)  # it starts nothing more
    some = end_descendants(root)
    lived = _state(root) not in ("Z", "")
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(root, signal.SIGKILL)  # the group outlives its leader
    _signal(root, signal.SIGKILL)
    if some or not lived:
        end_marked(mark, pipe)


def end_descendants(root: int) -> bool:
    """End everything that a living process has started and what follows from it; return whether there was anything."""
    some, ended = False, set[int]()
    for _ in range(_ROUNDS if _LINUX else 0):
        found = _descendants(root)
        living = [process for process in found if _state(process) not in ("Z", "")]
        before, ended = ended, {*found} - {*living}
        if not living and ended <= before:  # else one that ended during the search has left behind what it had started
            break
        some = some or bool(living)
        for process in living:
            _signal(process, signal.SIGKILL)
        time.sleep(0.001)
    return some


def end_with(parent: int) -> None:
    """End this process with all that it has started when the one that has started it ends, also while it works.

    Elsewhere than on POSIX it ends only when it reads from its pipe.
    """
    if os.name == "posix":
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_ORPHAN_CHECK)
    end_descendants(os.getpid())
    os._exit(1)


def end_marked(mark: str, pipe: int | None = None) -> None:
    """End everything that has a mark, or holds a pipe; see `end`."""
    held = "" if pipe is None or not _LINUX else os.readlink(f"/proc/self/fd/{pipe}")
    for _ in range(_ROUNDS if _LINUX else 0):
        living = _marked(mark, held)
        if not living:
            break
        for process in living:
            _signal(process, signal.SIGKILL)
        time.sleep(0.001)


def _descendants(root: int) -> list[int]:
    found = [root]
    for process in found:  # which grows meanwhile
        with suppress(OSError):
            for thread in (_PROC / str(process) / "task").iterdir():
                found += [int(child) for child in (thread / "children").read_bytes().split()]
    return found[1:]


def _marked(mark: str, held: str) -> list[int]:
    """Return the living processes, but for this one, with a mark or a pipe; those of other users cannot be read."""
    sought, own = f"\0{mark}=".encode(), os.getpid()
    found = []
    for folder in _PROC.iterdir():
        if not folder.name.isdecimal() or int(folder.name) == own:
            continue
        with suppress(OSError):
            if sought in b"\0" + (folder / "environ").read_bytes() or (held and _holds(folder, held)):
                found.append(int(folder.name))
    return found


def _holds(process: Path, file: str) -> bool:
    """Return whether a process has a file open."""
    for descriptor in (process / "fd").iterdir():
        with suppress(OSError):
            if os.readlink(descriptor) == file:
                return True
    return False


def _state(process: int) -> str:
    """Return the letter of a process's state, Z if it has ended and nobody has waited for it; empty if it is gone."""
    try:
        return (_PROC / str(process) / "stat").read_text("utf-8", "replace").rpartition(") ")[2][:1]
    except OSError:
        return ""


def _signal(process: int, number: signal.Signals) -> None:
    with suppress(ProcessLookupError, PermissionError):
        os.kill(process, number)
