"""The root element of a file, without reading more of it than its beginning."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO
from xml.parsers import expat

NAMESPACE = "urn:formation-cosim:scenario:1"
UNCLEAR = "?"
"""In place of the root element of a file that may be meant to be of this language; whoever reads it tells its fault."""
MAX_BYTES = 4 * 1024 * 1024
"""Upper limit for a file of this language."""
_OURS = "urn:formation-cosim:"
"""How our namespaces begin, of other versions and with typing errors, too."""
_IN_BYTES = tuple(_OURS.encode(encoding) for encoding in ("utf-8", "utf-16-le", "utf-16-be"))
_PIECE = 64 * 1024


def root_of(path: Path) -> str:
    """Return the name of a file's root element; empty if it is none of this language.

    A file is read up to its first element, and no entity is expanded. It is `UNCLEAR` if it cannot be read, has no
    element within `MAX_BYTES`, or its root element is in a namespace that only begins like ours. A file that is broken
    before its root element is complete, or declares entities, is so if it names such a namespace.
    """
    try:
        if not path.is_file():  # a pipe may never end
            return ""
        with path.open("rb") as file:
            return _root_in(file)
    except OSError:
        return UNCLEAR


def _root_in(file: BinaryIO) -> str:
    parser = expat.ParserCreate(namespace_separator="}")
    parser.StartElementHandler = _found
    parser.EntityDeclHandler = _entity
    data = bytearray()
    try:
        # Pieces grow, as the parser begins a comment that is not complete anew with each.
        while len(data) <= MAX_BYTES and (piece := file.read(max(_PIECE, len(data)))):
            data += piece
            parser.Parse(piece)
        if len(data) > MAX_BYTES:
            return UNCLEAR
        parser.Parse(b"", True)
    except _Found as found:
        namespace, _, name = found.root.rpartition("}")
        if namespace == NAMESPACE:
            return name
        return UNCLEAR if namespace.startswith(_OURS) else ""
    except OSError:
        raise
    except Exception:  # its reader reports what is wrong
        pass
    data += file.read(max(MAX_BYTES - len(data), 0))
    return UNCLEAR if any(name in data for name in _IN_BYTES) else ""


class _Found(Exception):
    def __init__(self, root: str) -> None:
        self.root = root
        super().__init__()


def _found(name: str, attributes: object) -> None:
    raise _Found(name)


def _entity(*declared: object) -> None:
    raise ValueError("entities are not expanded")
