"""How expressions, in C as in Python, call functions whose bits are the same on every machine."""

import ast
import builtins
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import sympy
from sympy.printing.precedence import precedence

from plants import elementary, logarithms
from plants.errors import ModelError
from plants.ode import TIME, OdeModel, Term

OWN_FUNCTIONS = {
    **{name: name for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "hypot")},
    **{name: name for name in ("sinh", "cosh", "tanh", "asinh", "acosh", "atanh")},
    **{name: name for name in ("exp", "expm1", "log", "log1p", "log2", "log10")},
    "Cbrt": "cbrt",
    "Max": "larger",
    "Min": "smaller",
}
"""Functions of SymPy, and their names in `plants.elementary` and `plants.logarithms`. Others, such as erf, come
from a C library."""


class Printing:
    """A printer's way with powers, and with functions that others print otherwise.

    Powers are products where the exponent is a small whole number, else functions of our own.
    """

    own_prefix = ""

    def _print_Pow(self: Any, expression: sympy.Pow, **_: Any) -> str:
        base, exponent = expression.args
        if exponent.is_Integer and 2 <= exponent <= 4:
            return f"({'*'.join([self.parenthesize(base, precedence(expression))] * int(exponent))})"
        if exponent.is_Integer and -4 <= exponent <= -2:
            return f"1.0/{self._print(sympy.Pow(base, -exponent, evaluate=False))}"
        if exponent in (-1, sympy.S.Half):
            return str(super()._print_Pow(expression))  # type: ignore[misc]
        if exponent == sympy.Rational(1, 3):
            return f"{self.own_prefix}cbrt({self._print(base)})"
        if exponent == -sympy.Rational(1, 3):
            return f"1.0/{self.own_prefix}cbrt({self._print(base)})"
        return f"{self.own_prefix}pow({self._print(base)}, {self._print(exponent)})"

    def _print_exp2(self: Any, expression: sympy.Expr) -> str:
        return f"{self.own_prefix}pow(2.0, {self._print(expression.args[0])})"

    def _print_Max(self: Any, expression: sympy.Max) -> str:
        return self._nested("larger", expression.args)  # type: ignore[no-any-return]

    def _print_Min(self: Any, expression: sympy.Min) -> str:
        return self._nested("smaller", expression.args)  # type: ignore[no-any-return]

    def _nested(self: Any, function: str, arguments: Sequence[sympy.Expr]) -> str:
        """Return a call of a function of two numbers for more of them, halved so that few parentheses are nested.

        The order of the calls does not change a bit: the value is the last of the largest, NaN only if all are NaN.
        """
        if len(arguments) == 1:
            return str(self._print(arguments[0]))
        middle = len(arguments) // 2
        halves = (self._nested(function, half) for half in (arguments[:middle], arguments[middle:]))
        return f"{self.own_prefix}{function}({', '.join(halves)})"


class PythonPrinting(Printing):
    """A printer's way with Python: symbols have a prefix that no function has, and numbers have all of their digits."""

    def _print_Symbol(self, symbol: sympy.Symbol) -> str:
        return f"symbol_{symbol.name}"

    def _print_Float(self, value: sympy.Float) -> str:
        return repr(float(value))

    _print_NumberSymbol = _print_Pi = _print_Exp1 = _print_Float


def python_function(
    model: OdeModel,
    expressions: Iterable[sympy.Expr],
    terms: Iterable[Term],
    printer: PythonPrinting,
    functions: Mapping[str, Any],
) -> Callable[..., list[Any]]:
    """Return a function of the time and sequences of states, inputs and parameters that returns values of expressions.

    SymPy's `lambdify` takes symbols by their own names, which may be those of functions.

    Parameters
    ----------
    model
        The model that declares the symbols.
    expressions, terms
        What is computed, and the named terms that it needs, in order.
    printer
        A printer of SymPy for Python.
    functions
        The functions, by the names that the printer gives them.

    Raises
    ------
    ModelError
        Python has no such function, or an expression is nested too deep for it.
    """
    text: Callable[[sympy.Expr], str] = printer.doprint  # type: ignore[attr-defined]

    def written(expression: sympy.Expr) -> str:
        try:
            line = text(expression)
            parts = ast.walk(ast.parse(line, mode="eval"))
        except NotImplementedError:  # the printer knows no way to write it
            missing = {type(part).__name__ for part in sympy.preorder_traversal(expression)} - {"Symbol"}
            raise _lacks(model, expression, missing if len(missing) == 1 else set()) from None
        except (SyntaxError, RecursionError, MemoryError):
            raise _too_deep(model) from None
        names = [node for node in parts if isinstance(node, ast.Name)]
        bound = {node.id for node in names if isinstance(node.ctx, ast.Store)}  # by a sum, say
        own = {text(symbol) for symbol in expression.free_symbols}
        if missing := {node.id for node in names} - bound - own - namespace.keys() - vars(builtins).keys():
            raise _lacks(model, expression, missing)
        return line

    namespace = {"builtins": builtins, **functions}
    lines = [f"def function({text(TIME)}, states, inputs, parameters):"]
    for group in ("states", "inputs", "parameters"):
        lines.append(f"    [{', '.join(text(variable.symbol) for variable in getattr(model, group))}] = {group}")
    lines += [f"    {text(term.symbol)} = {written(term.expression)}" for term in terms]
    lines.append(f"    return [{', '.join(map(written, expressions))}]")
    try:
        exec(compile("\n".join(lines), f"<model {model.name}>", "exec"), namespace)
    except (SyntaxError, RecursionError, MemoryError):
        raise _too_deep(model) from None
    function: Callable[..., list[Any]] = namespace["function"]
    return function


def _too_deep(model: OdeModel) -> ModelError:
    return ModelError(
        f"model {model.name!r}: an expression is nested too deep for Python: give parts of it names, as terms"
    )


def _lacks(model: OdeModel, expression: sympy.Expr, names: Iterable[str]) -> ModelError:
    reason = f": it has no {', '.join(sorted(names))}" if names else ""
    return ModelError(f"model {model.name!r}: {expression} cannot be computed in Python{reason}")


def scalar_functions() -> dict[str, Any]:
    """Return the functions by the names that a printer for Python gives them."""
    own = {**vars(elementary), **vars(logarithms)}
    return {name: own[name] for name in (*OWN_FUNCTIONS.values(), "cbrt", "pow")}
