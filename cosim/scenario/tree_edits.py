"""Putting elements into a scenario's tree and taking them out, with the white space that a person would write."""

from __future__ import annotations

from typing import TypeGuard

from lxml import etree

from cosim.scenario.grammar import children_of

_INDENT = "  "


def is_element(node: object) -> TypeGuard[etree._Element]:
    """Return whether a node is an element, not a comment, an attribute or a text."""
    return isinstance(node, etree._Element) and isinstance(node.tag, str)


def insert(parent: etree._Element, nodes: list[etree._Element]) -> None:
    """Insert nodes, one of them an element, after the last child that the schema has not after that element."""
    ranks = children_of(parent.tag)
    rank = next(ranks[node.tag] for node in nodes if is_element(node))
    index = max((i + 1 for i, c in enumerate(parent) if is_element(c) and ranks.get(c.tag, 0) <= rank), default=0)
    while 0 < index < len(parent) and not is_element(parent[index]) and "\n" not in (parent[index - 1].tail or ""):
        index += 1  # a comment on the same line
    put(parent, index, nodes)


def put(parent: etree._Element, index: int, nodes: list[etree._Element]) -> None:
    """Insert nodes before the child of an index, each on a line of its own."""
    outer = "\n" + _INDENT * sum(1 for _ in parent.iterancestors())
    for i, node in enumerate(nodes, index):
        if is_element(node) and len(node):
            etree.indent(node, _INDENT, level=outer.count(_INDENT) + 1)
        if i > 0:
            node.tail, parent[i - 1].tail = parent[i - 1].tail, outer + _INDENT
        else:
            node.tail, parent.text = parent.text if len(parent) else outer, outer + _INDENT
        parent.insert(i, node)


def take_out(element: etree._Element) -> None:
    """Remove an element and the white space after it, or before it if it is the last."""
    parent, previous = element.getparent(), element.getprevious()
    assert parent is not None, "the root is never taken out"
    if element.getnext() is None:
        if previous is not None:
            previous.tail = element.tail
        else:
            parent.text = None
    parent.remove(element)
