"""Short forms of expressions in sines, cosines and tangents, such as a reduction of dynamics leaves behind."""

from collections import defaultdict
from collections.abc import Sequence

import sympy


def shorten(expression: sympy.Expr) -> sympy.Expr:
    """Return a short form of a rational function of trigonometric functions, branch by branch if it is piecewise.

    With sin^2 + cos^2 = 1 the coefficient of every other factor becomes as short as it can; where a cosine divides,
    its sine becomes a tangent. On such expressions it is much faster than `sympy.simplify`, and finds shorter forms.
    """
    expression = sympy.piecewise_fold(sympy.sympify(expression))
    if isinstance(expression, sympy.Piecewise):
        return sympy.Piecewise(*((shorten(branch), condition) for branch, condition in expression.args))
    expression = sympy.expand_trig(expression.replace(sympy.tan, lambda angle: sympy.sin(angle) / sympy.cos(angle)))
    functions = sorted(expression.atoms(sympy.sin, sympy.cos), key=str)
    numerator, denominator = sympy.fraction(sympy.cancel(expression))
    tangents = {sympy.sin(*f.args): sympy.tan(*f.args) * f for f in denominator.atoms(sympy.cos)}

    coefficients = defaultdict[sympy.Expr, sympy.Expr](lambda: sympy.S.Zero)
    for term in _summands(numerator):
        factor, coefficient = term.as_independent(*functions, as_Add=False)
        number, factor = factor.as_coeff_Mul()  # 2 m sin^2 belongs to m cos^4
        coefficients[factor] += number * coefficient
    # Terms over the same power of a cosine belong together.
    groups = defaultdict[sympy.Expr, sympy.Expr](lambda: sympy.S.Zero)
    for factor, coefficient in coefficients.items():
        for summand in _summands(factor * _fewest(coefficient, functions).xreplace(tangents) / denominator):
            term = sympy.cancel(summand)
            groups[sympy.denom(term).as_independent(*functions, as_Add=False)[1]] += term

    total = sympy.Add(*groups.values())
    forms = [
        total,
        sympy.factor(total),
        sympy.Add(*(sympy.factor_terms(_collect(group)) for group in groups.values())),
    ]
    return min(forms, key=lambda form: form.count_ops())


def _fewest(polynomial: sympy.Expr, functions: Sequence[sympy.Expr]) -> sympy.Expr:
    """Replace sin^2 by 1 - cos^2, or the reverse, as long as that leaves fewer summands."""
    partner = {sympy.sin: sympy.cos, sympy.cos: sympy.sin}
    while True:
        forms = [polynomial]
        for f in functions:
            one = f**2 + partner[f.func](*f.args) ** 2
            forms.append(sympy.expand(sympy.rem(polynomial, one - 1, f)))
        best = min(forms, key=lambda form: len(_summands(form)))
        if best == polynomial:
            return polynomial
        polynomial = best


def _collect(expression: sympy.Expr) -> sympy.Expr:
    return sympy.collect(expression, sorted(expression.atoms(sympy.Function), key=str))


def _summands(expression: sympy.Expr) -> tuple[sympy.Expr, ...]:
    return tuple(sympy.Add.make_args(sympy.expand(expression)))
