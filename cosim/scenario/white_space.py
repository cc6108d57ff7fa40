"""White space in the values of attributes: removed around them and, in most, collapsed within."""

from __future__ import annotations

import re
from collections.abc import Iterable

from lxml import etree

from cosim.scenario.grammar import attributes_of_types, local_name

NEEDLESS = re.compile(r"^\s|\s\s|[^\S ]|\s\Z")
"""White space that is needless in most attributes: at an end, more than one space, or anything else than a space."""


def collapse(elements: Iterable[etree._Element]) -> None:
    """Remove the needless white space in the attributes of elements.

    Within the value of a path or of a variable's name it is kept: a file or a variable may be named so.
    """
    kept = attributes_of_types("path", "variable")
    for element in elements:
        for name, value in element.items():
            if NEEDLESS.search(value):
                whole = name in kept.get(local_name(element), ())
                element.set(name, value.strip() if whole else " ".join(value.split()))
