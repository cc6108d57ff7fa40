"""Where Numba keeps compiled functions: a folder that only the user may write to, files that tell what they hold."""

from __future__ import annotations

import hashlib
import os
import pickle
import stat
import sys
import warnings
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core import caching

from formation_controllers.dependencies import checksum, of_function, of_types, remember, steady

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


@dataclass(frozen=True)
class Sources:
    """Sources of a package's own: the code of their functions depends on them, and on nothing else that may change.

    Attributes
    ----------
    files
        Their paths.
    checksum
        Of their content.
    """

    files: frozenset[str]
    checksum: str


def sources(files: Iterable[Path]) -> Sources:
    """Read sources; raises OSError."""
    paths = sorted(file for file in files if file.is_file())  # an editor may have links to nowhere beside them
    content = b"\0".join(file.read_bytes() for file in paths)
    return Sources(frozenset(map(str, paths)), hashlib.sha256(content).hexdigest())


def kept(function: Any, own: Sources, **options: Any) -> Any:
    """Compile a function with Numba, and keep its code in `Files` if its folder is `trusted`.

    Parameters
    ----------
    function
        The function.
    own
        Sources that are known by their checksum. What a function from elsewhere depends on is told at each start.
    **options
        Of ``numba.njit``.
    """
    try:
        dispatcher: Any = numba.njit(cache=True, **options)(function)
        numbas, base = dispatcher._cache._cache_file, dispatcher._cache._impl.filename_base
        if trusted(numbas._cache_path, str(Path(function.__code__.co_filename).parent)):
            dispatcher._cache._cache_file = Files(numbas._cache_path, base, dispatcher, own)
            # Numba's own key has a checksum of the closure, which must then be something that can be pickled.
            dispatcher._cache._index_key = lambda types, processor: (types, processor.magic_tuple())
            dispatcher._cache._impl.check_cachable = _quietly(dispatcher._cache._impl.check_cachable)
            return dispatcher
    except (RuntimeError, AttributeError, OSError):  # nowhere to keep it, or a Numba that keeps it otherwise
        pass
    return numba.njit(**options)(function)


def _quietly(check: Callable[[Any], bool]) -> Callable[[Any], bool]:
    """Return a check that does not warn of code that must not be kept: it is compiled, and that is all."""

    def checked(code: Any) -> bool:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return check(code)

    return checked


class Files(_NumbasFiles):  # type: ignore[misc]
    """The files of a function: an index, and one file for each combination of types of its arguments.

    Numba extends the index without a lock, and before it writes the file. Two processes that compile a function for
    different types at once may choose one name for both, and one that is killed in between leaves the code of older
    sources under a new entry. Numba would call either, with wrong numbers or a crash. So a file is used only if its
    checksum is right, which covers the versions, and if it says that it is for just the text, the constants and the
    types that are asked for; otherwise the function is compiled once more.
    """

    def __init__(self, folder: str, base: str, function: Any, own: Sources) -> None:
        super().__init__(folder, base, None)
        self._function, self._own = function, own
        self._versions = f"{numba.__version__} {llvmlite.__version__} {np.__version__} {_HERE} {own.checksum}".encode()
        self._asked: dict[object, str] = {}

    def load(self, key: Any) -> Any:
        """Return what was compiled for these types and this processor; None if it is not there."""
        types, own = key[0], self._own.files
        self._asked.pop(key, None)
        try:
            known = remember(self._function, own)
            entry = self._entry(key)
            kept_for, data = super().load(entry) or (None, None)
            if kept_for == (entry, types):
                return data
            if kept_for is not None:
                self._log("kept for classes that other processes do not have")
            if known and steady(self._function, own):
                self._asked[key] = entry
            else:
                self._log("a constant has changed, or a function that it calls was compiled before")
        except Exception as error:  # `Unknown`, or whatever an object of the user may raise when it is looked at
            self._log(error)
        return None

    def save(self, key: Any, data: object) -> None:
        """Keep what was compiled, if there is room for it and no constant has changed while it was compiled."""
        entry = self._asked.pop(key, None)
        with suppress(Exception):  # a full disk, an object that cannot be pickled
            if entry is not None and entry == self._entry(key):
                super().save(entry, ((entry, key[0]), data))

    def flush(self) -> None:
        """Forget what is kept, for `recompile`."""
        with suppress(OSError):
            super().flush()

    def _entry(self, key: Any) -> str:
        """Return what the code depends on; raises as `of_function`, and whatever an object of the user raises."""
        types, processor = key
        own, checks_bounds = self._own.files, numba.config.BOUNDSCHECK  # type: ignore[attr-defined]
        signature = (getattr(types, "return_type", None), *getattr(types, "args", types))
        parts = of_function(self._function, own), of_types(signature, own), str(checks_bounds), str(processor)
        return checksum(parts)

    def _log(self, reason: object) -> None:
        """Say why a function is not kept, where Numba says what it keeps."""
        if log := getattr(caching, "_cache_log", None):
            log("[cache] %r is not kept: %s", self._function, reason)

    # What Numba calls for an index and for a file

    def _load_index(self) -> dict[str, str]:
        return self._read(self._index_name) or {}

    def _save_index(self, overloads: dict[str, str]) -> None:
        newest = list(overloads.items())[-_ENTRIES:]
        self._write(self._index_name, dict(newest))

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
        stored, pickled = content[:_LENGTH], content[_LENGTH:]
        if stored != self._checksum(pickled):
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
        return hashlib.sha256(self._versions + pickled).digest()


_LENGTH = hashlib.sha256().digest_size
_ENTRIES = 1000
"""Most that is kept of a function: for other types, other constants, other texts. The oldest goes first."""
_HERE = sources([Path(__file__), Path(__file__).with_name("dependencies.py")]).checksum
"""What describes that on which code depends: with another description, nothing that was kept is found."""
