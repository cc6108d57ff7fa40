"""The tree of an XML file, in which every element knows its place.

Expat reads the file first: it refuses what is not well-formed, and a document type declaration at its first character,
so that no entity is ever declared. It tells line and column of each element. Then libxml2 builds the tree of the root
element, which takes a tenth of the time that a tree built element by element would take.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.parsers import expat

from lxml import etree

from cosim.errors import InputError, Location
from cosim.scenario.malformed_xml import reason
from cosim.scenario.white_space import NEEDLESS, collapse

NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""A character that no XML has."""
MAX_ELEMENTS = 40_000
"""A thousand followers with sensors, events and expectations of their own have a fourth of that."""
MAX_DEPTH = 50
MAX_ATTRIBUTES = 100
"""Of an element; the schema knows at most a fifth of them."""
_UTF_8 = "utf-8"
_OPTIONS: Mapping[str, Any] = {
    "encoding": _UTF_8,
    "huge_tree": True,  # names as long as expat takes them; the size of a file is bounded
    "load_dtd": False,
    "no_network": True,
    "recover": True,  # from a namespace that is no URI, which is refused later if an element is in it
    "remove_pis": True,
    "resolve_entities": False,
}


def parsed(
    data: bytes, path: Path, what: str = "scenario", most: int = 0
) -> tuple[etree._Element, dict[etree._Element, Location]]:
    """Return the root element of a file's content, and the place of each element, in their order.

    Parameters
    ----------
    data, path
        The content and its file.
    what
        What the file should be, for messages.
    most
        Upper limit for its elements; 0: that of a scenario.

    Raises
    ------
    InputError
        It is not well-formed, declares a document type, is nested too deeply, or has too many elements or attributes;
        with file, line and column.
    """
    outline = _Outline(data, str(path), what, most or MAX_ELEMENTS)
    begin, end = outline.begin, outline.end
    if outline.encoding.lower() != _UTF_8 or b"\0" in data:
        data = _transcoded(data)
        again = _Outline(data, str(path), what, most or MAX_ELEMENTS)
        begin, end = again.begin, again.end
    root = etree.fromstring(data[begin:end], etree.XMLParser(**_OPTIONS))
    elements = list(root.iter("*"))
    if len(elements) != len(outline.places):
        raise InputError("is XML that is not read here: its tree would lack elements", Location(str(path)))
    collapse(elements[index] for index in outline.untidy)
    return root, dict(zip(elements, outline.places, strict=True))


class _Outline:
    """What expat tells of a file: it is read when this is made, or refused."""

    def __init__(self, data: bytes, file: str, what: str, most: int) -> None:
        self._what, self._most = what, most
        self.places: list[Location] = []
        self.untidy: list[int] = []
        self.begin, self.end, self.encoding = 0, len(data), _UTF_8
        self._data, self._file = data, file
        self._opened: list[tuple[str, int]] = []
        self._parser = parser = expat.ParserCreate(namespace_separator="}")
        parser.StartElementHandler, parser.EndElementHandler = self._start, self._end
        parser.XmlDeclHandler = self._declared
        parser.StartDoctypeDeclHandler = self._document_type
        try:
            parser.Parse(data, True)
        except expat.ExpatError as error:
            if error.code == expat.errors.codes[expat.errors.XML_ERROR_NO_MEMORY]:
                raise MemoryError from None
            opened = [(name.rpartition("}")[2], line) for name, line in self._opened]
            why = reason(data, parser.ErrorByteIndex, error.code, opened)
            place = Location(file, error.lineno, error.offset + 1)
            raise InputError(f"is not well-formed XML: {why}", place) from None
        except (LookupError, ValueError) as error:  # of Python's codec
            why = f"declares an encoding that does not fit: {error}; save it in UTF-8 and declare that"
            raise InputError(why, self._here()) from None

    def _here(self) -> Location:
        return Location(self._file, self._parser.CurrentLineNumber, self._parser.CurrentColumnNumber + 1)

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        place = self._here()
        places, opened = self.places, self._opened
        if not places:
            self.begin = self._parser.CurrentByteIndex
        opened.append((name, place.line))
        if len(opened) > MAX_DEPTH:
            raise InputError(f"elements are nested more than {MAX_DEPTH} deep, so it is no {self._what}", place)
        if len(places) >= self._most:
            raise InputError(f"has more than {self._most} elements, so it is no {self._what}", place)
        if len(attributes) > MAX_ATTRIBUTES:
            raise InputError(f"the element has {len(attributes)} attributes; at most {MAX_ATTRIBUTES} are read", place)
        for value in attributes.values():
            if NEEDLESS.search(value):
                self.untidy.append(len(places))
                break
        places.append(place)

    def _end(self, _: str) -> None:
        self._opened.pop()
        if not self._opened:
            index = self._parser.CurrentByteIndex  # that of </root>, or after <root/>
            self.end = self._data.find(b">", index) + 1 if self._data.startswith(b"</", index) else index

    def _declared(self, _version: str, encoding: str | None, _standalone: int) -> None:
        self.encoding = encoding or _UTF_8

    def _document_type(self, *_: object) -> None:
        raise InputError(f"a {self._what} has no document type declaration (<!DOCTYPE ...>): remove it", self._here())


def _transcoded(data: bytes) -> bytes:
    """Return a well-formed document in UTF-8, without its declaration."""
    parts: list[str] = []
    parser = expat.ParserCreate()
    parser.XmlDeclHandler = lambda *_: None  # so that the next one does not get it
    parser.DefaultHandler = parts.append
    parser.Parse(data, True)
    return "".join(parts).encode()
