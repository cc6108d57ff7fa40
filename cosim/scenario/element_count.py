"""Whether a document has too many elements, told in a tenth of the time in which a tree is built of it."""

from __future__ import annotations

from contextlib import suppress
from xml.parsers import expat


def first_beyond(data: bytes, most: int, deepest: int) -> tuple[int, int] | None:
    """Return line and column of the first element that is too many.

    None does not mean that there is none: whatever is refused for something else before that element is for the reader.

    Parameters
    ----------
    data
        The document.
    most
        How many elements it may have.
    deepest
        How deep they may be nested; for a document that is nested deeper, the answer is None.
    """
    if data.count(b"<") - data.count(b"</") <= most:
        return None
    parser = expat.ParserCreate()
    count = depth = 0
    place: tuple[int, int] | None = None

    def start(*_: object) -> None:
        nonlocal count, depth, place
        count += 1
        depth += 1
        if count > most:
            place = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
        if place or depth > deepest:
            raise _Reached

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    def doctype(*_: object) -> None:
        raise _Reached

    parser.StartElementHandler, parser.EndElementHandler, parser.StartDoctypeDeclHandler = start, end, doctype
    with suppress(_Reached, expat.ExpatError, LookupError, ValueError):
        parser.Parse(data, True)
    return place


class _Reached(Exception):
    """What was looked for is reached."""
