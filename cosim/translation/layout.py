"""C code as a tree of lines, and its text: indented, wrapped and without names that nobody uses."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, field
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
    """

    text: str
    declares: str = ""


@dataclass
class Compound:
    """A statement with blocks: for each its head, such as ``for (...)``."""

    parts: list[tuple[str, Block]]


@dataclass
class Block:
    """Statements, one after the other."""

    items: list[Line | Compound] = field(default_factory=list)

    def add(self, text: str, declares: str = "") -> Line:
        """Add a statement."""
        line = Line(text, declares)
        self.items.append(line)
        return line

    def without_unused(self) -> Block:
        """Return the block without declarations of names that are not used in it."""
        kept: list[Line | Compound] = []
        later: set[str] = set()
        for item in reversed(self.items):
            if isinstance(item, Line) and item.declares and item.declares not in later:
                continue
            if isinstance(item, Compound):
                item = Compound([(head, block.without_unused()) for head, block in item.parts])
            later.update(_words(item))
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
    """Yield a statement in lines that are broken where it nests least, aligned behind the bracket that is open."""
    if text.startswith("/* ") and text.endswith(" */"):
        yield from comment(text[3:-3], indent).splitlines()
        return
    margin = " " * indent
    line = margin
    opened: list[int] = []
    for piece in _pieces(text):
        if len(line.rstrip()) + len(piece.rstrip()) > WIDTH and line.strip():
            yield line.rstrip()
            line = " " * (opened[-1] if opened else indent + INDENT)
        for letter in piece:
            line += letter
            if letter in "([{":
                opened.append(len(line))
            elif letter in ")]}" and opened:
                opened.pop()
    yield line.rstrip()


def _pieces(text: str) -> list[str]:
    """Return the parts of a statement between which a line may be broken."""
    pattern = r"(?<=, )|(?= (?:\+|-|\*|/|&&|\|\||\?|:|<|>|<=|>=|==|!=|&|\||\^) )|(?<=[^=!<>] = )"
    pieces = [part for part in re.split(pattern, text) if part]
    return [piece.lstrip(" ") if place and piece.startswith(" ") else piece for place, piece in _spaced(pieces)]


def _spaced(pieces: list[str]) -> list[tuple[int, str]]:
    """Move the blank before an operator to the end of the piece before it."""
    moved = [
        piece + (" " if place + 1 < len(pieces) and pieces[place + 1].startswith(" ") else "")
        for place, piece in enumerate(pieces)
    ]
    return list(enumerate(moved))
