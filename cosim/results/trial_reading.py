"""Whether the library survives a file of netCDF: it crashes on some that are damaged, so a process tries it first."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

LIMIT = 60.0
"""Time [s] after which the process is ended."""
_FEW = 100_000
"""Numbers that are read whole; where there are more, they lie in one piece, which cannot be misread."""
_CRASHES = {
    -signal.SIGSEGV,
    -signal.SIGABRT,
    -signal.SIGFPE,
    -signal.SIGILL,
    -getattr(signal, "SIGBUS", signal.SIGSEGV),
}
"""How a process ends that crashes by itself; other signals come from outside and say nothing of the file."""


def harm_of(path: Path) -> str:
    """Return what the library does on a file that it does not survive; nothing if it does, even if it refuses it."""
    command = [sys.executable, "-P", __file__, str(path)]
    quiet = subprocess.DEVNULL
    try:
        status = subprocess.run(command, stdin=quiet, stdout=quiet, stderr=quiet, timeout=LIMIT, check=False).returncode
    except subprocess.TimeoutExpired:
        return f"reading it takes more than {LIMIT:g} s"
    except OSError:  # no process can be started: whoever reads it will tell
        return ""
    return "it is damaged so that the library which reads it crashes" if status in _CRASHES else ""


def _read(path: str) -> None:
    import h5netcdf

    with h5netcdf.File(path, "r", phony_dims="access") as file:
        dict(file.attrs)
        for variable in file.variables.values():
            dict(variable.attrs)
            if variable.dtype.kind == "O" or variable.size < _FEW:
                variable[...]


if __name__ == "__main__":
    _read(sys.argv[1])
