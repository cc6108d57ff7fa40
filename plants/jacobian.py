"""The exact partial derivatives of a model, by the chain rule through its named terms.

Each term's derivative gets a name of its own, such as d_M2_11_d_gamma, so that the C code stays as short and as
readable as the model is.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import sympy

from plants import units
from plants.errors import ModelError
from plants.ode import TIME, OdeModel, Term


@dataclass(frozen=True)
class Partial:
    """The partial derivative of an unknown with respect to a known, where it is not zero."""

    unknown: str
    known: str
    expression: sympy.Expr
    unit: str


@dataclass(frozen=True)
class Jacobian:
    """Partial derivatives, and the terms that they are stated in: the model's own, then their derivatives."""

    terms: tuple[Term, ...]
    partials: tuple[Partial, ...]


def differentiate(model: OdeModel, unknowns: Iterable[tuple[str, sympy.Expr, str]], knowns: Iterable[str]) -> Jacobian:
    """Differentiate expressions with respect to declared symbols.

    Parameters
    ----------
    model
        The model whose terms the expressions use.
    unknowns
        Name, expression and unit of each unknown.
    knowns
        Names of states, inputs and real parameters, or ``time``.

    Raises
    ------
    ModelError
        An expression has no derivative that could be written down.
    """
    # The functions are differentiated as real functions, independently of the assumptions of their symbols.
    variables = (*model.states, *model.inputs, *model.reals)
    symbols = {variable.symbol for variable in variables} | {term.symbol for term in model.terms}
    real = {symbol: sympy.Symbol(symbol.name, real=True) for symbol in symbols}
    real |= {e.symbol: sympy.Symbol(e.name, integer=True) for e in model.enumerations}
    unit_of = {variable.name: units.parse(variable.unit) for variable in variables} | {TIME.name: units.parse("s")}
    taken = {symbol.name for symbol in symbols} | {enumeration.name for enumeration in model.enumerations}

    stated = list(unknowns)
    terms = [
        Term(real[term.symbol], term.expression.xreplace(real), term.unit, term.equation)
        for term in model.terms_of(expression for _, expression, _ in stated)
    ]
    functions = {term.expression: term.symbol for term in terms if isinstance(term.expression, sympy.Function)}
    known_symbols = {name: TIME if name == TIME.name else sympy.Symbol(name, real=True) for name in knowns}

    # The derivative of each symbol with respect to each known, where it is not zero.
    chain = {(symbol, name): sympy.Integer(1) for name, symbol in known_symbols.items()}
    derivatives: list[Term] = []

    def total(expression: sympy.Expr, known: str) -> sympy.Expr:
        result = sympy.Integer(0)
        for symbol in sorted(expression.free_symbols, key=str):
            if (symbol, known) in chain:
                result += _partial(model, expression, symbol).xreplace(functions) * chain[symbol, known]
        return result

    for term in terms:
        for known in known_symbols:
            derivative = total(term.expression, known)
            if derivative == 0:
                continue
            if not (derivative.is_number or derivative.is_Symbol):
                name = _free_name(f"d_{term.symbol.name}_d_{known}", taken)
                unit = str(units.parse(term.unit) / unit_of[known])
                derivatives.append(Term(sympy.Symbol(name, real=True), derivative, unit))
                derivative = derivatives[-1].symbol
            chain[term.symbol, known] = derivative

    partials = [
        Partial(name, known, derivative, str(units.parse(unit) / unit_of[known]))
        for name, expression, unit in stated
        for known in known_symbols
        if (derivative := total(expression.xreplace(real), known)) != 0
    ]
    return Jacobian((*terms, *derivatives), tuple(partials))


def _free_name(name: str, taken: set[str]) -> str:
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def _partial(model: OdeModel, expression: sympy.Expr, symbol: sympy.Symbol) -> sympy.Expr:
    """Differentiate; functions with steps or kinks have the derivative that they have between them."""
    expression = expression.replace(sympy.Mod, lambda a, b: a - b * sympy.floor(a / b))
    steps = expression.atoms(sympy.floor, sympy.ceiling, sympy.sign, sympy.Heaviside)
    constants = {step: sympy.Dummy(real=True) for step in sorted(steps, key=str)}
    derivative = expression.xreplace(constants).diff(symbol).xreplace({c: step for step, c in constants.items()})
    derivative = derivative.replace(
        lambda e: isinstance(e, sympy.Heaviside), lambda e: sympy.Piecewise((0, e.args[0] < 0), (1, True))
    )
    if derivative.has(sympy.Derivative, sympy.Subs):
        raise ModelError(
            f"model {model.name!r}: {expression} has no derivative with respect to {symbol} that could be written in C"
        )
    return derivative
