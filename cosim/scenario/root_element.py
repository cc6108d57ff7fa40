"""The root element of a file, without reading more of it than its beginning."""

from __future__ import annotations

from pathlib import Path
from xml.parsers import expat

NAMESPACE = "urn:formation-cosim:scenario:1"
UNCLEAR = "?"
"""In place of the root element of a file that names the namespace, but is broken before its root is complete."""
_SNIFFED = 64 * 1024


def root_of(path: Path) -> str:
    """Return the name of a file's root element within its first 64 KiB; empty if it is none of this language.

    No entity is expanded: parsing ends at a document type declaration. Such a file, or one that is broken before its
    root element is complete, is `UNCLEAR` if it names the namespace, so that whoever reads it reports the fault.
    """
    try:
        if not path.is_file():  # a pipe may never end
            return ""
        with path.open("rb") as file:
            start = file.read(_SNIFFED)
    except OSError:
        return ""
    parser = expat.ParserCreate(namespace_separator="}")
    parser.StartElementHandler = _found
    parser.StartDoctypeDeclHandler = _found
    try:
        parser.Parse(start)
    except _Found as found:
        if found.root:
            namespace, _, name = found.root.rpartition("}")
            return name if namespace == NAMESPACE else ""
    except Exception:  # its reader reports what is wrong
        pass
    return UNCLEAR if NAMESPACE.encode() in start else ""


class _Found(Exception):
    def __init__(self, root: str) -> None:
        self.root = root
        super().__init__()


def _found(name: str, attributes: object, *_: object) -> None:
    raise _Found(name if isinstance(attributes, dict) else "")  # no attributes: a document type
