"""From the text of a scenario file to a checked XML tree in which every element knows its place.

The text is parsed with expat, which reports line and column of each element and lets a document type
declaration be refused at its first character: no entity is ever declared, so none is expanded and nothing
outside the file is read. The tree is lxml's, which checks it against the schema (XSD 1.0) and answers XPath.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from xml.parsers import expat

from lxml import etree

from cosim.changes import Change
from cosim.errors import InputError, Location, nearest

NAMESPACE = "urn:formation-cosim:scenario:1"
MAX_BYTES = 4 * 1024 * 1024
MAX_DEPTH = 50

_XS = "{http://www.w3.org/2001/XMLSchema}"


@dataclass(frozen=True)
class Document:
    """A scenario document that satisfies the schema.

    Attributes
    ----------
    path : Path
        The file that it was read from.
    text : str
        The resolved text: what was read, with every change.
    root : lxml.etree._Element
        The tree; tags carry the namespace.
    """

    path: Path
    text: str
    root: etree._Element
    _places: dict[etree._Element, Location]

    def where(self, element: etree._Element) -> Location:
        """Return the place of an element in its file."""
        return self._places[element]


def read_document(path: Path, changes: Sequence[Change] = ()) -> Document:
    """Read a scenario file, change it as asked, and check it against the schema.

    White space around and within the values of attributes is collapsed, as the schema reads it.

    Raises
    ------
    InputError
        The file cannot be read, is not XML, declares a document type, breaks the schema, or a change does not apply;
        with file, line and column.
    """
    data = _read_bytes(path)
    root, places = _parse(data, path)
    if root.tag != f"{{{NAMESPACE}}}scenario":
        raise InputError(
            f"the root element is {etree.QName(root).text}; expected is <scenario xmlns={NAMESPACE!r}>", places[root]
        )
    elements = list(places)
    for element in elements:
        if etree.QName(element).namespace != NAMESPACE:
            raise InputError(f"the element {element.tag} is not part of the scenario language", places[element])
    if changes:
        for element in elements:
            element.tag = local_name(element)
        try:
            for change in changes:
                change(root)
        finally:
            for element in elements:
                element.tag = f"{{{NAMESPACE}}}{element.tag}"
    for element in elements:
        for name, value in element.attrib.items():
            element.set(name, " ".join(value.split()))
    _validate(root, places, changed=bool(changes))
    text = etree.tostring(root, encoding="unicode") if changes else _decode(data, root)
    return Document(path, text, root, places)


def local_name(element: etree._Element) -> str:
    """Return an element's tag without its namespace."""
    return str(etree.QName(element).localname)


def _read_bytes(path: Path) -> bytes:
    if path.exists() and not (path.is_file() or path.is_dir()):  # a pipe or a device may never end
        raise InputError("is not a regular file", Location(str(path)))
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise InputError("there is no such file", Location(str(path))) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", Location(str(path))) from None
    if len(data) > MAX_BYTES:
        raise InputError(f"is larger than {MAX_BYTES // 1024**2} MiB, so it is no scenario file", Location(str(path)))
    return data


def _decode(data: bytes, root: etree._Element) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:  # a declared encoding other than UTF-8, which expat has understood
        return str(etree.tostring(root, encoding="unicode"))


def _parse(data: bytes, path: Path) -> tuple[etree._Element, dict[etree._Element, Location]]:
    builder = etree.TreeBuilder()
    places: dict[etree._Element, Location] = {}
    depth = 0
    parser = expat.ParserCreate(namespace_separator="}")
    parser.buffer_text = True

    def here() -> Location:
        return Location(str(path), parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)

    def qualified(name: str) -> str:
        return "{" + name if "}" in name else name

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise InputError(f"elements are nested more than {MAX_DEPTH} deep, so it is no scenario", here())
        element = builder.start(
            qualified(name),
            {qualified(key): value for key, value in attributes.items()},
            {None: NAMESPACE} if not places else None,
        )
        places[element] = here()

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(qualified(name))

    def refuse_doctype(*_: object) -> None:
        raise InputError("a scenario has no document type declaration (<!DOCTYPE ...>): remove it", here())

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    parser.CommentHandler = lambda text: builder.comment(text) if places else None
    parser.StartDoctypeDeclHandler = refuse_doctype
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        where = Location(str(path), error.lineno, error.offset + 1)
        raise InputError(f"is not well-formed XML: {expat.ErrorString(error.code)}", where) from None
    except (LookupError, UnicodeDecodeError) as error:
        raise InputError(f"declares an encoding that does not fit: {error}", here()) from None
    return builder.close(), places


# The schema -------------------------------------------------------------------------------------------------


@cache
def _schema_tree() -> etree._ElementTree:
    with resources.files("cosim").joinpath("schema/scenario-1.xsd").open("rb") as file:
        return etree.parse(file)


@cache
def _schema() -> etree.XMLSchema:
    return etree.XMLSchema(_schema_tree())


def _validate(root: etree._Element, places: dict[etree._Element, Location], *, changed: bool) -> None:
    schema = _schema()
    if schema.validate(root):
        return
    error = schema.error_log[0]
    found = root.getroottree().xpath(error.path)
    element = found[0] if isinstance(found, list) and isinstance(found[0], etree._Element) else root
    suffix = " (as changed on the command line)" if changed else ""
    raise InputError(_sentence(error.message, element) + suffix, places[element])


def _sentence(message: str, element: etree._Element) -> str:
    """Say in the terms of a scenario what libxml2 says in those of XML Schema."""
    message = message.replace(f"{{{NAMESPACE}}}", "")
    tag = local_name(element)

    if match := re.search(r"attribute '([^']+)': The attribute '[^']+' is not allowed", message):
        return f"<{tag}> has no attribute {match[1]!r}: {nearest(match[1], list(_attributes_of(tag)))}"
    if match := re.search(r"The attribute '([^']+)' is required but missing", message):
        return f"<{tag}> lacks the attribute {match[1]!r}"
    if match := re.search(r"attribute '([^']+)': (?:\[facet|'.*' is not a valid value)", message):
        return f'{match[1]}="{_shown(element.get(match[1]))}" of <{tag}> is not {_attributes_of(tag)[match[1]]}'
    if "[facet" in message:
        return f"the text {_shown(element.text or '')!r} of <{tag}> is not {_describe_type(_type_of(tag))}"
    if "This element is not expected" in message:
        expected = re.search(r"Expected is (?:one of )?\( (.*) \)", message)
        options = [f"<{name.strip()}>" for name in expected[1].split(",")] if expected else []
        parent = element.getparent()
        inside = f" in <{local_name(parent)}>" if parent is not None else ""
        return f"<{tag}> is not expected here{inside}; expected: {' or '.join(options) or 'no further element'}"
    if match := re.search(r"Missing child element\(s\)\. Expected is (?:one of )?\( (.*) \)", message):
        options = [f"<{name.strip()}>" for name in match[1].split(",")]
        return f"<{tag}> is incomplete; expected next: {' or '.join(options)}"
    if "Character content" in message:
        return f"<{tag}> must not contain text"
    return message


def _shown(value: str) -> str:
    return value if len(value) <= 80 else value[:77] + "..."


def _type_of(tag: str) -> str:
    """Return the type of an element: the schema gives all elements of a name the same, named type."""
    return str(next(e.get("type") for e in _schema_tree().iter(_XS + "element") if e.get("name") == tag))


def _attributes_of(tag: str) -> dict[str, str]:
    """Return the attributes that the schema knows for an element, with what the value of each must be."""
    name = _type_of(tag)
    complex_types = [t for t in _schema_tree().iter(_XS + "complexType") if t.get("name") == name]
    return {a.get("name"): _describe_type(a.get("type")) for t in complex_types for a in t.iterfind(_XS + "attribute")}


def _describe_type(name: str) -> str:
    """Return what a value of a simple type is, in the words of the type's documentation in the schema."""
    simple_type = next(t for t in _schema_tree().iter(_XS + "simpleType") if t.get("name") == name)
    return " ".join(simple_type.findtext(f".//{_XS}documentation").split())
