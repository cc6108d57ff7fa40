"""The control laws that are installed; the packages are searched once in a process."""

from __future__ import annotations

import sys
from functools import lru_cache

import formation_controllers as fc

from cosim.errors import InputError, nearest


def installed(name: str) -> fc.Installed:
    """Return the installed controller of a name.

    Raises
    ------
    InputError
        No installed package offers it; the message names similar ones.
    """
    known = _known(tuple(sys.path))
    if name not in known:  # the package may have been installed meanwhile
        _known.cache_clear()
        known = _known(tuple(sys.path))
    if name not in known:
        raise InputError(f"no installed package offers a controller {name!r}: {nearest(name, list(known))}")
    return known[name]


@lru_cache(maxsize=1)
def _known(path: tuple[str, ...]) -> dict[str, fc.Installed]:
    """Return all controllers that are found along a search path of Python; the search reads a file of each package."""
    return fc.installed()
