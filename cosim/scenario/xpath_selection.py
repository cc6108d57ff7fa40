"""Selection by XPath in a scenario, to set a value; a gain or parameter that is not there yet is added."""

from __future__ import annotations

import re

from lxml import etree

from cosim.scenario.grammar import children_of
from cosim.scenario.tree_edits import insert, is_element
from cosim.scenario.xpath_advice import advice, unclosed
from cosim.scenario.xpath_cost import affordable
from cosim.scenario.xpath_once import ask

_NAMED_VALUE = re.compile(
    r"(?P<parent>.+)/(?P<tag>gain|parameter)"
    r"""\[\s*@name\s*=\s*(?P<quote>['"])(?P<name>[^'"]+)(?P=quote)\s*\]/@value"""
)
"""``PARENT/gain[@name='NAME']/@value``: it suffices to add the element."""


def select(root: etree._Element, xpath: str) -> list[object]:
    """Return the nodes that an XPath selects from the root, at least one.

    Raises
    ------
    ValueError
        It is no XPath, or selects nothing.
    """
    selected = evaluated(root, xpath)
    if not selected:
        raise ValueError(f"{xpath!r} selects nothing in the scenario{advice(root, xpath)}")
    return selected


def selected_or_added(root: etree._Element, xpath: str) -> list[object]:
    """Return the nodes that an XPath selects; if there are none, a gain or parameter that it names is added.

    It is added for ``PARENT/gain[@name='NAME']/@value`` (or ``parameter``) if PARENT selects one element that can have
    such a child. The controller or the plant refuses an unknown name later, when it is looked for.

    Raises
    ------
    ValueError
        It is no XPath, or selects nothing and names nothing that could be added to one element.
    """
    match = _NAMED_VALUE.fullmatch(xpath)
    if match is None:
        return select(root, xpath)
    if found := evaluated(root, xpath):
        return found
    tag, name, parent = match["tag"], match["name"], match["parent"]
    if parent.endswith("/"):  # as in //gain
        parent += "/descendant-or-self::*"
    holders = [node for node in evaluated(root, parent) if is_element(node) and tag in children_of(node.tag)]
    if len(holders) == 1:
        insert(holders[0], [added := etree.Element(tag, name=name, value="")])
        return evaluated(added, "@value")
    if not holders or advice(root, xpath):
        return select(root, xpath)
    raise ValueError(
        f"{xpath!r} selects nothing in the scenario; to add the {tag} {name!r}, name the element that gets it, such as "
        f"{_shown(holders[0])}/{tag}[@name='{name}']/@value"
    )


def assign(node: object, value: str) -> etree._Element:
    """Give an attribute or an element of text another value; return the element.

    Raises
    ------
    ValueError
        It is something else, or no XML file can hold the value.
    """
    if isinstance(node, etree._ElementUnicodeResult) and node.is_attribute:
        parent, name = node.getparent(), node.attrname
        assert parent is not None
        assert name is not None
        parent.set(name, value)
        return parent
    if isinstance(node, etree._Element) and isinstance(node.tag, str) and len(node) == 0:
        if node.attrib:
            attributes = " or ".join(f"/@{name}" for name in node.attrib)
            raise ValueError(f"selects a <{node.tag}>, which has no text: an attribute of it ends in {attributes}")
        node.text = value
        return node
    raise ValueError("selects something other than an attribute or an element of text; an attribute ends in /@NAME")


def evaluated(root: etree._Element, xpath: str) -> list[object]:
    """Return the nodes that an XPath selects from the root.

    Raises
    ------
    ValueError
        It is no XPath, or may take too long.
    """
    try:
        affordable(root, xpath)
        selected = ask(root, xpath)
    except etree.XPathError as error:
        raise ValueError(f"{xpath!r} is not an XPath: {unclosed(xpath) or error}") from None
    return selected if isinstance(selected, list) else []


def _shown(element: etree._Element) -> str:
    key = element.get("id")
    return element.tag if key is None else f"{element.tag}[@id='{key}']"
