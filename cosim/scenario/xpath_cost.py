"""How long an XPath may take at most, told from its text: libxml2 cannot be stopped once it has begun.

A path looks at each node about once. A predicate is evaluated for each node, and costs as much again if it begins anew
at the root or leaves its own children: ``//a[../b]`` looks at the square of the nodes, ``//a[../b[../c]]`` at the cube.
So does a comparison of two sets of nodes. A predicate that is the same at each node is evaluated once by `xpath_once`.
At the outermost level, a step that begins anew costs the square because each node that is found is compared with all
found before. All bounds are from above.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from itertools import accumulate

from lxml import etree

from cosim.scenario.xpath_once import MAX_LENGTH, TOKEN, Token, separated

BUDGET = 10_000_000
"""How many nodes an XPath, or all XPaths of a variant, may look at: about a second."""
_LARGEST = 1_000_000
"""No tree is larger."""
MAX_DEPTH = 50
"""Of the predicates within each other."""

_ROOT = re.compile(r"/[^\W\d][\w-]*|/\*|\.|/")
"""An XPath that selects the root."""
_FAR = frozenset(("parent", "ancestor", "ancestor-or-self", "descendant", "descendant-or-self"))
_ASIDE = frozenset(("following", "following-sibling", "preceding", "preceding-sibling"))
_COMPARING = frozenset(("=", "!=", "<", ">", "<=", ">="))
_SEARCHING = frozenset(("contains", "starts-with", "substring-before", "substring-after", "translate"))
_NODE_TESTS = frozenset(("id", "node", "text", "comment", "processing-instruction"))
_CHEAPER = 16
"""How much faster two nodes are compared than one is looked at."""
_TOKENS = 16
"""Tokens of a usual XPath."""

_NONE: Token = ("", "")


def size_of(root: etree._Element) -> int:
    """Return how large a tree is for an XPath: its elements, and each 100 characters of text as one more."""
    return int(root.xpath("count(//*)")) + text_of(root)


def text_of(root: etree._Element) -> int:
    """Return by how much the text of a tree makes it larger."""
    return int(root.xpath("string-length(/)")) // 100


def affordable(root: etree._Element, xpath: str) -> None:
    """Refuse an XPath that may take too long.

    Raises
    ------
    ValueError
        It may look at more nodes than `BUDGET`.
    """
    if cost(xpath, _LARGEST) > BUDGET and (looks := cost(xpath, size_of(root))) > BUDGET:
        raise ValueError(
            f"{xpath!r} might look at {looks:.1g} nodes, which takes too long (at most {BUDGET:.0g}): write no // and "
            "no .. into predicates, or name the elements by a path from the root"
        )


@lru_cache(256)
def cost(xpath: str, size: int) -> int:
    """Return the largest number of nodes that an XPath can look at in a tree of some size.

    Raises
    ------
    ValueError
        It is too long or too deeply nested to be evaluated.
    """
    if _ROOT.fullmatch(xpath):
        return max(size // 8, 1)  # for what is done with the root
    if len(xpath) > MAX_LENGTH:
        raise ValueError(f"an XPath has at most {MAX_LENGTH} characters, this one has {len(xpath)}")
    if _depth(xpath) > MAX_DEPTH:
        raise ValueError(f"an XPath has at most {MAX_DEPTH} predicates within each other")
    *before, whole = separated(xpath)
    return 2 * sum(_looks(part, size) for part in before) + _looks(whole, size)


def _tokens(xpath: str) -> list[Token]:
    return [(str(match.lastgroup), match[match.lastgroup or 0]) for match in TOKEN.finditer(xpath)]


def _depth(xpath: str) -> int:
    """Return how many predicates are within each other, at most."""
    symbols = [text for kind, text in _tokens(xpath) if kind == "symbol"]
    return max(accumulate(symbols, lambda depth, text: max(depth + (text == "[") - (text == "]"), 0), initial=0))


def _looks(xpath: str, size: int) -> int:
    """Return the largest number of nodes that an XPath can look at, all of whose predicates are evaluated at each."""
    tokens = _tokens(xpath)
    groups: list[_Group] = [_Group()]
    for place, token in enumerate(tokens):
        before = tokens[place - 1] if place else _NONE
        if len(groups) == 1 and not _ends(before):
            before = _NONE  # what begins here is evaluated once
        if token == ("symbol", "["):
            groups.append(_Group())
        elif token == ("symbol", "]") and len(groups) > 1:
            inner = groups.pop()
            groups[-1].inner = max(groups[-1].inner, inner.degree)
        else:
            groups[-1].add(before, token, tokens[place + 1 : place + 4], tokens[max(place - 3, 0) : place])
    outer = groups[0]
    for inner in groups[1:]:  # not closed: it is no XPath
        outer.inner = max(outer.inner, inner.degree)
    looks: int = max(size, 1) ** (1 + outer.aside + outer.inner)
    if outer.far or outer.compared or outer.aside:
        looks += size ** (2 + outer.aside) // _CHEAPER
    return looks * (1 + len(tokens) // _TOKENS + _searched(tokens))


def _searched(tokens: Sequence[Token]) -> int:
    """Return the length of the longest text that is looked for at each character of others."""
    if not any(kind == "name" and text in _SEARCHING for kind, text in tokens):
        return 0
    return max((len(text) for kind, text in tokens if kind == "literal"), default=0)


class _Group:
    """A predicate, or the outermost level."""

    def __init__(self) -> None:
        self.far = False
        """Whether a step begins anew, or leaves the children."""
        self.aside = 0
        """Number of steps that go aside: each of them may look at all nodes for each of the step before."""
        self.compared = False
        """Whether two sets of nodes are compared or united."""
        self.inner = 0
        """Degree of the predicates within it."""

    @property
    def degree(self) -> int:
        """The power of the number of nodes by which it multiplies the cost."""
        again = self.aside if self.far or self.aside > 1 else 0  # nodes found by several ways are compared
        return self.far + self.aside + again + self.compared + self.inner

    def add(self, before: Token, token: Token, after: Sequence[Token], until: Sequence[Token]) -> None:
        """Regard a token that stands directly in it, between some others."""
        kind, text = token
        if kind == "name" and after[:1] == [("symbol", "::")]:
            self.far |= text in _FAR
            self.aside += text in _ASIDE
        elif kind == "symbol":
            self.far |= text == ".." or (
                text in ("/", "//") and (text == "//" or not _ends(before)) and before != _NONE
            )
            self.compared |= text == "|" or (text in _COMPARING and not _single(after) and not _single(until[::-1]))


def _ends(token: Token) -> bool:
    """Return whether a token ends an operand, so that a / after it does not begin at the root."""
    kind, text = token
    return kind in ("name", "literal") or text in ("]", ")", ".", "..", "*")


def _single(tokens: Sequence[Token]) -> bool:
    """Return whether the operand next to a comparison is surely a single value; tokens from there on, or back."""
    first, second, third = (*tokens[:3], *[_NONE] * (3 - len(tokens[:3])))
    if first[0] == "literal":
        return True
    edges = ("", "]", "[", "(", ")", ",", "and", "or")
    if first == ("symbol", "@"):
        return second[0] == "name" and third[1] in edges
    if first[0] == "name" and second == ("symbol", "@"):
        return third[1] in edges
    if first == ("symbol", "."):
        return second[1] in edges
    return first[0] == "name" and second == ("symbol", "(") and first[1] not in _NODE_TESTS
