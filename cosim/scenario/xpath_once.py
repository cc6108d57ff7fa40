"""Predicates of an XPath that are the same at every node are evaluated once: ``//a[//b]`` asks for ``//b`` first.

libxml2 evaluates a predicate at each node. It is the same at all of them if its paths begin at the root and no function
in it asks for the node or its position. Its value then takes its place, as a variable.
"""

from __future__ import annotations

import re
from functools import lru_cache

from lxml import etree

TOKEN = re.compile(
    r"""\s*(?:(?P<literal>"[^"]*"|'[^']*'|[0-9]+(?:\.[0-9]*)?|\.[0-9]+)|(?P<name>[^\W\d](?:[\w.-])*)"""
    r"""|(?P<symbol>//|::|\.\.|<=|>=|!=|\S))""",
)
MAX_LENGTH = 20_000
_VARIABLE = "once_"
_FUNCTIONS = frozenset(
    (
        *("boolean", "ceiling", "concat", "contains", "count", "floor", "normalize-space", "not", "number", "round"),
        *(
            "starts-with",
            "string",
            "string-length",
            "substring",
            "substring-after",
            "substring-before",
            "sum",
            "translate",
        ),
    )
)
"""Functions that depend on their arguments alone, if they have any."""

Token = tuple[str, str]
"""Its kind, of the groups of `TOKEN`, and its text."""


def ask(root: etree._Element, xpath: str) -> object:
    """Return what an XPath returns, evaluated from the root.

    Raises
    ------
    lxml.etree.XPathError
        It is no XPath.
    """
    *before, whole = separated(xpath)
    values: dict[str, bool | float] = {}
    for number, part in enumerate(before):
        value = root.xpath(part, **values)
        if not isinstance(value, float):
            value = bool(value) or root.xpath(f"boolean({part})", **values)  # lxml leaves out the document
        values[f"{_VARIABLE}{number}"] = value
    return root.xpath(whole, **values)


@lru_cache(256)
def separated(xpath: str) -> tuple[str, ...]:
    """Return the XPaths that `ask` evaluates in turn, of which the last one is the whole."""
    if len(xpath) > MAX_LENGTH or "[" not in xpath or "$" in xpath:
        return (xpath,)
    parts: list[str] = []
    groups: list[tuple[list[str], list[Token]]] = [([], [])]  # of each open predicate: text, tokens
    end = 0
    for match in TOKEN.finditer(xpath):
        kind, text, end = str(match.lastgroup), match[match.lastgroup or 0], match.end()
        if text == "]" and kind == "symbol" and len(groups) > 1:
            inner, own = groups.pop()
            if _is_the_same_everywhere(own):
                parts.append("".join(inner))
                inner = [f"${_VARIABLE}{len(parts) - 1}"]
            groups[-1][0].extend(inner)
        groups[-1][0].append(match[0])
        if text == "[" and kind == "symbol":
            groups.append(([], []))
        elif text != "]" or kind != "symbol":
            groups[-1][1].append((kind, text))
    return (*parts, "".join(text for inner, _ in groups for text in inner) + xpath[end:])


def _is_the_same_everywhere(tokens: list[Token]) -> bool:
    """Return whether an expression asks for nodes, and surely for the same ones wherever it is evaluated.

    Its tokens are given without the predicates in it.
    """
    if ("symbol", "/") not in tokens and ("symbol", "//") not in tokens:
        return False
    expected = "operand"
    for (kind, text), following in zip(tokens, [*(text for _, text in tokens[1:]), ""], strict=True):
        if expected == "step or end" and kind != "name" and text not in ("@", "*", ".", ".."):
            expected = "operator"  # it was the root itself
        if expected == "operand":
            expected = _after_operand(kind, text, following)
        elif expected in ("step", "step or end"):
            expected = _after_step(kind, text, following)
        elif expected == "operator":
            expected = _AFTER_OPERAND.get(text, "") if kind != "literal" else ""
        elif text == ")":  # of a node test
            expected = "operator"
        if not expected:
            return False
    return expected in ("operator", "step or end")


_AFTER_OPERAND = {
    **dict.fromkeys(("/", "//"), "step"),
    **dict.fromkeys((*"=<>+-*|,", "!=", "<=", ">=", "and", "or", "div", "mod"), "operand"),
    ")": "operator",
}
"""What is expected after something that follows an operand."""


def _after_operand(kind: str, text: str, following: str) -> str:
    """Return what is expected after the beginning of an operand; nothing if it may depend on the node."""
    if kind == "literal":
        return "operator"
    if kind == "name":
        return "operand" if text in _FUNCTIONS and following == "(" else ""
    return {"/": "step or end", "//": "step", "(": "operand", "-": "operand"}.get(text, "")


def _after_step(kind: str, text: str, following: str) -> str:
    """Return what is expected after a part of a step; nothing if it is none."""
    if kind == "name":
        return {"::": "step", "(": "test", ":": ""}.get(following, "operator")
    return {"::": "step", "@": "step", "*": "operator", ".": "operator", "..": "operator"}.get(text, "")
