"""The exact partial derivatives of a model, by the chain rule through its named terms.

Each term's derivative gets a name of its own, such as d_M2_11_d_gamma, so that the C code stays as short and as
readable as the model is.
"""

from collections.abc import Iterable, Set
from dataclasses import dataclass

import sympy
from sympy import Abs, Max, Min, Mod, Piecewise, sinc
from sympy.codegen.cfunctions import Cbrt

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
    switched: set[sympy.Symbol] = set()

    def total(expression: sympy.Expr, known: str) -> sympy.Expr:
        result = sympy.Integer(0)
        for symbol in sorted(expression.free_symbols, key=str):
            if (symbol, known) in chain:
                partial = _partial(model, expression, symbol).xreplace(functions)
                result += _product(partial, symbol, chain[symbol, known], switched)
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
                if _is_switched(derivative, switched):
                    switched.add(derivatives[-1].symbol)
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
    """Differentiate; functions with steps or kinks have the derivative that they have beside them."""
    derivative = _derivative(expression, symbol)
    if derivative.has(sympy.Derivative, sympy.Subs):
        raise ModelError(
            f"model {model.name!r}: {expression} has no derivative with respect to {symbol} that could be written in C"
        )
    return derivative


def _derivative(expression: sympy.Expr, symbol: sympy.Symbol) -> sympy.Expr:
    """Differentiate by the chain rule through the outermost functions that SymPy cannot differentiate as we need."""
    inner = {part: sympy.Dummy(real=True) for part in _outermost(expression)}
    outer = expression.xreplace(inner)
    result = outer.diff(symbol)
    for part, name in inner.items():
        if symbol in part.free_symbols:
            result += _product(outer.diff(name), name, _derivative_of_part(part, symbol))
    result = result.xreplace({name: _beside(part, symbol) for part, name in inner.items()})
    return result.xreplace({sympy.zoo: sympy.oo})  # SymPy moves an outer power into branches, of which one may be zero


STEPS = (sympy.floor, sympy.ceiling, sympy.sign, sympy.Heaviside)


def _beside(part: sympy.Expr, symbol: sympy.Symbol) -> sympy.Expr:
    """Return a step without the value that it has at the very point where it steps, if the symbol moves it."""
    if isinstance(part, (sympy.sign, sympy.Heaviside)) and symbol in part.free_symbols:
        return Piecewise((-1 if isinstance(part, sympy.sign) else 0, part.args[0] < 0), (1, True))
    return part


def _outermost(expression: sympy.Expr) -> list[sympy.Expr]:
    parts: dict[sympy.Expr, None] = {}
    walk = sympy.preorder_traversal(expression)
    for part in walk:
        is_cube_root = part.is_Pow and abs(part.exp) == sympy.Rational(1, 3)
        if is_cube_root or isinstance(part, (*STEPS, Abs, Max, Min, Mod, Piecewise, Cbrt, sinc)):
            parts[part] = None
            walk.skip()
    return list(parts)


def _derivative_of_part(part: sympy.Expr, symbol: sympy.Symbol) -> sympy.Expr:
    if isinstance(part, STEPS):
        return sympy.Integer(0)
    if isinstance(part, Piecewise):
        return Piecewise(*((_derivative(value, symbol), condition) for value, condition in part.args))
    first, *others = part.args
    derivative = _derivative(first, symbol)
    if isinstance(part, Abs):
        return Piecewise((-derivative, first < 0), (derivative, True))
    if isinstance(part, Mod):
        return derivative - (first - part) / others[0] * _derivative(others[0], symbol)
    if isinstance(part, sinc):
        slope = (first * sympy.cos(first) - sympy.sin(first)) / first**2
        return Piecewise((slope, first**2 > 0), (0, True)) * derivative
    if isinstance(part, (Max, Min)):
        rest = part.func(*others)
        is_first = first > rest if isinstance(part, Max) else first < rest
        return Piecewise((derivative, is_first), (_derivative(rest, symbol), True))
    # SymPy's own derivative of the cube root is a power with a broken exponent, which a negative number does not have.
    is_inverse = part.is_Pow and part.exp < 0
    slope = -1 / (3 * Cbrt(first) ** 4) if is_inverse else 1 / (3 * Cbrt(first) ** 2)
    return _product(slope, symbol, derivative)


def _product(
    partial: sympy.Expr, by: sympy.Symbol, derivative: sympy.Expr, switched: Set[sympy.Symbol] = frozenset()
) -> sympy.Expr:
    """Multiply a partial derivative by the derivative of what it was taken by, for the chain rule.

    Where a branch makes the second one zero, so is the product, though the first one may be infinite there, as that of
    sqrt(Max(x, 0)) is where x is negative. ``switched`` are named derivatives with such a branch.
    """
    if all(by not in p.free_symbols or (p.exp.is_Integer and p.exp > 0) for p in partial.atoms(sympy.Pow)):
        return partial * derivative
    if isinstance(derivative, Piecewise) and _is_switched(derivative, switched):
        return Piecewise(*((_product(partial, by, value, switched), condition) for value, condition in derivative.args))
    if _is_switched(derivative, switched):
        return Piecewise((0, sympy.Eq(derivative, 0)), (partial * derivative, True))
    return partial * derivative


def _is_switched(derivative: sympy.Expr, switched: Set[sympy.Symbol]) -> bool:
    """Tell whether a branch makes a derivative exactly zero, rather than the values of the states."""
    if isinstance(derivative, Piecewise):
        return any(value == 0 or _is_switched(value, switched) for value, _ in derivative.args)
    if isinstance(derivative, (Max, Min)):
        return any(value == 0 or _is_switched(value, switched) for value in derivative.args)
    if derivative.is_Pow and derivative.exp.is_positive:
        return _is_switched(derivative.base, switched)
    if derivative.is_Mul:
        return any(_is_switched(part, switched) for part in derivative.args)
    if derivative.is_Add:
        return all(_is_switched(part, switched) for part in derivative.args)
    return derivative in switched
