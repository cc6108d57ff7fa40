"""The elements of a document that satisfies the schema, with their children."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, zip_longest
from operator import is_
from pathlib import Path
from typing import TypeVar

from lxml import etree

from cosim.errors import InputError, Location, nearest
from cosim.scenario.document import Document
from cosim.scenario.scenario import Setting
from cosim.scenario.written_element import Written

_T = TypeVar("_T")


@dataclass(frozen=True, eq=False)
class Element(Written):
    """An element of a document.

    Attributes
    ----------
    inside : tuple of Element
        The elements within it.
    text : str
        The text in it, without needless white space.
    """

    inside: tuple[Element, ...]
    text: str

    __eq__ = object.__eq__  # not that of `Written`, which does not look inside
    __hash__ = object.__hash__

    @classmethod
    def root(cls, document: Document, before: Element | None = None) -> Element:
        """Return the root element of a document; it and those within it are earlier ones where these are equal."""
        return cls._of(document.root, document, document.path.parent, before)

    @classmethod
    def _of(cls, node: etree._Element, document: Document, folder: Path, before: Element | None) -> Element:
        inside: tuple[Element, ...] = ()
        if len(node):
            nodes, earlier = list(node.iterchildren("*")), () if before is None else before.inside
            each = zip_longest(nodes, earlier[: len(nodes)])
            inside = tuple([cls._of(child, document, folder, was) for child, was in each])
        kind, attributes = node.tag.rpartition("}")[2], dict(node.items())
        where, text = document.where(node), " ".join((node.text or "").split())
        facts = (kind, attributes, where, folder, inside, text)
        if before is not None and before._facts == facts:
            return before
        return cls(*facts)

    def with_attributes(self, given: Mapping[int, Mapping[str, str]], first: int = 0) -> Element:
        """Return it with other attributes of some elements, itself among them; all others stay the same objects.

        Parameters
        ----------
        given
            All attributes of these elements, by their numbers in the order of the text.
        first
            Its own number.
        """
        numbers = self._numbers
        if not any(first <= number < first + numbers[-1] for number in given):
            return self
        inside = tuple(
            child.with_attributes(given, first + own) for child, own in zip(self.inside, numbers[:-1], strict=True)
        )
        attributes = given.get(first, self.attributes)
        same = attributes == self.attributes and all(map(is_, inside, self.inside))
        return self if same else replace(self, attributes=attributes, inside=inside)

    @cached_property
    def _numbers(self) -> list[int]:
        """The numbers of the elements within it, counted from it, and the number of all."""
        return list(accumulate((child._numbers[-1] for child in self.inside), initial=1))

    @property
    def _facts(self) -> tuple[object, ...]:
        return self.kind, self.attributes, self.where, self.folder, self.inside, self.text

    def children(self, kind: str) -> Iterator[Element]:
        """Return the elements of a kind within it."""
        return (child for child in self.inside if child.kind == kind)

    def find(self, kind: str) -> Element | None:
        """Return the first element of a kind within it, if there is any."""
        return next(self.children(kind), None)

    def child(self, kind: str) -> Element:
        """Return the element of a kind that the schema demands within it."""
        child = self.find(kind)
        assert child is not None, f"the schema demands <{kind}>"
        return child


def table(root: Element, tag: str, read: Callable[[Element], _T]) -> dict[str, _T]:
    """Read all elements of a name, by their ids; refuse an id that is given twice."""
    found: dict[str, _T] = {}
    first: dict[str, Location] = {}
    for element in root.children(tag):
        key = element.get("id")
        if key in found:
            place = first[key].seen_from(element.where)
            raise element.error(f"the id {key!r} is given to a second <{tag}>; first {place}")
        found[key] = read(element)
        first[key] = element.where
    return found


def settings(element: Element, tag: str) -> tuple[Setting, ...]:
    """Read the named values in the elements of a name; refuse a name that is given twice."""
    seen: dict[str, Setting] = {}
    found = [Setting(child.get("name"), child.get("value"), child.where) for child in element.children(tag)]
    for setting in found:
        if setting.name in seen:
            first = seen[setting.name].where.seen_from(setting.where)
            raise InputError(f"the {tag} {setting.name!r} is given twice; first {first}", setting.where)
        seen[setting.name] = setting
    return tuple(found)


def known(element: Element, what: str, among: Mapping[str, object]) -> str:
    """Return the id that an attribute names; refuse an unknown one."""
    key = element.get(what)
    if key not in among:
        raise element.error(f"the scenario has no {what} {key!r}: {nearest(key, list(among))}")
    return key


def robots(element: Element, among: Mapping[str, object]) -> tuple[str, ...]:
    """Return the ids in the attribute ``robots``; each must be a robot of the scenario."""
    named = tuple(dict.fromkeys(element.get("robots").split()))
    for robot in named:
        if robot not in among:
            raise element.error(f"the scenario has no robot {robot!r}: {nearest(robot, list(among))}")
    return named
