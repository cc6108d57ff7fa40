"""Files within an FMU that others in it name: nothing outside is read, no entity is expanded, sizes are limited."""

from __future__ import annotations

import math
from pathlib import Path
from urllib.parse import unquote, urlsplit

from lxml import etree

from cosim.errors import InputError, Location
from cosim.fmu.archive import has_document_type
from cosim.fmu.package import Package

MAX_XML_BYTES = 4 * 1024**2
LONGEST = 1000
"""Characters of a sentence with words of strangers."""
_PARSER = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True, remove_pis=True)


class FmuFiles:
    """The files of an unpacked FMU, by paths relative to it.

    Parameters
    ----------
    package
        The FMU.
    """

    def __init__(self, package: Package) -> None:
        self._package = package

    def named(self, file: Path, element: etree._Element) -> Path:
        """Return the file that the attribute ``source`` of an element in another file names: a URI relative to that.

        Raises
        ------
        InputError
            It is no relative URI, points outside of the FMU, or the FMU has no such file.
        """
        source = element.get("source", "")
        try:
            parts = urlsplit(source)
        except ValueError:
            raise self.error(file, element, f"source={source!r} is no URI") from None
        if parts.scheme or parts.netloc or not parts.path:
            raise self.error(file, element, f"source={source!r} is no file in the FMU: expected a relative path")
        root = self._package.directory.resolve()
        try:
            path = (root / file.parent / unquote(parts.path)).resolve()
            if not path.is_relative_to(root):
                raise self.error(file, element, f"source={source!r} points outside of the FMU")
            if not path.is_file():
                raise self.error(file, element, f"source={source!r}: the FMU has no such file")
        except (OSError, ValueError):  # a name that no file can have
            raise self.error(file, element, f"source={source!r}: the FMU has no such file") from None
        return path.relative_to(root)

    def read(self, file: Path, most: int) -> bytes:
        """Return the content of a file.

        Raises
        ------
        InputError
            It has more bytes than `most`.
        """
        with (self._package.directory / file).open("rb") as stream:
            data = stream.read(most + 1)
        if len(data) > most:
            raise self.error(file, 0, f"is larger than {most // 1024**2} MiB")
        return data

    def xml(self, file: Path, root: str) -> etree._Element:
        """Return the root element of an XML file; its name is checked, its namespace is not.

        Raises
        ------
        InputError
            It is no such file.
        """
        data = self.read(file, MAX_XML_BYTES)
        if has_document_type(data):
            raise self.error(file, 0, "declares a document type, which is not read")
        try:
            found = etree.fromstring(data, _PARSER)
        except etree.XMLSyntaxError as error:
            raise self.error(file, error.lineno or 0, f"is not well-formed XML: {error.msg}") from None
        except (LookupError, ValueError) as error:
            raise self.error(file, 0, f"is not well-formed XML: {error}") from None
        if tag(found) != root:
            raise self.error(file, found, f"the root element is {tag(found)}; expected {root}")
        return found

    def number(self, file: Path, element: etree._Element, name: str) -> float | None:
        """Return an attribute that is a number; None if it is not there.

        Raises
        ------
        InputError
            It is no finite number.
        """
        text = element.get(name)
        number = finite(text)
        if text is not None and number is None:
            raise self.error(file, element, f"{name}={text!r} is no finite number")
        return number

    def error(self, file: Path, place: etree._Element | int, message: str) -> InputError:
        """Return an error at an element or a line of a file."""
        line = place if isinstance(place, int) else place.sourceline or 0
        return InputError(shortened(message), Location(f"{self._package.path}/{file.as_posix()}", line))


def tag(element: etree._Element) -> str:
    """Return the name of an element without its namespace."""
    return str(etree.QName(element).localname)


def shortened(text: str) -> str:
    """Return a text with at most `LONGEST` characters."""
    return text if len(text) <= LONGEST else f"{text[:LONGEST]} ..."


def finite(text: str | None) -> float | None:
    """Return a finite number; None if a text is none."""
    try:
        number = float((text or "").strip().replace("_", "?"))
    except ValueError:
        return None
    return number if math.isfinite(number) else None
