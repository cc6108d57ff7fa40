"""Variants: what ``<set>``, ``<replace>``, ``<insert>`` and ``<remove>`` do to the scenario that is varied.

Both trees are without their namespace. Every element of the result knows where it was written; what a rule has changed,
where the rule was.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, MutableMapping
from typing import NoReturn

from lxml import etree

from cosim.errors import InputError, Location
from cosim.scenario.edits import assign, select
from cosim.scenario.grammar import children_of, described_children

MAX_ELEMENTS = 200_000
"""Of a scenario with all its variants: a rule that inserts many elements into many multiplies them."""

_INDENT = "  "

Places = MutableMapping[etree._Element, Location]


def vary(base: etree._Element, variant: etree._Element, places: Places) -> None:
    """Change a scenario as a variant of it says.

    Parameters
    ----------
    base
        The root of the scenario, which is changed.
    variant
        The root of the variant.
    places
        The place of every element of both; gets those of new elements.

    Raises
    ------
    InputError
        A rule selects nothing, or something that it cannot be applied to, with the place of the rule; or it brings an
        element to where none of that name belongs, with the place of the element.
    """
    base.set("name", variant.get("name"))
    places[base] = places[variant]
    for tag in ("title", "description"):
        own, old = variant.find(tag), base.find(tag)
        if own is not None:
            _insert_into(base, [_copied(own, places)])
        if old is not None:
            _take_out(old)
    for rule in variant.iterchildren(*_RULES):
        _RULES[rule.tag](base, rule, places)


def _set(base: etree._Element, rule: etree._Element, places: Places) -> None:
    for node in _selected(base, rule, "select", places):
        try:
            element = assign(node, rule.get("value"))
        except ValueError as error:
            _refuse(rule, f'select="{rule.get("select")}" {error}', places)
        places[element] = places[rule]


def _replace(base: etree._Element, rule: etree._Element, places: Places) -> None:
    nodes = _selected(base, rule, "select", places)
    if len(nodes) != 1 or not _is_element(nodes[0]):
        _refuse(rule, f'select="{rule.get("select")}" selects {len(nodes)} nodes: expected is one element', places)
    (old,) = nodes
    parent = old.getparent()
    if parent is None:
        _refuse(rule, "the scenario itself cannot be replaced", places)
    _check_children(parent, rule, places)
    _put(parent, parent.index(old) + 1, [_copied(child, places) for child in rule])
    _take_out(old)


def _insert(base: etree._Element, rule: etree._Element, places: Places) -> None:
    for parent in _selected(base, rule, "into", places):
        if not _is_element(parent):
            _refuse(rule, f'into="{rule.get("into")}" selects something other than an element', places)
        _check_children(parent, rule, places)
        for group in _with_comments(rule):
            _insert_into(parent, [_copied(child, places) for child in group])


def _remove(base: etree._Element, rule: etree._Element, places: Places) -> None:
    for node in _selected(base, rule, "select", places):
        parent = node.getparent() if hasattr(node, "getparent") else None
        if parent is None:
            _refuse(rule, f'select="{rule.get("select")}": only elements and attributes can be removed', places)
        if _is_element(node):
            _take_out(node)
        elif getattr(node, "is_attribute", False):
            del parent.attrib[node.attrname]
            places[parent] = places[rule]
        else:
            _refuse(rule, f'select="{rule.get("select")}": only elements and attributes can be removed', places)


_RULES: dict[str, Callable[[etree._Element, etree._Element, Places], None]] = {
    "set": _set,
    "replace": _replace,
    "insert": _insert,
    "remove": _remove,
}


# Parts of rules ---------------------------------------------------------------------------------------------


def _selected(base: etree._Element, rule: etree._Element, attribute: str, places: Places) -> list[etree._Element]:
    try:
        return select(base, rule.get(attribute))
    except ValueError as error:
        _refuse(rule, f"{attribute}: {error}", places)


def _refuse(rule: etree._Element, message: str, places: Places) -> NoReturn:
    raise InputError(f"<{rule.tag}> {message}", places[rule]) from None


def _check_children(parent: etree._Element, rule: etree._Element, places: Places) -> None:
    for child in rule.iterchildren("*"):
        if child.tag not in children_of(parent.tag):
            raise InputError(
                f"<{child.tag}> is not expected in <{parent.tag}>; expected: {described_children(parent.tag)}",
                places[child],
            )


def _copied(element: etree._Element, places: Places) -> etree._Element:
    """Return a copy of an element, whose parts have the same places."""
    copied = copy.deepcopy(element)
    for old, new in zip(element.iter("*"), copied.iter("*"), strict=True):
        places[new] = places[old]
        if len(places) > MAX_ELEMENTS:
            raise InputError(f"the scenario grows to more than {MAX_ELEMENTS} elements here", places[element])
    return copied


def _with_comments(rule: etree._Element) -> Iterator[list[etree._Element]]:
    """Return the elements in a rule, each with the comments before it, and the last with those after it."""
    group: list[etree._Element] = []
    for child in rule:
        group.append(child)
        if _is_element(child) and any(map(_is_element, child.itersiblings())):
            yield group
            group = []
    yield group


def _is_element(node: object) -> bool:
    return isinstance(node, etree._Element) and isinstance(node.tag, str)


# The tree and its white space -------------------------------------------------------------------------------


def _insert_into(parent: etree._Element, nodes: list[etree._Element]) -> None:
    """Insert nodes, one of them an element, after the last child that the schema has not after that element."""
    ranks = children_of(parent.tag)
    rank = next(ranks[node.tag] for node in nodes if _is_element(node))
    index = max((i + 1 for i, c in enumerate(parent) if _is_element(c) and ranks.get(c.tag, 0) <= rank), default=0)
    while 0 < index < len(parent) and not _is_element(parent[index]) and "\n" not in (parent[index - 1].tail or ""):
        index += 1  # a comment on the same line
    _put(parent, index, nodes)


def _put(parent: etree._Element, index: int, nodes: list[etree._Element]) -> None:
    """Insert nodes before the child of an index, each on a line of its own."""
    outer = "\n" + _INDENT * sum(1 for _ in parent.iterancestors())
    for i, node in enumerate(nodes, index):
        if _is_element(node) and len(node):
            etree.indent(node, _INDENT, level=outer.count(_INDENT) + 1)
        if i > 0:
            node.tail, parent[i - 1].tail = parent[i - 1].tail, outer + _INDENT
        else:
            node.tail, parent.text = parent.text if len(parent) else outer, outer + _INDENT
        parent.insert(i, node)


def _take_out(element: etree._Element) -> None:
    """Remove an element and the white space after it, or before it if it is the last."""
    parent, previous = element.getparent(), element.getprevious()
    if element.getnext() is None:
        if previous is not None:
            previous.tail = element.tail
        else:
            parent.text = None
    parent.remove(element)
