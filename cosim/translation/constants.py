"""Constants of modules: where Python defines them, what is said of them there, and their definitions in C."""

from __future__ import annotations

import ast
import importlib.util
import linecache
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache

from cosim.translation.layout import INDENT, WIDTH, comment, wrapped
from cosim.translation.liveness import stored
from cosim.translation.python_function import comments_in
from cosim.translation.values import Value


@dataclass(frozen=True)
class Definition:
    """Where a constant is defined.

    Attributes
    ----------
    module, name : str
        The module, and the name there.
    line : int
        The line there; 0 if it is not found.
    remark : str
        The comment at its end.
    docstring : str
        The text behind it, or behind the definitions right below it.
    """

    module: str
    name: str
    line: int = 0
    remark: str = ""
    docstring: str = ""

    @property
    def short(self) -> str:
        """Module and name, without packages."""
        return f"{self.module.rsplit('.', 1)[-1]}_{self.name}"


@dataclass(frozen=True)
class Constant:
    """A constant in C: the expression that names it, and its definition."""

    value: Value
    text: str
    definition: Definition


def definition(module: str, file: str, name: str) -> Definition:
    """Return where a name of a module is defined, by way of imports."""
    seen = set()
    while (module, name) not in seen:
        seen.add((module, name))
        own, imported = _module(file)
        if name in own:
            return Definition(module, name, *own[name])
        level, origin, there = imported.get(name, (0, "", ""))
        package = getattr(sys.modules.get(module), "__package__", None) or module.rpartition(".")[0]
        with suppress(ImportError):  # beyond the outermost package
            origin = importlib.util.resolve_name("." * level + origin, package)
            other = getattr(sys.modules.get(origin), "__file__", None)
            if other:
                module, file, name = origin, other, there
    return Definition(module, name)


_Own = Mapping[str, tuple[int, str, str]]
_Imported = Mapping[str, tuple[int, str, str]]


@lru_cache(maxsize=256)
def _module(file: str) -> tuple[_Own, _Imported]:
    """Return line, remark and docstring of the names that a file assigns, and the origins of those it imports."""
    text = "".join(linecache.getlines(file))
    try:
        tree = ast.parse(text)
    except SyntaxError:
        return {}, {}
    remarks = comments_in(text)
    own: dict[str, tuple[int, str, str]] = {}
    imported: dict[str, tuple[int, str, str]] = {}
    group: set[str] = set()
    end = 0
    for statement in tree.body:
        match statement:
            case ast.Assign() | ast.AnnAssign():
                names = stored(statement.targets if isinstance(statement, ast.Assign) else [statement.target])
                group = group | names if statement.lineno == end + 1 else names
                remark, is_alone = remarks.get(statement.lineno, ("", False))
                own |= dict.fromkeys(names, (statement.lineno, "" if is_alone else remark, ""))
            case ast.Expr(value=ast.Constant(value=str() as docstring)):
                own |= {name: (*own[name][:2], docstring) for name in group}
                group = set()
            case _:
                group = set()
                if isinstance(statement, ast.ImportFrom):
                    origin = statement.level, statement.module or ""
                    imported |= {one.asname or one.name: (*origin, one.name) for one in statement.names}
        end = statement.end_lineno or 0
    return own, imported


def _lines(text: str) -> list[str]:
    """Return a definition in lines; a long array gets some for its numbers alone."""
    head, brace, numbers = text.partition("= {")
    if len(text) <= WIDTH or not brace:
        return [*wrapped(text, 0)]
    margin = " " * INDENT
    rows = textwrap.wrap(numbers.removesuffix("};"), WIDTH, initial_indent=margin, subsequent_indent=margin)
    return [head + brace, *rows, "};"]


def definitions_in_c(constants: Iterable[Constant]) -> Iterator[str]:
    """Yield the lines of the definitions: module by module, in Python's order and with what is said there."""
    by_module: dict[str, list[Constant]] = {}
    for constant in constants:
        by_module.setdefault(constant.definition.module, []).append(constant)
    for module, own in by_module.items():
        yield comment(f"Constants of {module}", 0)
        docstring = ""
        for constant in sorted(own, key=lambda constant: constant.definition.line):
            told = constant.definition
            if told.docstring and told.docstring != docstring:
                yield comment(told.docstring, 0)
            docstring = told.docstring
            lines = _lines(constant.text)
            if told.remark and (len(lines) > 1 or len(lines[0]) + len(told.remark) + 7 > WIDTH):
                yield comment(told.remark, 0)
            elif told.remark:
                lines[0] += f" {comment(told.remark, 0)}"
            yield from lines
        yield ""
