"""Functions that a model calls more than once, or several of one angle: in C each is computed once."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import sympy

from plants.ode import RESERVED, OdeModel, Term

Result = tuple[str, sympy.Expr, str]
"""Index in the array of results, expression and comment."""

_OF_AN_ANGLE = {sympy.sin: "sin", sympy.cos: "cos", sympy.tan: "tan"}
_TOGETHER = (("sin", "cos"), ("sin", "cos", "tan"))
"""The functions of `plants.elementary` that return several at once, by what they return."""

_LONG = 32
"""A name of so many letters is too long: C tells names apart by the first 31."""


@dataclass(frozen=True)
class Call:
    """One call that returns several functions of an angle.

    Attributes
    ----------
    name
        Of what it returns.
    functions
        What that is, in order: one of `_TOGETHER`.
    angle
        The argument.
    """

    name: str
    functions: tuple[str, ...]
    angle: sympy.Expr

    @property
    def function(self) -> str:
        """The function of `plants.elementary` that is called."""
        return "_".join(self.functions)


def together(model: OdeModel, terms: Sequence[Term]) -> dict[sympy.Symbol, tuple[Call, int]]:
    """Return for each term that is one of several functions of the same angle their call, and its place there."""
    taken = _taken(model, terms)
    of_angles = defaultdict[sympy.Expr, dict[sympy.Symbol, str]](dict)
    for term in terms:
        if (function := _OF_AN_ANGLE.get(term.expression.func)) is not None:
            of_angles[term.expression.args[0]][term.symbol] = function
    found = {}
    for angle, functions in of_angles.items():
        call = Call(_name(f"of {angle}"), next(own for own in _TOGETHER if {*functions.values()} <= {*own}), angle)
        if len(functions) > 1 and call.name not in taken and len(call.name) < _LONG:
            taken.add(call.name)
            found.update({symbol: (call, call.functions.index(own)) for symbol, own in functions.items()})
    return found


def share_functions(model: OdeModel, terms: Sequence[Term], lines: Sequence[Result]) -> tuple[list[Term], list[Result]]:
    """Give a name to each function that is called more than once, such as cos(psi), and to several of one angle."""
    uses, branches = Counter[sympy.Expr](), sympy.Dummy()
    for expression in (*(term.expression for term in terms), *(expression for _, expression, _ in lines)):
        # An expression in a branch is evaluated only if chosen: leave it there.
        outside = expression.replace(lambda e: isinstance(e, sympy.Piecewise), lambda _: branches)
        for e in sympy.preorder_traversal(outside):
            if isinstance(e, sympy.Function):
                uses[e] += 1
            elif e.is_Pow and e.exp.is_Integer and isinstance(e.base, sympy.Function):
                uses[e.base] += 1
    already = {term.expression for term in terms}
    taken = _taken(model, terms)
    angles = Counter(f.args[0] for f in uses if f.func in _OF_AN_ANGLE)
    names: dict[sympy.Expr, sympy.Symbol] = {}
    for function in sorted((f for f in uses if f not in already), key=str):
        if uses[function] == 1 and not (function.func in _OF_AN_ANGLE and angles[function.args[0]] > 1):
            continue
        name = _name(str(function))
        if name not in taken and len(name) < _LONG:
            taken.add(name)
            names[function] = sympy.Symbol(name, real=True)

    shared: list[Term] = []
    waiting = dict(names)

    def share(expression: sympy.Expr) -> sympy.Expr:
        for function in sorted((f for f in waiting if expression.has(f)), key=str):
            if function in waiting:
                symbol = waiting.pop(function)
                shared.append(Term(symbol, function.func(*(share(argument) for argument in function.args))))
        return expression.xreplace(names)

    for term in terms:
        expression = share(term.expression)
        shared.append(Term(term.symbol, expression, term.unit, term.equation))
    results = [(index, share(expression), comment) for index, expression, comment in lines]
    return shared, results


def _name(text: str) -> str:
    """Return a name made of the words of a text."""
    return "_".join("".join(c if c.isalnum() else " " for c in text).split())


def _taken(model: OdeModel, terms: Sequence[Term]) -> set[str]:
    """Return the names that others have in a function of C with these terms."""
    taken = {symbol.name for term in terms for symbol in (term.symbol, *term.expression.free_symbols)}
    taken |= {v.name for v in (*model.states, *model.inputs, *model.parameters)} | RESERVED
    return taken | {f"{enumeration.name}_{item}" for enumeration in model.enumerations for item in enumeration.items}
