"""What is wrong with an XPath that selects nothing, and which one was perhaps meant."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from contextlib import suppress

from lxml import etree

MAX_SHOWN = 3

_WORD = re.compile(r"[A-Za-z_][\w.-]*")
_CLOSING = {"[": "]", "(": ")"}


def unclosed(xpath: str) -> str:
    """Return a sentence on the bracket or quote that has no partner; empty if all have one."""
    opened: list[tuple[str, int]] = []
    for place, character in enumerate(xpath, start=1):
        last = opened[-1][0] if opened else ""
        if last in ("'", '"'):
            if character == last:
                opened.pop()
        elif character in "'\"[(":
            opened.append((character, place))
        elif character in "])":
            if _CLOSING.get(last) != character:
                return f"the {character} at character {place} closes nothing"
            opened.pop()
    if not opened:
        return ""
    character, place = opened[-1]
    return f"the {character} at character {place} has no {_CLOSING.get(character, character)} that closes it"


def advice(root: etree._Element, xpath: str) -> str:
    """Return the end of a sentence that names XPaths which select something and are like one that does not."""
    found: list[str] = []
    for candidate in _candidates(root, xpath):
        if candidate != xpath and candidate not in found and _selects(root, candidate):
            found.append(candidate)
            if len(found) == MAX_SHOWN:
                break
    return f": did you mean {' or '.join(found)}?" if found else ""


def _selects(root: etree._Element, xpath: str) -> bool:
    with suppress(etree.XPathError):
        return bool(root.xpath(xpath))
    return False


def _candidates(root: etree._Element, xpath: str) -> Iterator[str]:
    name = re.fullmatch(rf"/*@?({_WORD.pattern})", xpath)
    if name and (named := list(_named(root, name[1]))):
        yield from named
        return
    quoted = re.sub(rf"=\s*({_WORD.pattern})\s*\]", r"='\1']", xpath)
    for elements in (quoted, _respelled(root, quoted)):
        for one in (elements, re.sub(rf"/({_WORD.pattern})$", r"/@\1", elements)):
            yield one
            yield "//" + one.lstrip("/")


def _named(root: etree._Element, name: str) -> Iterator[str]:
    """Return what has a value by a name: gains and parameters, attributes, elements of text."""
    elements = list(root.iter("*"))
    yield from (f"//{e.tag}[@name='{name}']/@value" for e in elements if e.get("name") == name)
    yield from (f"//{e.tag}/@{name}" for e in elements if name in e.attrib)
    yield from (f"//{e.tag}" for e in elements if e.tag == name and not len(e) and not e.attrib)


def _respelled(root: etree._Element, xpath: str) -> str:
    """Return an XPath whose words are those of the scenario that are nearest to them."""
    known: set[str] = set()
    for element in root.iter("*"):
        known |= {element.tag, *element.attrib, element.get("name", ""), element.get("id", "")}

    def nearest(word: re.Match[str]) -> str:
        if word[0] in known:
            return word[0]
        return next(iter(difflib.get_close_matches(word[0][:100], known, n=1)), word[0])

    return _WORD.sub(nearest, xpath)
