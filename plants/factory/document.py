"""The documentation page of an FMU: the model's equations as MathML, which browsers show without any script."""

from dataclasses import dataclass

import sympy
from sympy.printing.mathml import MathMLPresentationPrinter

from plants import units
from plants.ode import OdeModel


@dataclass(frozen=True)
class Equation:
    """One equation of the page: both sides as MathML, unit, and number in the source of the model."""

    left: str
    right: str
    unit: str
    number: str = ""


@dataclass(frozen=True)
class Page:
    """The equations of a page, section by section."""

    terms: tuple[Equation, ...]
    derivatives: tuple[Equation, ...]
    outputs: tuple[Equation, ...]
    limits: tuple[tuple[str, str], ...]


def document(model: OdeModel) -> Page:
    """Render a model's equations."""
    printer = _Printer(model)
    return Page(
        terms=tuple(
            Equation(printer.render(t.symbol), printer.render(t.expression), t.unit, t.equation) for t in model.terms
        ),
        derivatives=tuple(
            Equation(printer.dot(s.symbol), printer.render(d), units.per_second(s.unit), equation)
            for s, d, equation in zip(model.states, model.derivatives, model.equations, strict=True)
        ),
        outputs=tuple(Equation(printer.render(o.symbol), printer.render(o.expression), o.unit) for o in model.outputs),
        limits=tuple((printer.between(limit.min, limit.expression, limit.max), limit.reason) for limit in model.limits),
    )


class _Printer(MathMLPresentationPrinter):  # type: ignore[misc]
    """MathML in which a variant of an enumeration goes by its name."""

    def __init__(self, model: OdeModel) -> None:
        super().__init__({"mul_symbol": "None"})
        self._enumerations = {enumeration.symbol: enumeration for enumeration in model.enumerations}

    def render(self, expression: sympy.Expr) -> str:
        """Return an expression as the content of a <math> element."""
        return str(self._print(expression).toxml())

    def dot(self, symbol: sympy.Symbol) -> str:
        """Return the time derivative of a symbol."""
        return f"<mover>{self.render(symbol)}<mo>&#x2D9;</mo></mover>"

    def between(self, low: float, expression: sympy.Expr, high: float) -> str:
        """Return an expression with its bounds."""
        left = f"<mn>{low:g}</mn><mo>&#x2264;</mo>" if low > -float("inf") else ""
        right = f"<mo>&#x2264;</mo><mn>{high:g}</mn>" if high < float("inf") else ""
        return f"<mrow>{left}{self.render(expression)}{right}</mrow>"

    def _print_Equality(self, expression: sympy.Eq) -> object:
        left, right = expression.args
        enumeration = self._enumerations.get(left)
        if enumeration is None or not right.is_Integer:
            return super()._print_Relational(expression)
        row = self.dom.createElement("mrow")
        for tag, text in (("mi", enumeration.name), ("mo", "="), ("mtext", list(enumeration.items)[int(right) - 1])):
            element = self.dom.createElement(tag)
            element.appendChild(self.dom.createTextNode(text))
            row.appendChild(element)
        return row
