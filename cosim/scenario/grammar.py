"""The grammar of scenario files by the schema (XSD 1.0): breaches in words, children and attributes of elements."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator
from functools import cache
from importlib import resources
from itertools import islice
from pathlib import Path

from lxml import etree

from cosim.errors import nearest
from cosim.quantity import advice, meant
from cosim.scenario.root_element import NAMESPACE as NAMESPACE

_SMALL = 2000
"""Elements of a tree in which all breaches may be found."""
_PIECE = 2048
"""Bytes that are checked at once in a larger one."""
_XS = "{http://www.w3.org/2001/XMLSchema}"


def local_name(element: etree._Element) -> str:
    """Return an element's tag without its namespace."""
    return str(element.tag).rpartition("}")[2]


def violation(root: etree._Element) -> tuple[etree._Element, str] | None:
    """Return the first element that breaks the schema, with a sentence on the breach; None if none does."""
    schema = _schema()
    begun = _up_to_a_breach(root)
    if begun is None or schema.validate(begun):
        return None
    error = schema.error_log[0]
    found = root.getroottree().xpath(error.path)
    element = found[0] if isinstance(found, list) and isinstance(found[0], etree._Element) else root
    return element, _sentence(error.message, element)


def _up_to_a_breach(root: etree._Element) -> etree._Element | None:
    """Return a tree without most of the breaches after the first one; itself if it is small, None if it has none.

    libxml2 reports all of them, and the place of each takes the longer the more elements are before it.
    """
    if root.xpath(f"count(//*) <= {_SMALL}"):
        return root
    text = etree.tostring(root)
    parser = etree.XMLPullParser(events=("start",), schema=_schema())
    kept = 0
    for begin in range(0, len(text), _PIECE):
        parser.feed(text[begin : begin + _PIECE])
        kept += sum(1 for _ in parser.read_events())
        if len(parser.feed_error_log):
            break
    else:
        return None
    copied = copy.deepcopy(root)
    last = next(islice(copied.iter("*"), kept - 1, None))
    for element in (last, *last.iterancestors()):
        for following in list(element.itersiblings()):
            following.getparent().remove(following)
    return copied


@cache
def attributes_of(tag: str) -> dict[str, str]:
    """Return the attributes that the schema knows for an element, each with the name of its type."""
    return {a.get("name"): a.get("type") for a in _attributes(_type_of(tag))}


@cache
def attributes_of_types(*types: str) -> dict[str, frozenset[str]]:
    """Return the attributes whose type has one of some names, by the element."""
    tags = {str(element.get("name")) for element in _schema_tree().iter(_XS + "element")}
    return {tag: frozenset(name for name, kind in attributes_of(tag).items() if kind in types) for tag in tags}


def paths_in(root: etree._Element) -> Iterator[tuple[etree._Element, str]]:
    """Yield each attribute in a tree that is a path: its element, and its name."""
    for element in root.iter("*"):
        for name, kind in attributes_of(local_name(element)).items():
            if kind == "path" and name in element.attrib:
                yield element, name


def named_files(root: etree._Element) -> list[str]:
    """Return the paths in a tree, but for FMUs and environments, whose checksums and versions are told elsewhere."""
    apart = ("plant", "fmu"), ("controller", "environment")
    return [element.get(name, "") for element, name in paths_in(root) if (local_name(element), name) not in apart]


@cache
def children_of(tag: str) -> dict[str, int]:
    """Return the elements that the schema knows within an element, each with its rank in their order.

    Elements between which there is a choice have the same rank.
    """
    ranks: dict[str, int] = {}
    for rank, particle in enumerate(_type_of(tag).iterfind(f"{_XS}sequence/*")):
        ranks |= {e.get("name"): rank for e in particle.iter(_XS + "element")}
    ranks |= {e.get("name"): 0 for e in _type_of(tag).iterfind(f"{_XS}choice/{_XS}element")}
    return ranks


def described_children(tag: str) -> str:
    """Return the elements that the schema knows within an element, as a message shows them."""
    return " or ".join(f"<{name}>" for name in children_of(tag)) or "no element"


# The schema -------------------------------------------------------------------------------------------------


def schema_path() -> Path:
    """Return the file of the schema, for editors to find."""
    return Path(str(resources.files("cosim").joinpath("schema/scenario-1.xsd")))


@cache
def _schema_tree() -> etree._ElementTree:
    with schema_path().open("rb") as file:
        return etree.parse(file)


@cache
def _schema() -> etree.XMLSchema:
    return etree.XMLSchema(_schema_tree())


def _type_of(tag: str) -> etree._Element:
    """Return the type of an element: the schema gives all elements of a name the same, named type.

    An element that the schema does not know, or that holds only a text, has a type without attributes and children.
    """
    name = next((e.get("type") for e in _schema_tree().iter(_XS + "element") if e.get("name") == tag), "")
    found = _named("complexType", name)
    return etree.Element(_XS + "complexType") if found is None else found


def _named(kind: str, name: str) -> etree._Element | None:
    return next((t for t in _schema_tree().iterfind(_XS + kind) if t.get("name") == name), None)


def _attributes(holder: etree._Element) -> Iterator[etree._Element]:
    yield from holder.iterfind(_XS + "attribute")
    for reference in holder.iterfind(_XS + "attributeGroup"):
        group = _named("attributeGroup", reference.get("ref", ""))
        assert group is not None
        yield from _attributes(group)


def _description_of(simple_type: str) -> str:
    """Return the documentation of a simple type, as the words for its values."""
    found = _named("simpleType", simple_type)
    return "any text" if found is None else " ".join(found.findtext(f".//{_XS}documentation", "").split())


def matches(simple_type: str, value: str) -> bool:
    """Return whether a value matches the patterns of a simple type and of its base types; false without a pattern."""
    patterns: list[list[str]] = []
    while (found := _named("simpleType", simple_type)) is not None:
        restriction = found.find(_XS + "restriction")
        assert restriction is not None
        patterns.append([pattern.get("value", "") for pattern in restriction.iterfind(_XS + "pattern")])
        simple_type = restriction.get("base", "")
    return any(patterns) and all(any(re.fullmatch(p, value) for p in own) for own in patterns if own)


# Sentences --------------------------------------------------------------------------------------------------


def _sentence(message: str, element: etree._Element) -> str:
    """Translate a message of libxml2 from the terms of XML Schema to the terms of a scenario."""
    message = message.replace(f"{{{NAMESPACE}}}", "")
    tag = local_name(element)
    attributes = attributes_of(tag)

    if match := re.search(r"attribute '([^']+)': The attribute '[^']+' is not allowed", message):
        return f"<{tag}> has no attribute {match[1]!r}: {nearest(match[1], list(attributes))}"
    if match := re.search(r"The attribute '([^']+)' is required but missing", message):
        return f"<{tag}> lacks the attribute {match[1]!r}"
    if match := re.search(r"attribute '([^']+)': (?:\[facet|'.*' is not a valid value)", message):
        value, simple_type = element.get(match[1], ""), attributes[match[1]]
        expected = _description_of(simple_type) + (advice(value) if matches(simple_type, meant(value)) else "")
        return f'{match[1]}="{_shown(value)}" of <{tag}> is not {expected}'
    if "[facet" in message:
        simple_type = next(e.get("type") for e in _schema_tree().iter(_XS + "element") if e.get("name") == tag)
        return f"the text {_shown(element.text or '')!r} of <{tag}> is not {_description_of(simple_type)}"
    if "This element is not expected" in message:
        parent = element.getparent()
        inside = f" in <{local_name(parent)}>" if parent is not None else ""
        return f"<{tag}> is not expected here{inside}; expected: {_options(message) or 'no further element'}"
    if "Missing child element(s)" in message:
        return f"<{tag}> is incomplete; expected next: {_options(message)}"
    if "Character content" in message:
        return f"<{tag}> must not contain text"
    if "Element content is not allowed" in message:
        return f"<{tag}> must not contain elements"
    return message


def _options(message: str) -> str:
    """Return the elements that libxml2 names as expected."""
    match = re.search(r"Expected is (?:one of )?\( (.*) \)", message)
    names = [name.strip() for name in match[1].split(",")] if match else []
    return " or ".join("an element of a scenario" if name == "*" else f"<{name}>" for name in names)


def _shown(value: str) -> str:
    return value if len(value) <= 80 else value[:77] + "..."
