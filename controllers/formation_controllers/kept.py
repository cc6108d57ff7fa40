"""Where Numba keeps compiled functions: a folder that only the user may write to, files that tell what they hold."""

from __future__ import annotations

import hashlib
import os
import pickle
import stat
import sys
import warnings
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from numba.core import caching

from formation_controllers.sources import sources_of

_NumbasFiles: Any = getattr(caching, "IndexDataCacheFile", object)
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
        stacklevel=5,
    )
    return False


def keep(dispatcher: Any, version: str) -> bool:
    """Let a function that Numba caches be kept in `Files`; return False if it must not be.

    Its folder must be `trusted`, and its module be imported from its file: nobody knows what others depend on.

    Parameters
    ----------
    dispatcher
        The function, by ``numba.njit(cache=True)``.
    version
        The version of Numba and a checksum of our sources. Those of the user are added at the first call: Numba itself
        looks at the function's own file alone, not at one from which another function was inlined.

    Raises
    ------
    AttributeError
        This Numba keeps functions otherwise.
    """
    numbas, base = dispatcher._cache._cache_file, dispatcher._cache._impl.filename_base
    module, source = dispatcher.py_func.__module__, dispatcher.py_func.__code__.co_filename
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None or os.path.abspath(file) != os.path.abspath(source):
        return False
    if not trusted(numbas._cache_path, str(Path(source).parent)):
        return False
    dispatcher._cache._cache_file = Files(numbas._cache_path, base, numbas._source_stamp, version, module)
    return True


class Files(_NumbasFiles):  # type: ignore[misc]
    """The files of a function: an index, and one file for each combination of types of its arguments.

    Numba extends the index without a lock, and before it writes the file. Two processes that compile a function for
    different types at once may choose one name for both, and one that is killed in between leaves the code of older
    sources under a new entry. Numba would call either, with wrong numbers or a crash. So a file is used only if its
    checksum is right, which covers the version, and if it holds the very types that are asked for; otherwise the
    function is compiled once more.
    """

    def __init__(self, folder: str, base: str, stamp: object, version: str, module: str) -> None:
        super().__init__(folder, base, stamp)
        self._version, self._module = version, module

    @cached_property
    def _sources(self) -> str:
        """What the code is made of, told at the first call: until then the module may import more."""
        return f"{self._version} {self._source_stamp} {sources_of(self._module)}"

    def save(self, key: object, data: object) -> None:
        """Keep what was compiled, by the types and the processor for which it was."""
        super().save(key, (key, data))

    def load(self, key: object) -> Any:
        """Return what was compiled for these types and this processor; None if it is not there."""
        kept_for, data = super().load(key) or (None, None)
        return data if kept_for == key else None

    def _load_index(self) -> dict[object, str]:
        return self._read(self._index_name) or {}

    def _save_index(self, overloads: dict[object, str]) -> None:
        self._write(self._index_name, overloads)

    def _load_data(self, name: str) -> Any:
        return self._read(name)

    def _save_data(self, name: str, data: object) -> None:
        self._write(name, data)

    def _read(self, name: str) -> Any:
        """Return what is in a file; None if it is not there, damaged or of another version, which is not unpickled."""
        try:
            content = Path(self._data_path(name)).read_bytes()
        except OSError:
            return None
        told, pickled = content[:_LENGTH], content[_LENGTH:]
        if told != self._checksum(pickled):
            return None
        try:
            return pickle.loads(pickled)
        except Exception:  # whatever a class may raise that is not in this project, for whose objects it was compiled
            return None

    def _write(self, name: str, value: object) -> None:
        pickled = self._dump(value)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(self._checksum(pickled) + pickled)

    def _checksum(self, pickled: bytes) -> bytes:
        return hashlib.sha256(self._sources.encode() + pickled).digest()


_LENGTH = hashlib.sha256().digest_size
