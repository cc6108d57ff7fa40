"""Room for OpenBLAS, which asks for its buffer again and again, for ever, where the process may take no more memory.

NumPy and SciPy each have an OpenBLAS of their own, which takes the buffer as it is loaded. So the modules that load one
are found only if there is room: otherwise their import raises `MemoryError`.
"""

from __future__ import annotations

import mmap
import sys
from collections.abc import Sequence
from types import ModuleType

_LOADING = frozenset({"numpy._core._multiarray_umath", "scipy.linalg._fblas", "scipy.special._ufuncs"})
"""The modules of which one is the first to load an OpenBLAS."""
_ROOM = 128 * 2**20
"""Bytes of the library and its buffer, of which the buffer takes 32 MiB; and some more."""


class _Room:
    """A finder that finds no module, but refuses to look for some."""

    def find_spec(self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> None:
        """Raise an error for a module that would hang."""
        if name in _LOADING:
            try:
                mmap.mmap(-1, _ROOM, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS).close()
            except OSError as error:
                raise MemoryError(f"{name} needs {_ROOM // 2**20} MiB") from error


def demand() -> None:
    """Let the import of NumPy and SciPy fail where it would hang, in this process."""
    if sys.platform != "win32":
        sys.meta_path.insert(0, _Room())
