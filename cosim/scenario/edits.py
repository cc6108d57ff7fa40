"""Changes to a scenario before it is checked, as options of the command line ask for them.

A change is made in the document itself, so that the text which is kept with a result is the text that was run. It sees
elements without their namespace.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lxml import etree

from cosim.errors import InputError, nearest
from cosim.scenario.xpath_advice import advice, unclosed

Change = Callable[[etree._Element], None]


@dataclass(frozen=True)
class Option:
    """A change that an option of the command line asks for.

    Attributes
    ----------
    words : str
        That option, as a shell would take it.
    change : callable
        Makes the change.
    """

    words: str
    change: Change

    def __call__(self, root: etree._Element) -> None:
        """Make the change."""
        self.change(root)


def in_words(change: Change) -> str:
    """Return what a change is called."""
    return change.words if isinstance(change, Option) else getattr(change, "__name__", type(change).__name__)


def _quoted(text: str) -> str:
    """Return a text as a shell takes it, in double quotes where it has single ones, as XPaths often do."""
    return f'"{text}"' if "'" in text and not set('"$`\\!') & set(text) else shlex.quote(text)


def set_value(replacement: str) -> Change:
    """Return the change that ``XPATH=VALUE`` asks for: what the XPath selects gets the value."""
    xpath, value = split_setting(replacement)

    def change(root: etree._Element) -> None:
        try:
            for node in select(root, xpath):
                assign(node, value)
        except ValueError as error:
            raise InputError(f"--set {replacement}: {error}") from None

    return Option(f"--set {_quoted(replacement)}", change)


def set_seed(seed: int) -> Change:
    """Return the change to another seed of the noise."""
    return Option(f"--seed {seed}", set_value(f"simulation/@seed={seed}"))


def set_fmu(plant: str, fmu: Path) -> Change:
    """Return the change of one plant to another FMU; its parameters are kept."""

    def change(root: etree._Element) -> None:
        element = _by_id(root, "plant", plant)
        element.attrib.pop("model", None)
        element.set("fmu", str(fmu.absolute()))

    return Option(f"--plant {_quoted(f'{plant}={fmu}')}", change)


def set_binding(plant: str, file: Path) -> Change:
    """Return the change of one plant to the binding in a file."""

    def change(root: etree._Element) -> None:
        element = _by_id(root, "plant", plant)
        for binding in element.findall("binding"):
            element.remove(binding)
        element.set("binding", str(file.absolute()))

    return Option(f"--binding {_quoted(f'{plant}={file}')}", change)


def set_controller(controller: str, name: str, package: str, version: str) -> Change:
    """Return the change of one controller to another law, at that law's default gains: gains belong to a law."""

    def change(root: etree._Element) -> None:
        element = _by_id(root, "controller", controller)
        if element.get("name") == name:
            return
        for attribute, value in (("name", name), ("package", package), ("version", f"=={version}")):
            element.set(attribute, value)
        for gain in element.findall("gain"):
            element.remove(gain)

    return Option(f"--controller {_quoted(f'{controller}={name}')}", change)


def split_setting(replacement: str) -> tuple[str, str]:
    """Return the two sides of ``XPATH=VALUE``, split at the first '=' that is not in the XPath's brackets or quotes.

    Raises
    ------
    InputError
        There is no such '='.
    """
    depth, quote = 0, ""
    for index, character in enumerate(replacement):
        if quote:
            quote = "" if character == quote else quote
        elif character in "'\"":
            quote = character
        elif character in "[(":
            depth += 1
        elif character in "])":
            depth -= 1
        elif character == "=" and depth == 0:
            return replacement[:index], replacement[index + 1 :]
    problem = unclosed(replacement)
    raise InputError(
        f"--set {replacement}: expected XPATH=VALUE, such as '//simulation/@seed=2'"
        + (f"; {problem}" if problem else "")
    )


def select(root: etree._Element, xpath: str) -> list[Any]:
    """Return the nodes that an XPath selects from the root, at least one.

    Raises
    ------
    ValueError
        It is no XPath, or selects nothing.
    """
    try:
        selected = root.xpath(xpath)
    except etree.XPathError as error:
        raise ValueError(f"{xpath!r} is not an XPath: {unclosed(xpath) or error}") from None
    if not isinstance(selected, list) or not selected:
        raise ValueError(f"{xpath!r} selects nothing in the scenario{advice(root, xpath)}")
    return selected


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


def _by_id(root: etree._Element, tag: str, key: str) -> etree._Element:
    elements = {str(element.get("id")): element for element in root.findall(tag)}
    if key not in elements:
        raise InputError(f"the scenario has no {tag} {key!r}: {nearest(key, list(elements))}")
    return elements[key]
