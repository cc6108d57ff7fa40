"""Folders for unpacked FMUs. Their path needs no encoding as a URI, because many FMUs use the URI as the path."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from plants import scratch

_PLAIN = re.compile(r"[A-Za-z0-9._~/:\\-]+" if sys.platform == "win32" else r"[A-Za-z0-9._~/-]+")
"""A path in which nothing must be percent-encoded (RFC 3986, section 2.3)."""


def plain_folder(prefix: str) -> Path:
    """Return a new folder, where possible with a path in plain ASCII, without spaces and other special characters.

    `plants.scratch.remove` removes it, and the next run if this one is killed before.

    Parameters
    ----------
    prefix
        How its name begins.
    """
    for base in _bases():
        if _PLAIN.fullmatch(base):
            with suppress(OSError):
                return scratch.make(Path(base), prefix)
    return scratch.make(Path(tempfile.gettempdir()), prefix)


def _bases() -> Iterator[str]:
    """Return folders for temporary files, the preferred one first."""
    usual = tempfile.gettempdir()
    yield usual
    if sys.platform == "win32":
        yield _short(usual)
        for name in ("LOCALAPPDATA", "PUBLIC", "ProgramData"):
            if name in os.environ:
                yield _short(os.environ[name])
    else:
        yield from ("/tmp", "/var/tmp", "/dev/shm")


def _short(path: str) -> str:
    """Return the short (8.3) path of a file on Windows; the path itself if there is none."""
    if sys.platform != "win32":
        return path
    import ctypes

    buffer = ctypes.create_unicode_buffer(1024)
    length = ctypes.windll.kernel32.GetShortPathNameW(path, buffer, len(buffer))
    return buffer.value if 0 < length < len(buffer) else path
