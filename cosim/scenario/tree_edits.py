"""A scenario's tree: elements are put in and taken out, with the white space that a person would write; its text."""

from __future__ import annotations

from typing import TypeGuard

from lxml import etree

from cosim.scenario.grammar import NAMESPACE, children_of, local_name

_INDENT = "  "


def is_element(node: object) -> TypeGuard[etree._Element]:
    """Return whether a node is an element, not a comment, an attribute or a text."""
    return isinstance(node, etree._Element) and isinstance(node.tag, str)


def insert(parent: etree._Element, nodes: list[etree._Element]) -> None:
    """Insert nodes, one of them an element, after the last child that the schema has not after that element."""
    ranks = children_of(parent.tag)
    rank = next(ranks[node.tag] for node in nodes if is_element(node))
    before = [tag for tag, other in ranks.items() if other <= rank]
    previous = next(parent.iterchildren(*before, reversed=True), None)
    while previous is not None and "\n" not in (previous.tail or ""):
        following = previous.getnext()
        if following is None or is_element(following):
            break
        previous = following  # a comment on the same line
    put(parent, previous, nodes)


def put(parent: etree._Element, previous: etree._Element | None, nodes: list[etree._Element]) -> None:
    """Insert nodes after a child, or before all children, each on a line of its own."""
    outer = "\n" + _INDENT * sum(1 for _ in parent.iterancestors())
    for node in nodes:
        if is_element(node) and len(node):
            etree.indent(node, _INDENT, level=outer.count(_INDENT) + 1)
        if previous is not None:
            tail, previous.tail, node.tail = previous.tail, None, None
            previous.addnext(node)  # which takes the same time for any number of children
            previous.tail, node.tail = outer + _INDENT, tail
        else:
            node.tail, parent.text = parent.text if len(parent) else outer, outer + _INDENT
            parent.insert(0, node)
        previous = node


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


def strip_namespace(root: etree._Element) -> None:
    """Let XPaths see the elements of a tree without their namespace."""
    for element in root.iter("*"):
        element.tag = local_name(element)


def add_namespace(root: etree._Element) -> None:
    """Give the elements of a tree their namespace again."""
    for element in root.iter("*"):
        element.tag = f"{{{NAMESPACE}}}{local_name(element)}"


def serialised(root: etree._Element) -> str:
    """Return the text of a tree."""
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{etree.tostring(root, encoding="unicode")}\n'
