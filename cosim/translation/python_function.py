"""The text of a Python function: its syntax tree, its comments, and the places of its lines."""

from __future__ import annotations

import ast
import inspect
import io
import textwrap
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
        Its syntax tree; line 1 is the first of `lines`.
    lines : tuple of str
        Its lines, decorators included.
    comments : mapping
        The comment on each line that has one, and whether it has the line for itself.
    file, first_line
        Where it stands.
    """

    function: FunctionType
    tree: ast.FunctionDef
    lines: tuple[str, ...]
    comments: Mapping[int, tuple[str, bool]]
    file: str
    first_line: int

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
        return Location(self.file, self.first_line + getattr(node, "lineno", 1) - 1)

    def refuse(self, node: ast.AST, message: str) -> NoReturn:
        """Raise `Untranslatable` for a node, with the text of its line."""
        line = self.lines[getattr(node, "lineno", 1) - 1].strip()
        raise Untranslatable(message, self.where(node), line)


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
        If it has none, or is not made by ``def``.
    """
    place = Location(function.__code__.co_filename, function.__code__.co_firstlineno)
    try:
        lines, first = inspect.getsourcelines(function.__code__)  # not the function that a decorator has wrapped
    except (OSError, TypeError):
        raise Untranslatable(f"the text of {function.__qualname__} is not to be found", place) from None
    text = textwrap.dedent("".join(lines))
    try:
        node = ast.parse(text).body[0]
    except SyntaxError:
        node = ast.Pass()
    if not isinstance(node, ast.FunctionDef):
        raise Untranslatable("only a function that is written with def is translated", place, lines[0].strip())
    if not _is_text_of(node, function):
        raise Untranslatable(
            f"the text of {function.__qualname__} has changed since it was imported: start Python anew", place
        )
    return PythonFunction(
        function, node, tuple(text.splitlines()), comments_in(text), function.__code__.co_filename, max(first, 1)
    )


def _is_text_of(node: ast.FunctionDef, function: FunctionType) -> bool:
    """Tell whether a function was compiled from a text, by its names and constants.

    The bytecode depends on the text around; of a function within a class or a function its own name alone counts.
    """
    own = function.__code__
    if node.name != own.co_name:
        return False
    if own.co_freevars or "." in function.__qualname__:
        return True
    alone = ast.FunctionDef(**{field: getattr(node, field) for field in node._fields} | {"decorator_list": []})
    module = ast.Module([ast.fix_missing_locations(ast.copy_location(alone, node))], [])
    code = compile(module, own.co_filename, "exec", dont_inherit=True)
    again = next(part for part in code.co_consts if isinstance(part, CodeType) and part.co_name == node.name)
    return _words_of(again) == _words_of(own)


def _words_of(code: CodeType) -> tuple[object, ...]:
    constants = [constant for constant in code.co_consts if not isinstance(constant, CodeType)]
    return code.co_varnames, code.co_names, constants


def comments_in(text: str) -> dict[int, tuple[str, bool]]:
    """Return the comment on each line that has one, and whether it has the line for itself."""
    found = {}
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            own_line = not token.line[: token.start[1]].strip()
            words = token.string.lstrip("#").strip()
            if words and not words.startswith(("noqa", "type:", "mypy:", "pragma:")):
                found[token.start[0]] = words, own_line
    return found
