"""LaTeX of a model's matrices and equations, for papers and notebooks; in math mode, with amsmath.

>>> latex.matrices(plants.car_like.model.SYSTEM)["M2"]
>>> latex.equations(plants.load("car_like"))
"""

from typing import NamedTuple

import sympy
from sympy.printing.latex import LatexPrinter, greek_letters_set, tex_greek_dictionary

from plants.nonholonomic import NonholonomicSystem
from plants.ode import OdeModel

_GREEK: dict[str, str] = {name: rf"\{name}" for name in greek_letters_set} | tex_greek_dictionary


def matrices(system: NonholonomicSystem) -> dict[str, str]:
    """Return every matrix of (1) to (3) as an equation, by its name.

    These are A (if it is stated), S, M1, C1, D1, B1, M2, C2, D2, B2 and F2. C1 and C2 are in terms of the
    pseudo-velocities.
    """
    names = ("A", "S", "M1", "C1", "D1", "B1", "M2", "C2", "D2", "B2", "F2")
    stated = {name: getattr(system, name) for name in names}
    return {name: f"{symbol(name)} = {expression(m)}" for name, m in stated.items() if m is not None}


def equations(model: OdeModel) -> tuple[str, ...]:
    """Return the explicit equations: the named terms, in order, the derivatives of the states, the outputs.

    Terms that only name a function, such as cos_gamma, are written out.
    """
    plain = {t.symbol: t.expression for t in model.terms if isinstance(t.expression, sympy.cos | sympy.sin | sympy.tan)}
    lines = [(symbol(t.symbol.name), t.expression) for t in model.terms if t.symbol not in plain]
    lines += [(symbol(s.name, dot=True), f) for s, f in zip(model.states, model.derivatives, strict=True)]
    lines += [(symbol(output.name), output.expression) for output in model.outputs]
    return tuple(f"{left} = {expression(right.xreplace(plain))}" for left, right in lines)


def expression(value: sympy.Expr | sympy.Matrix) -> str:
    """Return the LaTeX of an expression or a matrix in a model's symbols."""
    return str(_Printer().doprint(value))


def symbol(name: str, dot: bool = False) -> str:
    r"""Return the LaTeX of a variable's name, such as ``\theta_{1}`` for theta_1 and ``M_{2,11}`` for M2_11."""
    parts = split(name)
    base = _word(parts.base)
    subscript = ",".join("".join(map(_word, index)) for index in parts.indices)
    return (rf"\dot{{{base}}}" if dot or parts.dot else base) + (f"_{{{subscript}}}" if subscript else "")


class Parts(NamedTuple):
    """A variable's name in parts: the base letter or word, whether it has a dot, its indices as words and numbers."""

    base: str
    dot: bool
    indices: tuple[tuple[str, ...], ...]


def split(name: str) -> Parts:
    """Split a name such as ``M2_11``, ``I_theta1`` or ``e_dot_stop`` into base, dot and indices."""
    head, *tail = name.split("_")
    dot = "dot" in tail
    if dot:
        tail.remove("dot")
    base, digits = _split(head)
    if not base:
        base, digits = digits, ""
    indices = (tuple(filter(None, part)) for part in ((digits,), *map(_split, tail)))
    return Parts(base, dot, tuple(index for index in indices if index))


def _split(part: str) -> tuple[str, str]:
    """Split theta01 into theta and 01."""
    letters = part.rstrip("0123456789")
    return letters, part[len(letters) :]


def _word(word: str) -> str:
    if len(word) < 2 or word.isdigit():
        return word
    return _GREEK.get(word, rf"\mathrm{{{word}}}")


class _Printer(LatexPrinter):  # type: ignore[misc]
    def _print_Symbol(self, value: sympy.Symbol, style: str = "plain") -> str:
        return symbol(value.name)
