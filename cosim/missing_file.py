"""Messages about a file that is missing."""

from __future__ import annotations

import difflib
import os
from pathlib import Path
from urllib.parse import unquote

MAX_NAMES = 5000
"""Upper limit for the number of names in a folder that are compared with the missing one."""


def absent(path: Path) -> str:
    """Return the sentence that there is no such file, with the name of a similar file."""
    sentence = "there is no such file"
    text = str(path)
    before, scheme, after = text.partition("file:/")  # a path has no "//"
    if scheme and (not before or before.endswith(os.sep)):
        return f"{sentence}: write the path without file://, as in {unquote('/' + after)}"
    if os.sep == "/" and "\\" in path.name:
        return f"{sentence}: write the path with / instead of \\, as in {path.name.replace(chr(92), '/')}"
    try:
        names = os.listdir(path.parent)
    except OSError:
        if os.path.exists(path.parent) or path.parent == path:
            return sentence
        return f"{sentence}, nor a folder {path.parent}"
    alike = [name for name in names if Path(name).suffix.lower() == path.suffix.lower() or not path.suffix][:MAX_NAMES]
    same = [name for name in alike if name.casefold() == path.name.casefold() or Path(name).stem == path.name]
    close = same or difflib.get_close_matches(path.name, alike, n=1, cutoff=0.8)
    return f"{sentence}: did you mean {path.with_name(close[0])}?" if close else sentence
