"""Unloading of an FMU's library: never while a thread of the FMU runs, which would crash the process.

Such a library stays until the process ends, and is not torn down then either.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import sys
import threading
import time
from collections.abc import Callable

_PATIENCE = 0.02
"""Time [s] for which an ended thread may still be listed."""

_kept: list[object] = []


def threads() -> frozenset[int] | None:
    """Return the threads of this process that Python has not started; None if the system cannot list them."""
    if sys.platform == "linux":
        try:
            found = {int(name) for name in os.listdir("/proc/self/task")}
        except OSError:
            return None
    elif sys.platform == "win32":
        found = _threads_of_windows()
    elif sys.platform == "darwin":
        return _threads_of_macos()
    else:
        return None
    started = {
        thread.native_id
        for thread in threading.enumerate()
        if not isinstance(thread, threading._DummyThread)  # a foreign thread in which Python was called
    }
    return frozenset(found - started)


def unload(library: object, free: Callable[[], None], before: frozenset[int] | None) -> None:
    """Unload a library, unless new threads run; then keep it.

    Parameters
    ----------
    library
        Objects to keep as long as the library.
    free
        Unloads it.
    before
        `threads` before it was loaded.
    """
    patience = time.monotonic() + _PATIENCE
    while before is not None and (now := threads()) is not None:
        if now <= before:
            free()
            return
        if time.monotonic() > patience:
            break
        time.sleep(0.001)
    keep(library)


def keep(library: object) -> None:
    """Keep a library loaded to the end of the process, which then ends without the exit handlers of libraries."""
    if not _kept and sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "on_exit"):  # glibc
        atexit.register(libc.fflush, None)  # output of FMUs
        libc.on_exit(libc._exit, None)
    _kept.append(library)


if sys.platform == "darwin":

    def _threads_of_macos() -> frozenset[int] | None:
        """Return as many numbers as there are threads that Python has not started: macOS only counts them."""
        info = (ctypes.c_int32 * 24)()  # struct proc_taskinfo; pti_threadnum is at byte 84
        if ctypes.CDLL(None).proc_pidinfo(os.getpid(), 4, ctypes.c_uint64(0), info, ctypes.sizeof(info)) <= 0:
            return None
        return frozenset(range(info[21] - threading.active_count()))


if sys.platform == "win32":

    class _Entry(ctypes.Structure):
        """THREADENTRY32."""

        _fields_ = (
            ("dwSize", ctypes.c_uint32),
            ("cntUsage", ctypes.c_uint32),
            ("th32ThreadID", ctypes.c_uint32),
            ("th32OwnerProcessID", ctypes.c_uint32),
            ("tpBasePri", ctypes.c_int32),
            ("tpDeltaPri", ctypes.c_int32),
            ("dwFlags", ctypes.c_uint32),
        )

    def _threads_of_windows() -> set[int]:
        kernel = ctypes.WinDLL("kernel32")
        kernel.CreateToolhelp32Snapshot.restype = ctypes.c_void_p
        snapshot = ctypes.c_void_p(kernel.CreateToolhelp32Snapshot(4, 0))
        entry = _Entry(dwSize=ctypes.sizeof(_Entry))
        found = set()
        more = kernel.Thread32First(snapshot, ctypes.byref(entry))
        while more:
            if entry.th32OwnerProcessID == os.getpid():
                found.add(entry.th32ThreadID)
            more = kernel.Thread32Next(snapshot, ctypes.byref(entry))
        kernel.CloseHandle(snapshot)
        return found
