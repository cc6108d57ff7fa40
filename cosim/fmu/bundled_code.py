"""Code of an FMU that a process can hold only once: Python modules, libraries beside its binary, Java classes.

All FMUs of a process share the first `model` that Python imports and the first `libvendor.so.3` that the linker
loads, also if they bring other files of that name. The memory of this code outlasts the run.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator
from pathlib import Path

from cosim.fmu.unique_variables import unique_variable

_LANGUAGES = {
    ".py": "Python code",
    ".pyc": "Python code",
    ".pyd": "Python code",
    ".jar": "Java code",
    ".class": "Java code",
    ".jl": "Julia code",
    ".lua": "Lua code",
}
_LIBRARIES = {
    ".dll": r".+\.dll",
    ".dylib": r".+\.(dylib|so)",
    ".so": r".+\.so(\.[0-9]+)*",
}
"""Pattern of the name of a shared library, by the suffix of binaries on the system."""


def brought_code(directory: Path, platform: str, binaries: Collection[str]) -> str:
    """Return the code of an FMU that a process can hold only once, in words; empty if there is none.

    Parameters
    ----------
    directory
        Where it is unpacked.
    platform
        The folder of its binaries for this machine.
    binaries
        The names of the binaries of its interfaces.
    """
    library = re.compile("|".join(_LIBRARIES[Path(name).suffix] for name in binaries), re.IGNORECASE)
    beside = directory / "binaries" / platform
    for path in (*_files(directory / "resources"), *_files(beside), *_files(directory / "extra")):
        language = _LANGUAGES.get(path.suffix.lower())
        if language is not None:
            return f"{language} ({path.name})"
        if library.fullmatch(path.name) and not (path.parent == beside and path.name in binaries):
            return f"a library of its own ({path.name})"
    for name in binaries:
        variable = unique_variable(beside / name) if os.path.isfile(beside / name) else ""
        if variable:
            return f"variables that a process has only once ({variable})"
    return ""


def _files(folder: Path) -> Iterator[Path]:
    """Return all files in a folder, sorted by depth."""
    return iter(sorted((path for path in folder.rglob("*") if path.is_file()), key=lambda p: (len(p.parts), p)))
