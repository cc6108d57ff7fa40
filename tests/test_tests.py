"""Every test checks something, whichever way it takes."""

import ast
import re
from collections.abc import Iterator, Set
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("cosim/tests", "tests", "plants/tests", "controllers/tests", "examples/*/tests")
FILES = sorted(path for folder in FOLDERS for path in ROOT.glob(f"{folder}/**/*.py"))
CHECKS = re.compile("raises|warns|check|check_.*|assert_.*")
"""Names of functions that check something: those of pytest, NumPy, xarray and our own."""


def statements(function: ast.FunctionDef) -> Iterator[ast.AST]:
    """Return the statements of a function, without the functions in it."""
    waiting: list[ast.AST] = list(function.body)
    while waiting:
        node = waiting.pop()
        if not isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Lambda):
            yield node
            waiting += ast.iter_child_nodes(node)


def functions(source: str) -> Iterator[ast.FunctionDef]:
    return (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef))


def is_check(node: ast.AST, helpers: Set[str]) -> bool:
    """Return whether a statement is an assertion, or calls a function that checks something."""
    if not isinstance(node, ast.Call):
        return isinstance(node, ast.Assert)
    if isinstance(node.func, ast.Name) and node.func.id in helpers:
        return True
    return CHECKS.fullmatch(getattr(node.func, "attr", getattr(node.func, "id", ""))) is not None


def checks(function: ast.FunctionDef, helpers: Set[str]) -> list[int]:
    """Return the lines in which a function checks something, itself or by a helper."""
    return [node.lineno for node in statements(function) if is_check(node, helpers)]


def faults(source: str, helpers: Set[str]) -> list[str]:
    """Return the faults of the tests in a file."""
    found = []
    for function in functions(source):
        if function.name.startswith("test_"):
            lines = checks(function, helpers)
            if not lines:
                found.append(f"{function.name} checks nothing")
            for node in statements(function):
                if isinstance(node, ast.Return) and all(line > node.lineno for line in lines):
                    found.append(f"{function.name} ends before it checks anything")
    return found


def helpers(source: str, known: frozenset[str] = frozenset()) -> set[str]:
    """Return the names of the functions in a file that check something, themselves or by one of those known."""
    return {
        function.name
        for function in functions(source)
        if any(checks(inner, known) for inner in ast.walk(function) if isinstance(inner, ast.FunctionDef))
    }


@pytest.fixture(scope="module")
def shared() -> frozenset[str]:
    """Return the helpers in the files beside the tests."""
    beside = [file.read_text(encoding="utf-8") for file in FILES if not file.name.startswith("test_")]
    return frozenset().union(*map(helpers, beside))


@pytest.mark.parametrize("file", FILES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_test_checks_something(file: Path, shared: frozenset[str]) -> None:
    source = file.read_text(encoding="utf-8")
    assert faults(source, shared | helpers(source, shared)) == []


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ("return", "test_it checks nothing"),
        ("helper()", ""),
        ("other()", "test_it checks nothing"),
        (
            "if x:\n        return\n    assert y",
            "test_it ends before it checks anything",
        ),
        ("assert y\n    if x:\n        return\n    assert z", ""),
        ("with pytest.raises(ValueError):\n        other()", ""),
        ("def inner():\n        return 1\n    assert inner()", ""),
        ("def inner():\n        assert y", "test_it checks nothing"),
    ],
)
def test_a_test_that_checks_nothing_is_found(body: str, fault: str) -> None:
    assert faults(f"def test_it():\n    {body}\n", {"helper"})[:1] == ([fault] if fault else [])
