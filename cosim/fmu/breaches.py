"""Breaches of a schema in a large XML file: the first ones, in a time that grows with the size of the file.

libxml2 reports all breaches, and the place of each takes the longer the more elements are before it. A file of many
elements is therefore held against its schema piece by piece and without a tree. A thread of its own does so while the
file is read: libxml2 leaves the interpreter to others meanwhile.
"""

from __future__ import annotations

from itertools import islice
from threading import Event, Thread
from typing import Any, Self

from lxml import etree

MOST = 1000
"""Breaches that are reported of a large file."""
_LARGE = 20_000
"""Beginnings and ends of elements in a file that is large."""
_PIECE = 8192
"""Bytes in which breaches are counted."""
_LARGE_PIECE = 2**19
"""Bytes between which the thread waits for the interpreter: some milliseconds each time."""

OPTIONS: dict[str, Any] = {
    "resolve_entities": False,
    "no_network": True,
    "huge_tree": True,
    "collect_ids": False,
    "remove_blank_text": True,
}
"""How descriptions are parsed."""


class Breaches:
    """Breaches of a schema in a file, sought as long as the context lasts.

    Parameters
    ----------
    data
        The file's content.
    schema
        The schema, if there is one.
    """

    def __init__(self, data: bytes, schema: etree.XMLSchema | None) -> None:
        self._data = data
        self._schema = schema
        self._large = schema is not None and data.count(b"<") > _LARGE
        self._none_found = False
        self._ended = Event()
        self._thread = Thread(target=self._seek)

    def __enter__(self) -> Self:
        if self._large:
            try:
                self._thread.start()
            except RuntimeError:  # the system starts no further thread
                self._large = False
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        if self._large:
            self._thread.join()

    def of(self, root: etree._Element) -> list[str]:
        """Return the breaches of the file that has been parsed, each with its line."""
        schema = self._schema
        if schema is None:
            return []
        found = None
        if self._large:
            self._thread.join()
            if self._none_found:
                return []
            found, begun = _first(self._data, schema)
            if found >= MOST:
                root = etree.fromstring(begun, etree.XMLParser(**OPTIONS, recover=True))
        schema.validate(root)
        entries = islice(schema.error_log, found or None)
        return [f"line {entry.line}: {entry.message}" for entry in entries]

    def _seek(self) -> None:
        parser = _parser(self._schema)
        try:
            for begin in range(0, len(self._data), _LARGE_PIECE):
                parser.feed(self._data[begin : begin + _LARGE_PIECE])
                if len(parser.feed_error_log) or self._ended.is_set():
                    return
            parser.close()
        except Exception:  # whoever makes a tree of the file meets it, too
            return
        self._none_found = not len(parser.feed_error_log)


def _first(data: bytes, schema: etree.XMLSchema) -> tuple[int, bytes]:
    """Return how many of the first breaches there are, and the beginning of the file that has them."""
    parser = _parser(schema)
    found = 0
    try:
        for end in range(_PIECE, len(data) + _PIECE, _PIECE):
            parser.feed(data[end - _PIECE : end])
            found = len(parser.feed_error_log)
            if found >= MOST:
                return found, data[:end]
        parser.close()
    except etree.XMLSyntaxError:
        pass
    return found, data


def _parser(schema: etree.XMLSchema | None) -> etree.XMLParser:
    """Return a parser that makes no tree."""
    return etree.XMLParser(target=_NoTree(), schema=schema, **OPTIONS)


class _NoTree:
    def close(self) -> None:
        """Nothing is built."""
