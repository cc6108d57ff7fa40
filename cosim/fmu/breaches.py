"""Breaches of a schema in a large XML file: the first ones, in a time that grows with the size of the file.

libxml2 reports all breaches, and the place of each takes the longer the more elements are before it.
"""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from lxml import etree

MOST = 1000
"""Breaches that are reported of a large file."""
_LARGE = 20_000
"""Beginnings and ends of elements in a file that is large."""
_PIECE = 8192
_ROOT = "fmiModelDescription"


class Checked(NamedTuple):
    """A file that is parsed and held against a schema: its root element, and its breaches, each with its line."""

    root: etree._Element
    breaches: list[str]


def checked(path: Path, data: bytes, parser: etree.XMLParser, schema: etree.XMLSchema | None) -> Checked:
    """Parse a file, and return where it breaks a schema.

    Parameters
    ----------
    path, data
        The file, and its content.
    parser
        Makes the tree; it has the options `OPTIONS`.
    schema
        The schema, if there is one.

    Raises
    ------
    lxml.etree.XMLSyntaxError
        It is no XML.
    """
    begun, found = None, 0
    if schema is not None and data.count(b"<") > _LARGE:
        root, begun, found = _begun(data, schema)
        if root is not None:
            return Checked(root, [])
    root = etree.parse(path, parser).getroot()
    if schema is None:
        return Checked(root, [])
    many = begun is not None and found >= MOST
    part = etree.fromstring(begun, etree.XMLParser(**OPTIONS, recover=True)) if many and begun is not None else root
    schema.validate(part)
    entries = islice(schema.error_log, None if begun is None else found or None)
    return Checked(root, [f"line {entry.line}: {entry.message}" for entry in entries])


OPTIONS: dict[str, Any] = {
    "resolve_entities": False,
    "no_network": True,
    "huge_tree": True,
    "collect_ids": False,
    "remove_blank_text": True,
}
"""How descriptions are parsed."""


def _begun(data: bytes, schema: etree.XMLSchema) -> tuple[etree._Element | None, bytes, int]:
    """Return the root of a large file without breaches; else None, its beginning with some, and how many it has."""
    parser = etree.XMLPullParser(events=("end",), tag=_ROOT, schema=schema, **OPTIONS)
    found = 0
    try:
        for begin in range(0, len(data), _PIECE):
            parser.feed(data[begin : begin + _PIECE])
            found = len(parser.feed_error_log)
            if found >= MOST:
                return None, data[: begin + _PIECE], found
        if all(element.getparent() is not None for _, element in parser.read_events()):
            return None, data, found  # the root has no end, which a parser with a schema does not tell
        return parser.close(), data, 0
    except etree.XMLSyntaxError:  # or a breach of the schema, when it is closed
        return None, data, found
