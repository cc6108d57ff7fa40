"""Advice about an XPath that selects nothing: its fault, and similar XPaths that select something."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from itertools import islice

from lxml import etree

from cosim.scenario.xpath_cost import affordable
from cosim.scenario.xpath_once import ask

MAX_SHOWN = 3
MAX_TRIED = 50
"""How many XPaths are tried; each of them searches the whole scenario."""
MAX_WORDS = 20
"""How many words of an XPath are respelled."""
MAX_NAMES = 5000
"""Of how many names in the scenario the nearest is looked for."""
MAX_LENGTH = 500
"""How long an XPath is that others are likened to."""

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
    """Return the end of a sentence that names XPaths that select something and resemble one that selects nothing."""
    if len(xpath) > MAX_LENGTH:
        return ""
    tried = islice(_distinct(_candidates(root, xpath), xpath), MAX_TRIED)
    found = list(islice((candidate for candidate in tried if _selects(root, candidate)), MAX_SHOWN))
    return f": did you mean {' or '.join(found)}?" if found else ""


def _distinct(candidates: Iterable[str], xpath: str) -> Iterator[str]:
    """Return each candidate once, without the XPath itself."""
    seen = {xpath}
    for candidate in candidates:
        if candidate not in seen:
            seen.add(candidate)
            yield candidate


def _selects(root: etree._Element, xpath: str) -> bool:
    with suppress(etree.XPathError, ValueError):
        affordable(root, xpath)
        return bool(ask(root, xpath))
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
    """Return all nodes with a name and a value: gains and parameters, attributes, elements of text."""
    elements = list(root.iter("*"))
    yield from (f"//{e.tag}[@name='{name}']/@value" for e in elements if e.get("name") == name)
    yield from (f"//{e.tag}/@{name}" for e in elements if name in e.attrib)
    yield from (f"//{e.tag}" for e in elements if e.tag == name and not len(e) and not e.attrib)


def _respelled(root: etree._Element, xpath: str) -> str:
    """Return the XPath with each word replaced by the nearest word of the scenario."""
    known: set[str] = set()
    for element in root.iter("*"):
        known |= {element.tag, *element.attrib, element.get("name", ""), element.get("id", "")}
        if len(known) > MAX_NAMES:
            break
    respelled = 0

    def nearest(word: re.Match[str]) -> str:
        nonlocal respelled
        respelled += word[0] not in known
        if word[0] in known or respelled > MAX_WORDS:
            return word[0]
        return next(iter(difflib.get_close_matches(word[0][:100], known, n=1)), word[0])

    return _WORD.sub(nearest, xpath)
