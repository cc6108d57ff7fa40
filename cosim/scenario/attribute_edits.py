"""A document of which attributes are changed again and again: all that does not change is made once.

The text and the errors are those of `Document.changed`, which makes all other changes.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from typing import TypeAlias

from cosim.errors import Location
from cosim.scenario.document import Document
from cosim.scenario.edits import Change, attributes_given
from cosim.scenario.grammar import violation
from cosim.scenario.tree_edits import add_namespace, serialised, strip_namespace
from cosim.scenario.white_space import collapse

Given: TypeAlias = Mapping[int, Mapping[str, str]]
"""All attributes of some elements, by the element's number in the document."""


class AttributeEdits:
    """A document of which attributes are changed again and again, each time as it was at first.

    Parameters
    ----------
    document
        The document; it stays as it is.

    Attributes
    ----------
    places : tuple of Location
        Those of the document, which are the same whatever its attributes are.
    """

    def __init__(self, document: Document) -> None:
        self.places: tuple[Location, ...] = document.places
        self._bare = copy.deepcopy(document.root)
        strip_namespace(self._bare)  # for XPaths
        whole = copy.deepcopy(self._bare)
        add_namespace(whole)  # for the schema, and for the text
        self._number = {element: number for number, element in enumerate(self._bare.iter("*"))}
        self._elements = list(whole.iter("*"))

    def made(self, changes: Iterable[Change]) -> tuple[str, Given] | None:
        """Return the text of the document with changes, and the elements whose attributes are then other ones.

        None if changes do something else than giving values to attributes that are there, or break the schema.
        """
        changed: dict[tuple[int, str], str] = {}
        with ExitStack() as undo:
            for change in changes:
                try:
                    given = attributes_given(self._bare, change)
                    if given is None:
                        return None
                    for element, name, value in given:
                        undo.callback(element.set, name, str(element.get(name)))
                        element.set(name, value)  # which the XPath of the next change may look at
                        changed[self._number[element], name] = value
                except ValueError:  # it is no XPath, or no value
                    return None
            numbers = dict.fromkeys(number for number, _ in changed)
            for (number, name), value in changed.items():
                element = self._elements[number]
                undo.callback(element.set, name, str(element.get(name)))
                element.set(name, value)
            collapse(self._elements[number] for number in numbers)
            if violation(self._elements[0]) is not None:
                return None
            return serialised(self._elements[0]), {number: dict(self._elements[number].items()) for number in numbers}
