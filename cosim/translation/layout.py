"""C code as a tree of lines, and its text: indented, wrapped and without names that nobody uses."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

WIDTH: Final = 120
INDENT: Final = 4


@dataclass
class Line:
    """A statement.

    Attributes
    ----------
    text : str
        The statement; empty for a blank line.
    declares : str
        The name that it declares, if any.
    is_needed : bool
        Whether it does something else, so that it stays even if nobody uses the name.
    """

    text: str
    declares: str = ""
    is_needed: bool = False


@dataclass
class Compound:
    """A statement with blocks: for each its head, such as ``for (...)``."""

    parts: list[tuple[str, Block]]


@dataclass
class Block:
    """Statements, one after the other."""

    items: list[Line | Compound] = field(default_factory=list)

    def add(self, text: str, declares: str = "", is_needed: bool = False) -> Line:
        """Add a statement."""
        line = Line(text, declares, is_needed)
        self.items.append(line)
        return line

    def without_unused(self) -> Block:
        """Return the block without declarations of names that are not used in it."""
        kept: list[Line | Compound] = []
        later: set[str] = set()
        for item in reversed(self.items):
            if isinstance(item, Line) and item.declares and item.declares not in later and not item.is_needed:
                continue
            if isinstance(item, Compound):
                item = Compound([(head, block.without_unused()) for head, block in item.parts])
            later.update(_words(item))
            if isinstance(item, Line) and item.declares and not is_read(item.declares, kept):
                kept.append(Line(f"(void){item.declares};"))
            kept.append(item)
        return Block(kept[::-1])

    def lines(self, depth: int) -> Iterator[str]:
        """Yield the lines of the text."""
        before: Line | Compound | None = None
        items = self.items[:]
        while items and isinstance(items[-1], Line) and not items[-1].text:
            items.pop()
        for item in items:
            if isinstance(item, Compound):
                yield from _compound(item, depth)
            elif item.text:
                yield from wrapped(item.text, INDENT * depth)
            elif before is not None and not (isinstance(before, Line) and not before.text):
                yield ""
            before = item


def _compound(item: Compound, depth: int) -> Iterator[str]:
    margin = " " * (INDENT * depth)
    for place, (head, block) in enumerate(item.parts):
        opened = f"{head} {{" if place == 0 else f"}} {head} {{"
        yield from wrapped(opened, INDENT * depth)
        yield from block.lines(depth + 1)
    yield f"{margin}}}"


def is_read(name: str, items: Iterable[Line | Compound]) -> bool:
    """Tell whether statements read a name, and do not only assign it."""
    for item in items:
        if isinstance(item, Compound):
            if any(name in re.findall(r"\w+", head) or is_read(name, block.items) for head, block in item.parts):
                return True
        else:
            text = re.sub(rf"^{name} [-+*/]?= ", "", item.text)
            if name in _words(Line(text)):
                return True
    return False


def _words(item: Line | Compound) -> set[str]:
    if isinstance(item, Line):
        return set(re.findall(r"\w+", re.sub(r"/\*.*?\*/", "", item.text)))
    found: set[str] = set()
    for head, block in item.parts:
        found.update(re.findall(r"\w+", head))
        for inner in block.items:
            found |= _words(inner)
    return found


def comment(text: str, indent: int) -> str:
    """Return words as a comment in C, over several lines where need be."""
    clean = text.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?").rstrip("\\")
    margin = " " * indent
    paragraphs = [" ".join(part.split()) for part in re.split(r"\n\s*\n", clean.strip())]
    lines = [
        line
        for place, part in enumerate(paragraphs)
        for line in ([""] if place else []) + textwrap.wrap(part, WIDTH - indent - 3, break_long_words=False)
    ]
    if len(lines) == 1 and len(lines[0]) + indent + 6 <= WIDTH:
        return f"{margin}/* {lines[0]} */"
    if len(lines[-1]) + indent + 6 > WIDTH:
        lines[-1:] = textwrap.wrap(lines[-1], WIDTH - indent - 6, break_long_words=False)
    text = f"{margin}/* {lines[0]}\n" + "\n".join(f"{margin} * {line}".rstrip() for line in lines[1:])
    return f"{text} */"


def wrapped(text: str, indent: int) -> Iterator[str]:
    """Yield a statement in lines, broken where it nests least and binds least, and aligned there."""
    if text.startswith("/* ") and text.endswith(" */"):
        yield from comment(text[3:-3], indent).splitlines()
        return
    first, *rest = _broken(text, indent, indent + INDENT)
    yield " " * indent + first
    yield from rest


def _broken(text: str, column: int, align: int) -> list[str]:
    """Return the lines of a text that begins at a column; the first lacks its margin."""
    if column + len(text) <= WIDTH:
        return [text]
    assignment = re.match(r"[^(){}=!<>]* [-+*/]?= ", text)
    if assignment:  # what follows is aligned behind the sign
        start = assignment.end()
        if align + len(text) - start <= WIDTH:
            return [text[:start].rstrip(), " " * align + text[start:]]
        inner = _broken(text[start:], column + start, column + start)
        return [text[:start] + inner[0], *inner[1:]]
    places = list(_places(text))
    if not places:
        return [text]
    depth, binding = min((depth, binding) for _, depth, binding, _ in places)
    chosen = [(place, opened) for place, own, strength, opened in places if (own, strength) == (depth, binding)]
    opened = chosen[0][1]
    margin = align if opened is None else column + opened + 1
    cuts = [0, *(place for place, _ in chosen), len(text)]
    parts = [text[begin:end] for begin, end in pairwise(cuts)]
    one_each = any(part.startswith(".") for part in parts[1:])
    lines: list[str] = []
    line, at = "", column
    for place, part in enumerate(parts):
        is_last = place == len(parts) - 1
        if place and (one_each or at + len(line) + len(part.rstrip()) > WIDTH):
            lines.append(line.rstrip())
            line, at = "", margin
        begins = at + len(line)
        if begins + len(part.rstrip()) > WIDTH:
            inner = _broken(part if is_last else part.rstrip(), begins, margin)
            lines += [line + inner[0], *inner[1:-1]] if len(inner) > 1 else []
            line, at = (inner[-1] + ("" if is_last else " "), 0) if len(inner) > 1 else (line + part, at)
        else:
            line += part
    lines.append(line.rstrip())
    first, *others = lines
    return [first, *(own if own.startswith(" " * 8) else " " * margin + own for own in others)]


_STRENGTHS: Final = {",": 0, "?": 1, ":": 1, "||": 2, "&&": 3, "==": 4, "!=": 4, "<": 4, ">": 4, "<=": 4, ">=": 4}


def _places(text: str) -> Iterator[tuple[int, int, int, int | None]]:
    """Yield where a text may be broken: the place, how deep it nests, how strongly it binds, and the bracket around."""
    opened: list[int] = []
    for place, letter in enumerate(text):
        if letter in "([{":
            opened.append(place)
        elif letter in ")]}" and opened:
            opened.pop()
        around = opened[-1] if opened else None
        if letter == "," and text[place + 1 : place + 2] == " ":
            yield place + 2, len(opened), 0, around
        elif letter == " ":
            found = re.match(r" (\?|:|\|\||&&|==|!=|<=|>=|<|>|\+|-|\*|/|%|<<|>>|&|\||\^) ", text[place:])
            if found:
                yield place + 1, len(opened), _STRENGTHS.get(found[1], 6 if found[1] in "*/%" else 5), around
