"""Which names are still needed behind a statement: Python's names outlive a block, those of C do not."""

from __future__ import annotations

import ast
from collections.abc import Sequence


def stored(nodes: Sequence[ast.AST]) -> set[str]:
    """Return the names that are assigned within nodes."""
    return {
        name.id
        for node in nodes
        for name in ast.walk(node)
        if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store)
    }


def times_stored(nodes: Sequence[ast.AST], name: str) -> int:
    """Return how often a name is assigned within nodes."""
    return sum(
        isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id == name
        for outer in nodes
        for node in ast.walk(outer)
    )


def loaded(nodes: Sequence[ast.AST]) -> set[str]:
    """Return the names that are read within nodes; what ``+=`` changes is read, too."""
    found = set()
    for outer in nodes:
        for node in ast.walk(outer):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
                found.add(node.id)
            elif isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Name):
                found.add(node.target.id)
    return found


def needed(statements: Sequence[ast.stmt], behind: set[str], around: set[str]) -> set[str]:
    """Return the names that are needed before statements.

    Parameters
    ----------
    statements
        The statements.
    behind
        The names that are needed behind them.
    around
        Those that are needed where ``break`` and ``continue`` lead to.
    """
    names = set(behind)
    for statement in reversed(statements):
        names = _before(statement, names, around)
    return names


def needed_in_loop(loop: ast.For | ast.While, behind: set[str]) -> set[str]:
    """Return the names that are needed at the head of a loop, before it decides whether to go on."""
    head = {loop.target.id} if isinstance(loop, ast.For) and isinstance(loop.target, ast.Name) else set()
    test = loaded([loop.test]) if isinstance(loop, ast.While) else set()
    names = behind | test
    while True:
        more = names | (needed(loop.body, names, names) - head)
        if more == names:
            return names
        names = more


def _before(statement: ast.stmt, behind: set[str], around: set[str]) -> set[str]:
    match statement:
        case ast.If():
            branches = needed(statement.body, behind, around) | needed(statement.orelse, behind, around)
            return branches | loaded([statement.test])
        case ast.For():
            return needed_in_loop(statement, behind) | loaded([statement.iter])
        case ast.While():
            return needed_in_loop(statement, behind)
        case ast.Return():
            return loaded([statement])
        case ast.Break() | ast.Continue():
            return behind | around
        case _:
            plain = {
                name.id
                for target in getattr(statement, "targets", [getattr(statement, "target", None)])
                if not isinstance(statement, ast.AugAssign)
                for name in (target.elts if isinstance(target, ast.Tuple) else [target])
                if isinstance(name, ast.Name)
            }
            return (behind - plain) | loaded([statement])


def ends(statements: Sequence[ast.stmt]) -> bool:
    """Tell whether nothing behind statements is reached from them."""
    if not statements:
        return False
    last = statements[-1]
    if isinstance(last, ast.Return | ast.Break | ast.Continue):
        return True
    return isinstance(last, ast.If) and ends(last.body) and ends(last.orelse)


def returns(statements: Sequence[ast.stmt]) -> bool:
    """Tell whether statements always end with a ``return``."""
    if not statements:
        return False
    last = statements[-1]
    return isinstance(last, ast.Return) or (isinstance(last, ast.If) and returns(last.body) and returns(last.orelse))
