"""The text of a Python function: its syntax tree, its comments, and the places of its lines."""

from __future__ import annotations

import ast
import inspect
import io
import tokenize
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import CodeType, FunctionType
from typing import Any, Final, NoReturn

from cosim.errors import Location
from cosim.translation.refusal import Untranslatable


@dataclass(frozen=True)
class PythonFunction:
    """A function's text.

    Attributes
    ----------
    function : callable
        The plain function, without a compiler's wrapper.
    tree : FunctionDef
        Its syntax tree.
    lines : tuple of str
        The lines of its file.
    comments : mapping
        The comment on each line of the file that has one, and whether it has the line for itself.
    file : str
        The file.
    """

    function: FunctionType
    tree: ast.FunctionDef
    lines: tuple[str, ...]
    comments: Mapping[int, tuple[str, bool]]
    file: str

    @property
    def name(self) -> str:
        """Module and name, as a C identifier begins with it."""
        return f"{self.function.__module__.rsplit('.', 1)[-1]}_{self.function.__name__}"

    @property
    def body(self) -> list[ast.stmt]:
        """Its statements without the docstring."""
        return self.tree.body[1:] if self.docstring is not None else self.tree.body

    @property
    def docstring(self) -> str | None:
        """Its docstring."""
        return ast.get_docstring(self.tree)

    def where(self, node: ast.AST) -> Location:
        """Return the place of a node."""
        return Location(self.file, getattr(node, "lineno", self.tree.lineno))

    def refuse(self, node: ast.AST, message: str) -> NoReturn:
        """Raise `Untranslatable` for a node, with the text of its line."""
        where = self.where(node)
        raise Untranslatable(message, where, self.lines[where.line - 1].strip())


def plain(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return the plain function that Numba has compiled, or the function itself."""
    return getattr(function, "py_func", function)


def is_inexact(function: Callable[..., Any]) -> bool:
    """Tell whether Numba compiles a function with licence to round otherwise."""
    return bool(getattr(function, "targetoptions", {}).get("fastmath"))


INEXACT: Final = "with fastmath, a compiler rounds as it likes: compile the function without"


@lru_cache(maxsize=1024)
def python_function(function: FunctionType) -> PythonFunction:
    """Read the text of a plain function.

    Raises
    ------
    Untranslatable
        If it has none, if the text has changed since, or if it is not made by ``def``.
    """
    code = function.__code__  # not the function that a decorator has wrapped
    place = Location(code.co_filename, code.co_firstlineno)
    try:
        lines, _ = inspect.findsource(code)
    except (OSError, TypeError):
        raise Untranslatable(f"the text of {function.__qualname__} is not to be found", place) from None
    text = "".join(lines)
    definitions = _definitions(text, code.co_filename)
    if code not in definitions:
        raise Untranslatable(
            f"the text of {function.__qualname__} has changed since it was imported: start Python anew", place
        )
    node = definitions[code]
    if node is None:
        line = lines[code.co_firstlineno - 1].strip()
        raise Untranslatable("only a function that is written with def is translated", place, line)
    return PythonFunction(function, node, tuple(lines), comments_in(text), code.co_filename)


@lru_cache(maxsize=64)
def _definitions(text: str, file: str) -> Mapping[CodeType, ast.FunctionDef | None]:
    """Return what Python compiles a file to, each with its ``def`` where it has one.

    Equal code has the same instructions, names, constants (-0.0 is not 0.0) and first line.
    """
    try:
        tree = ast.parse(text)
        codes = [compile(tree, file, "exec", dont_inherit=True)]
    except (SyntaxError, ValueError):
        return {}
    for code in codes:
        codes += [part for part in code.co_consts if isinstance(part, CodeType)]
    nodes = {
        (node.name, node.decorator_list[0].lineno if node.decorator_list else node.lineno): node
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
    }
    return {code: nodes.get((code.co_name, code.co_firstlineno)) for code in codes}


@lru_cache(maxsize=64)
def comments_in(text: str) -> Mapping[int, tuple[str, bool]]:
    """Return the comment on each line that has one, and whether it has the line for itself."""
    found = {}
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            own_line = not token.line[: token.start[1]].strip()
            words = token.string.lstrip("#").strip()
            if words and not words.startswith(("noqa", "type:", "mypy:", "pragma:")):
                found[token.start[0]] = words, own_line
    return found
