"""Exact partial derivatives of a model, by the chain rule through its named terms."""

from collections.abc import Iterable, Sequence

import sympy

from plants.ode import OdeModel, Term


def differentiate(
    model: OdeModel, unknowns: Sequence[sympy.Expr], knowns: Iterable[sympy.Symbol]
) -> tuple[tuple[Term, ...], sympy.Matrix]:
    """Differentiate expressions in a model's symbols and terms with respect to some of its variables.

    Parameters
    ----------
    model
        The model whose terms the expressions use.
    unknowns
        The expressions to differentiate.
    knowns
        Symbols of states, inputs or parameters, or the time.

    Returns
    -------
    terms
        The terms that the result needs, each after those it uses: the model's own, and their derivatives, named
        ``d_term_d_known``. Derivatives that vanish have no term.
    jacobian
        The partial derivatives, (unknowns, knowns), in those terms.
    """
    knowns = tuple(knowns)
    rates: dict[sympy.Symbol, dict[sympy.Symbol, sympy.Expr]] = {}
    terms: list[Term] = []

    def derivative(expression: sympy.Expr, known: sympy.Symbol) -> sympy.Expr:
        inner = (expression.diff(s) * rates[s].get(known, 0) for s in expression.free_symbols if s in rates)
        return sympy.Add(expression.diff(known), *inner)

    for term in model.terms_of(unknowns):
        terms.append(term)
        rates[term.symbol] = {}
        for known in knowns:
            rate = derivative(term.expression, known)
            if rate.is_number:
                rates[term.symbol][known] = rate
            else:
                symbol = sympy.Symbol(f"d_{term.symbol}_d_{known}", real=True)
                terms.append(Term(symbol, rate))
                rates[term.symbol][known] = symbol
    jacobian = sympy.Matrix(len(unknowns), len(knowns), lambda i, j: derivative(unknowns[i], knowns[j]))
    return tuple(terms), jacobian
