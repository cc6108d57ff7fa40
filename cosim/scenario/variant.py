"""Variants: ``<set>``, ``<replace>``, ``<insert>`` and ``<remove>`` applied to a scenario.

Both trees are without their namespace. Every element of the result knows where it was written; what a rule has changed,
where the rule was.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, MutableMapping
from typing import NoReturn

from lxml import etree

from cosim.errors import InputError, Location
from cosim.scenario.grammar import children_of, described_children
from cosim.scenario.tree_edits import insert, is_element, put, take_out
from cosim.scenario.xml_tree import MAX_ELEMENTS
from cosim.scenario.xpath_cost import BUDGET, cost, text_of
from cosim.scenario.xpath_selection import assign, select, selected_or_added

Places = MutableMapping[etree._Element, Location]


def vary(base: etree._Element, variant: etree._Element, places: Places) -> None:
    """Apply the rules of a variant to a scenario.

    Parameters
    ----------
    base
        The root of the scenario, which is changed.
    variant
        The root of the variant.
    places
        The place of every element of both; places of new elements are added.

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
            insert(base, [_copied(own, places)])
        if old is not None:
            take_out(old)
    text, looks = text_of(base) + text_of(variant), 0
    for rule in variant.iterchildren(*RULES):
        looks += _cost(rule, len(places) + text)
        if looks > BUDGET:
            _refuse(rule, "is one rule too many: up to here, they might look at too many elements", places)
        RULES[rule.tag](base, rule, places)


def _set(base: etree._Element, rule: etree._Element, places: Places) -> None:
    for node in _selected(base, rule, "select", places, selected_or_added):
        try:
            element = assign(node, rule.get("value"))
        except ValueError as error:
            _refuse(rule, f'select="{rule.get("select")}" {error}', places)
        places[element] = places[rule]


def _replace(base: etree._Element, rule: etree._Element, places: Places) -> None:
    nodes = _selected(base, rule, "select", places)
    if len(nodes) != 1 or not is_element(old := nodes[0]):
        _refuse(rule, f'select="{rule.get("select")}" selects {len(nodes)} nodes: expected one element', places)
    parent = old.getparent()
    if parent is None:
        _refuse(rule, "the scenario itself cannot be replaced", places)
    _check_children(parent, rule, places)
    put(parent, old, [_copied(child, places) for child in rule])
    take_out(old)


def _insert(base: etree._Element, rule: etree._Element, places: Places) -> None:
    for parent in _selected(base, rule, "into", places):
        if not is_element(parent):
            _refuse(rule, f'into="{rule.get("into")}" selects something other than an element', places)
        _check_children(parent, rule, places)
        for group in _with_comments(rule):
            insert(parent, [_copied(child, places) for child in group])


def _remove(base: etree._Element, rule: etree._Element, places: Places) -> None:
    for node in _selected(base, rule, "select", places):
        if is_element(node) and node.getparent() is not None:
            take_out(node)
        elif isinstance(node, etree._ElementUnicodeResult) and node.is_attribute:
            parent = node.getparent()
            del parent.attrib[node.attrname]
            places[parent] = places[rule]
        else:
            _refuse(rule, f'select="{rule.get("select")}": only elements and attributes can be removed', places)


RULES: dict[str, Callable[[etree._Element, etree._Element, Places], None]] = {
    "set": _set,
    "replace": _replace,
    "insert": _insert,
    "remove": _remove,
}


# Parts of rules ---------------------------------------------------------------------------------------------


def _selected(
    base: etree._Element,
    rule: etree._Element,
    attribute: str,
    places: Places,
    selecting: Callable[[etree._Element, str], list[object]] = select,
) -> list[object]:
    try:
        return selecting(base, rule.get(attribute, ""))
    except ValueError as error:
        _refuse(rule, f"{attribute}: {error}", places)


def _cost(rule: etree._Element, size: int) -> int:
    """Return the cost of a rule's XPath; of one that is refused by itself, nothing."""
    try:
        looks = cost(rule.get("select", rule.get("into", "")), size)
    except ValueError:
        return 0
    return looks if looks <= BUDGET else 0


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
        if len(places) > MAX_ELEMENTS:  # a rule that inserts many elements into many multiplies them
            raise InputError(f"the scenario grows to more than {MAX_ELEMENTS} elements here", places[element])
    return copied


def _with_comments(rule: etree._Element) -> Iterator[list[etree._Element]]:
    """Return the elements in a rule, each with the comments before it, the last one with the comments after it, too."""
    group: list[etree._Element] = []
    for child in rule:
        group.append(child)
        if is_element(child) and any(map(is_element, child.itersiblings())):
            yield group
            group = []
    yield group
