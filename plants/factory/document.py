"""The documentation page of an FMU. The equations are MathML: browsers show it without any script."""

from dataclasses import dataclass
from xml.dom.minidom import Element

import sympy
from sympy.printing.mathml import MathMLPresentationPrinter
from sympy.printing.pretty.pretty_symbology import greek_unicode

from plants import latex, units
from plants.ode import OdeModel

_FUNCTIONS = (sympy.sin, sympy.cos, sympy.tan)


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
    """Render a model's equations. A term that names a function, such as cos_psi for cos(psi), is written out."""
    functions = {t.symbol: t.expression for t in model.terms if isinstance(t.expression, _FUNCTIONS)}
    printer = _Printer(model, functions)
    return Page(
        terms=tuple(
            Equation(printer.render(t.symbol), printer.render(t.expression), t.unit, t.equation)
            for t in model.terms
            if t.symbol not in functions
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

    def __init__(self, model: OdeModel, functions: dict[sympy.Symbol, sympy.Expr]) -> None:
        super().__init__({"mul_symbol": "dot"})
        self._functions = functions
        self._enumerations = {enumeration.symbol: enumeration for enumeration in model.enumerations}

    def render(self, expression: sympy.Expr) -> str:
        """Return an expression as the content of a <math> element."""
        return str(self._print(expression.xreplace(self._functions)).toxml())

    def dot(self, symbol: sympy.Symbol) -> str:
        """Return the time derivative of a symbol."""
        return str(self._symbol(symbol.name, dot=True).toxml())

    def between(self, low: float, expression: sympy.Expr, high: float) -> str:
        """Return an expression with its bounds."""
        left = f"<mn>{low:g}</mn><mo>≤</mo>" if low > -float("inf") else ""
        right = f"<mo>≤</mo><mn>{high:g}</mn>" if high < float("inf") else ""
        return f"<mrow>{left}{self.render(expression)}{right}</mrow>"

    def _element(self, tag: str, *children: Element | str, **attributes: str) -> Element:
        """Return an element with child nodes; text is a child too."""
        element: Element = self.dom.createElement(tag)
        for child in children:
            element.appendChild(self.dom.createTextNode(child) if isinstance(child, str) else child)
        for name, value in attributes.items():
            element.setAttribute(name, value)
        return element

    def _print_Symbol(self, symbol: sympy.Symbol, style: str = "plain") -> Element:
        return self._symbol(symbol.name)

    def _symbol(self, name: str, dot: bool = False) -> Element:
        """Return a name as it is typeset in LaTeX too: I_theta1 is I with the index θ1, e_dot_stop has a dot."""
        parts = latex.split(name)
        base = self._word(parts.base)
        if dot or parts.dot:
            base = self._element("mover", base, self._element("mo", "˙"))
        if not parts.indices:
            return base
        words = [self._element("mrow", *map(self._word, index)) for index in parts.indices]
        commas = [self._element("mo", ",") for _ in words]
        row = [element for pair in zip(commas, words, strict=True) for element in pair][1:]
        return self._element("msub", base, self._element("mrow", *row))

    def _word(self, word: str) -> Element:
        return self._element("mn" if word.isdigit() else "mi", greek_unicode.get(word, word))

    def _print_Piecewise(self, expression: sympy.Piecewise) -> Element:
        rows = []
        for value, condition in expression.args:
            when = [self._element("mtext", "otherwise")]
            if condition != sympy.true:
                when = [self._element("mtext", "if\u00a0"), self._print(condition)]
            cells = (self._element("mtd", self._print(value)), self._element("mtd", *when))
            rows.append(self._element("mtr", *cells))
        return self._element("mrow", self._element("mo", "{"), self._element("mtable", *rows))

    def _print_Equality(self, expression: sympy.Eq) -> Element:
        left, right = expression.args
        enumeration = self._enumerations.get(left)
        if enumeration is None or not right.is_Integer:
            relation: Element = super()._print_Relational(expression)
            return relation
        item = list(enumeration.items)[int(right) - 1]
        parts = (("mi", enumeration.name), ("mo", "="), ("mtext", item))
        return self._element("mrow", *(self._element(tag, text) for tag, text in parts))
