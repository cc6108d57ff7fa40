"""Breaches of a schema in a large XML file: the first ones, in a time that grows with the size of the file.

libxml2 reports all breaches, and the place of each takes the longer the more elements are before it.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

from lxml import etree

MOST = 1000
"""Breaches that are reported of a large file."""
_LARGE = 20_000
"""Beginnings and ends of elements in a file that is large."""
_PIECE = 8192


def breaches(data: bytes, root: etree._Element, schema: etree.XMLSchema) -> Iterator[str]:
    """Return where a file breaks a schema, each with its line.

    Parameters
    ----------
    data, root
        The file, and its root element.
    schema
        The schema.
    """
    checked, most = root, None
    if data.count(b"<") > _LARGE:
        begun, most = _begun(data, schema)
        if not most:
            return
        if most >= MOST:
            checked = etree.fromstring(begun, etree.XMLParser(**_OPTIONS, recover=True))
    if not schema.validate(checked):
        for entry in islice(schema.error_log, most):
            yield f"line {entry.line}: {entry.message}"


_OPTIONS = {"resolve_entities": False, "no_network": True, "huge_tree": True, "collect_ids": False}


def _begun(data: bytes, schema: etree.XMLSchema) -> tuple[bytes, int]:
    """Return the beginning of a file that has some breaches, and how many it has."""
    parser = etree.XMLPullParser(events=(), schema=schema, **_OPTIONS)
    found = 0
    for begin in range(0, len(data), _PIECE):
        parser.feed(data[begin : begin + _PIECE])
        found = len(parser.feed_error_log)
        if found >= MOST:
            return data[: begin + _PIECE], found
    return data, found
