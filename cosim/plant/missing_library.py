"""The reason why a binary cannot be loaded: a missing library, which the FMU may bring or not."""

from __future__ import annotations

import os
import re
from pathlib import Path

_MISSING = (
    re.compile(r"(?P<name>[^\s:]+): cannot open shared object file"),  # Linux
    re.compile(r"Library not loaded: (?P<name>\S+)"),  # macOS
)
"""The system's messages about a library that the binary needs and that is missing."""


def why_not_loaded(reason: str, directory: str) -> str:
    """Return why a binary cannot be loaded, without the folder that the FMU is unpacked to.

    Parameters
    ----------
    reason
        The message of the system.
    directory
        The folder.
    """
    if reason.startswith(directory) and reason.endswith("No such file or directory"):
        return "it is made for another machine"  # the linker's words, though the file is there
    name = next((found["name"] for form in _MISSING if (found := form.search(reason))), "")
    if not name or name.startswith(directory):
        return reason.replace(f"{directory}{os.sep}", "")
    library = Path(name).name
    brought = sorted(path.relative_to(directory).as_posix() for path in Path(directory).rglob(library))
    if brought:
        return (
            f"it needs the library {library}, which the FMU brings as {brought[0]}, but does not look for it there: "
            "its vendor must link it with the RPATH $ORIGIN, or name that folder, unpacked, in LD_LIBRARY_PATH"
        )
    return f"it needs the library {library}, which neither the FMU brings nor this machine has: install it"
