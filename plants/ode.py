"""The general model of a plant: an explicit ordinary differential equation with named, typed, bounded variables.

    der(x) = f(time, x, u, p),    y = g(time, x, u, p)

This is all that the FMU factory and the NumPy functions see. Every quantity is a SymPy symbol, declared once with its
unit; intermediate terms carry the names and equation numbers of the source, so that generated code reads like it.
"""

import math
import numbers
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from decimal import Decimal

import sympy
from sympy.core.function import AppliedUndef

from plants import units
from plants.errors import ModelError

TIME = sympy.Symbol("time", real=True)
"""The independent variable [s], for right-hand sides that depend on it."""


def real_number(value: object) -> float:
    """Return a number of Python, NumPy or SymPy as a float; a NumPy array without dimensions is one, too.

    Raises
    ------
    TypeError, ValueError, OverflowError
        The value is no real number, or too large.
    """
    item = value.item() if getattr(value, "ndim", None) == 0 else value  # type: ignore[attr-defined]
    if not isinstance(item, numbers.Real | Decimal | sympy.Expr):
        raise TypeError
    return float(value)  # type: ignore[arg-type]


def contradiction(symbol: sympy.Symbol, value: float) -> str:
    """Return the assumption of a symbol that a value contradicts, ``not negative`` or ``not positive``, or nothing.

    Zero contradicts neither: what SymPy makes of a positive symbol holds from above up to there, and zero is at rest.
    """
    for size, sign in ((value, "positive"), (-value, "negative")):
        if size > 0 and getattr(symbol, f"is_{sign}") is False:
            return f"not {sign}"
    return ""


def _make_floats(declared: "Variable | Output | Limit", *attributes: str) -> None:
    """Turn attributes that are numbers of Python, NumPy or SymPy, such as pi/2, into floats."""
    for attribute in attributes:
        value = getattr(declared, attribute)
        try:
            object.__setattr__(declared, attribute, real_number(value))
        except (TypeError, ValueError, OverflowError):
            kind = type(declared).__name__.lower()
            raise ModelError(f"{kind} {declared.name!r}: {attribute} is {value!r}, it must be a real number") from None


# Characters that no XML can have, not even by a reference.
_NO_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def _check_statements(declared: "_Declared", *texts: str) -> None:
    """Refuse symbols that are none of SymPy, and texts that are no texts or cannot be written to a description."""
    kind = "model" if isinstance(declared, OdeModel) else type(declared).__name__.lower()
    symbol = getattr(declared, "symbol", None)
    if hasattr(declared, "symbol") and not isinstance(symbol, sympy.Symbol):
        raise ModelError(f"{kind}: its symbol is {symbol!r}, it must be a Symbol of SymPy")
    name = getattr(declared, "name", None) or symbol
    for attribute in texts:
        value = getattr(declared, attribute)
        if not isinstance(value, str):
            raise ModelError(f"{kind} {str(name)!r}: {attribute} is {value!r}, it must be a text")
        _check_text(f"{kind} {str(name)!r}: {attribute}", value)


def _check_text(place: str, text: str) -> None:
    if found := _NO_XML.search(text):
        raise ModelError(f"{place} has the character {found[0]!r}, which no XML file can have: remove it")


@dataclass(frozen=True)
class Variable:
    """A declared real quantity.

    Parameters
    ----------
    symbol
        Its symbol in the equations; the symbol's name is the variable's name in the FMU.
    unit
        Unit expression, see `plants.units`.
    description
        One line.
    start
        Start value of a state, value of an input before it is set, default of a parameter.
    min, max
        Bounds, both allowed. An FMU checks them when the simulation starts, and again when a parameter changes. A bound
        of the equations' validity during a run is a `Limit`.
    nominal
        Typical magnitude, for solvers and tolerances.
    """

    symbol: sympy.Symbol
    unit: str
    description: str
    start: float = 0.0
    min: float = -math.inf
    max: float = math.inf
    nominal: float = 1.0

    def __post_init__(self) -> None:
        _check_statements(self, "unit", "description")
        _make_floats(self, "start", "min", "max", "nominal")

    @property
    def name(self) -> str:
        """The name of the symbol."""
        return str(self.symbol)


@dataclass(frozen=True)
class State(Variable):
    """A continuous state; also an output of the plant unless `output` is false."""

    output: bool = True


@dataclass(frozen=True)
class Input(Variable):
    """An input, held constant over a communication step."""


@dataclass(frozen=True)
class Parameter(Variable):
    """A parameter; it may change between two steps of a simulation unless `tunable` is false, then it is fixed."""

    tunable: bool = True


@dataclass(frozen=True)
class Enumeration:
    """A parameter that chooses one of several named variants, for a whole simulation; the first is the default.

    Parameters
    ----------
    symbol
        Its symbol, which takes the values 1, 2, ... in the order of `items`.
    items
        Name and description of each variant.
    description
        One line.
    """

    symbol: sympy.Symbol
    items: Mapping[str, str]
    description: str

    def __post_init__(self) -> None:
        _check_statements(self, "description")
        for item, text in self.items.items():
            _check_text(f"enumeration {self.name!r}: item {item!r}", text)

    @property
    def name(self) -> str:
        """The name of the symbol."""
        return str(self.symbol)

    def number(self, item: str) -> int:
        """Return the value that stands for a variant."""
        if item not in self.items:
            raise ModelError(f"{self.name} has no variant {item!r}; it has {', '.join(self.items)}")
        return list(self.items).index(item) + 1

    def select(self, **expressions: sympy.Expr | float) -> sympy.Expr:
        """Return the expression of the chosen variant; every variant must be given one."""
        if set(expressions) != set(self.items):
            raise ModelError(f"{self.name}: select() needs one expression for each of {', '.join(self.items)}")
        *first, last = self.items
        branches = [(expressions[item], sympy.Eq(self.symbol, self.number(item))) for item in first]
        return sympy.Piecewise(*branches, (expressions[last], True))


@dataclass(frozen=True)
class Term:
    """A named intermediate result: ``symbol = expression``, with its unit and the equation it comes from."""

    symbol: sympy.Symbol
    expression: sympy.Expr
    unit: str = "1"
    equation: str = ""

    def __post_init__(self) -> None:
        _check_statements(self, "unit", "equation")


@dataclass(frozen=True)
class Output:
    """An output that is computed: ``symbol = expression``."""

    symbol: sympy.Symbol
    expression: sympy.Expr
    unit: str
    description: str
    nominal: float = 1.0

    def __post_init__(self) -> None:
        _check_statements(self, "unit", "description")
        _make_floats(self, "nominal")

    @property
    def name(self) -> str:
        """The name of the symbol."""
        return str(self.symbol)


@dataclass(frozen=True)
class Limit:
    """A limit of the equations: an expression that must stay between two bounds.

    A running FMU checks its limits after every internal step; its parameter `at_singularity` decides whether leaving
    them gives a warning or ends the simulation. State a limit on a quantity that keeps growing beyond the
    singularity, such as an angle and not its cosine, so that a step that jumps across is seen too.

    Parameters
    ----------
    expression
        A symbol, or an expression in states, inputs, parameters and terms.
    min, max
        Bounds that it must not leave, both allowed.
    reason
        The consequence beyond, which ends a message: ``tan(gamma) is singular at 90 degrees``.
    unit
        Unit of the expression; it may be left out if the expression is a declared variable.
    """

    expression: sympy.Expr
    min: float = -math.inf
    max: float = math.inf
    reason: str = ""
    unit: str = ""

    def __post_init__(self) -> None:
        _check_statements(self, "reason", "unit")
        _make_floats(self, "min", "max")

    @property
    def name(self) -> str:
        """The expression as text, for messages."""
        return str(self.expression)


@dataclass(frozen=True)
class Terminal:
    """Variables that belong together, such as a pose: a terminal of the FMU (FMI 3.0, section 2.4.9).

    Parameters
    ----------
    name
        An identifier.
    symbols
        The variables, in order: states that are outputs, inputs or outputs.
    description
        One line.
    """

    name: str
    symbols: tuple[sympy.Symbol, ...]
    description: str = ""

    def __post_init__(self) -> None:
        _check_statements(self, "name", "description")


@dataclass(frozen=True)
class OdeModel:
    """An explicit ordinary differential equation, checked when it is made.

    Parameters
    ----------
    name
        Model identifier: a C identifier, also the file name of the FMU.
    description
        One line.
    states
        The continuous states, in the order of x.
    derivatives
        The time derivative of each state, in terms of everything declared and the terms.
    inputs, parameters, outputs
        In the order of u, p and y.
    terms
        Named intermediate results; each may use those before it.
    equations
        For each state the number of the equation that gives its derivative, or nothing.
    limits
        Where the equations hold.
    terminals
        Variables that belong together.

    Raises
    ------
    ModelError
        A symbol is undefined or declared twice, a name cannot be used in FMI and C, a text not in XML, a default lies
        outside its bounds or contradicts the assumptions of its symbol, or there are not as many derivatives as states.
    UnitError
        A unit is not known.
    """

    name: str
    description: str
    states: tuple[State, ...]
    derivatives: tuple[sympy.Expr, ...]
    inputs: tuple[Input, ...] = ()
    parameters: tuple[Parameter | Enumeration, ...] = ()
    outputs: tuple[Output, ...] = ()
    terms: tuple[Term, ...] = ()
    equations: tuple[str, ...] = field(default=())
    limits: tuple[Limit, ...] = ()
    terminals: tuple[Terminal, ...] = ()

    def __post_init__(self) -> None:
        _check_statements(self, "name", "description")
        object.__setattr__(self, "derivatives", tuple(map(self._expression, self.derivatives)))
        for name in ("outputs", "terms", "limits"):
            items = tuple(replace(item, expression=self._expression(item.expression)) for item in getattr(self, name))
            object.__setattr__(self, name, items)
        declared = {variable.symbol: variable.unit for variable in (*self.states, *self.inputs, *self.reals)}
        limits = tuple(replace(limit, unit=limit.unit or declared.get(limit.expression, "1")) for limit in self.limits)
        object.__setattr__(self, "limits", limits)
        object.__setattr__(self, "equations", self.equations or ("",) * len(self.states))
        _check(self)

    def _expression(self, value: object) -> sympy.Expr:
        """Return a value as an expression of SymPy, also a number such as 0."""
        try:
            expression = sympy.sympify(value, strict=True)
        except sympy.SympifyError:
            expression = None
        if not isinstance(expression, sympy.Expr) or expression.is_Matrix:
            raise ModelError(
                f"model {self.name!r}: {value!r} is not an expression: state a real function of the model's symbols"
            )
        return expression

    @property
    def reals(self) -> tuple[Parameter, ...]:
        """The parameters that are numbers."""
        return tuple(p for p in self.parameters if isinstance(p, Parameter))

    @property
    def enumerations(self) -> tuple[Enumeration, ...]:
        """The parameters that choose a variant."""
        return tuple(p for p in self.parameters if isinstance(p, Enumeration))

    def expand(self, expression: sympy.Expr) -> sympy.Expr:
        """Replace the named terms in an expression by their definitions, in states, inputs and parameters."""
        for term in reversed(self.terms):
            expression = expression.xreplace({term.symbol: term.expression})
        return expression

    def terms_of(self, expressions: Iterable[sympy.Expr]) -> tuple[Term, ...]:
        """Return the terms that these expressions need, directly or through other terms, in order."""
        needed = set[sympy.Symbol]().union(*(e.free_symbols for e in expressions))
        used = []
        for term in reversed(self.terms):
            if term.symbol in needed:
                used.append(term)
                needed |= term.expression.free_symbols
        return tuple(reversed(used))


_Declared = Variable | Enumeration | Term | Output | Limit | Terminal | OdeModel

_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
# Words that a generated C function could not use for a local variable: keywords up to C23, functions, macros.
_C_WORDS = """
    auto break case char const continue default do double else enum extern float for goto if inline int long register
    restrict return short signed sizeof static struct switch typedef union unsigned void volatile while asm
    alignas alignof bool constexpr false nullptr static_assert thread_local true typeof typeof_unqual linux unix
    acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs fdim floor fma fmax
    fmin fmod hypot ldexp lgamma log log10 log1p log2 pow round sin sinh sqrt tan tanh tgamma trunc
    fpclassify isfinite isgreater isgreaterequal isinf isless islessequal islessgreater isnan isnormal isunordered
    signbit math_errhandling INFINITY NAN NULL DECIMAL_DIG MAXFLOAT DOMAIN SING OVERFLOW UNDERFLOW TLOSS PLOSS
    float_t double_t
    BUFSIZ EOF EXIT_FAILURE EXIT_SUCCESS FILENAME_MAX FOPEN_MAX L_tmpnam MB_CUR_MAX RAND_MAX SEEK_CUR SEEK_END SEEK_SET
    TMP_MAX stderr stdin stdout errno EDOM EILSEQ ERANGE
"""
_OUR_WORDS = """
    time states inputs parameters enumerations derivatives outputs limited partials solver solver_step tolerance
    at_singularity ROOM TIME CONFIG_H
"""
RESERVED = {*_C_WORDS.split(), *_OUR_WORDS.split()}
"""Names that the generated C code needs for itself."""
# Names from math.h and float.h, from the headers in factory/template, and from limits.h and stdint.h.
_RESERVED_PREFIX = re.compile(
    r"(_|M_|FP_|HUGE|MATH_|DBL_|FLT_|LDBL_"
    r"|STATE_|INPUT_|PARAMETER_|ENUMERATION_|OUTPUT_|LIMIT_|N_|FIRST_|MODEL_|SOLVER_|AT_SINGULARITY_|model_"
    r"|ELEMENTARY_|elementary_).*"
    r"|([SU]?CHAR|U?SHRT|U?INT|U?L?LONG|U?INT(_LEAST|_FAST)?(8|16|32|64)|U?INT(MAX|PTR)|S?SIZE|PTRDIFF|SIG_ATOMIC|WCHAR"
    r"|WINT|MB_LEN)_(MIN|MAX|BIT|WIDTH)"
)


def _check(model: OdeModel) -> None:
    def error(text: str) -> ModelError:
        return ModelError(f"model {model.name!r}: {text}")

    def check_name(name: str, role: str) -> None:
        if not _IDENTIFIER.fullmatch(name):
            raise error(
                f"{role} {name!r} is not an FMI and C identifier: use letters, digits and underscores, no digit first"
            )
        if name in RESERVED or _RESERVED_PREFIX.fullmatch(name):
            raise error(f"{role} {name!r} is reserved, it cannot be used in the generated C code: choose another name")

    check_name(model.name, "model name")
    if not model.states:
        raise error("there are no states")
    if len(model.derivatives) != len(model.states):
        raise error(f"{len(model.states)} states, but {len(model.derivatives)} derivatives")
    if len(model.equations) != len(model.states):
        raise error(f"{len(model.states)} states, but {len(model.equations)} equation numbers")

    declared: dict[str, sympy.Symbol] = {TIME.name: TIME}
    variants = {enumeration.symbol: enumeration.items for enumeration in model.enumerations}

    def declare(symbol: sympy.Symbol, role: str) -> None:
        check_name(symbol.name, role)
        if symbol.name in declared:
            raise error(f"the name {symbol.name!r} is used twice")
        declared[symbol.name] = symbol

    def check_symbols(expression: sympy.Expr, place: str) -> None:
        for symbol in sorted(expression.free_symbols, key=str):
            if symbol.name not in declared:
                raise error(f"{place} uses the undefined symbol {symbol.name!r}")
            if declared[symbol.name] != symbol:
                raise error(
                    f"{place} uses a symbol {symbol.name!r} that is not the declared one: their assumptions differ"
                )
        for function in sorted(expression.atoms(AppliedUndef), key=str):
            raise error(f"{place} uses the undefined function {function}")
        for equality in sorted(expression.atoms(sympy.Eq), key=str):
            items = variants.get(equality.lhs, ())
            if items and equality.rhs.is_number and equality.rhs not in range(1, len(items) + 1):
                raise error(f"{place}: {equality.lhs} has no variant {equality.rhs}; it has 1 to {len(items)}")

    def check_nominal(variable: Variable | Output, kind: str) -> None:
        if not (math.isfinite(variable.nominal) and variable.nominal > 0):
            raise error(f"{kind} {variable.name!r}: the nominal value must be positive, not {variable.nominal:g}")

    for kind, variables in (("state", model.states), ("input", model.inputs), ("parameter", model.reals)):
        for variable in variables:
            declare(variable.symbol, kind)
            units.parse(variable.unit)
            bounds = f"[{variable.min:g}, {variable.max:g}]"
            if not (math.isfinite(variable.start) and variable.min <= variable.start <= variable.max):
                raise error(
                    f"{kind} {variable.name!r}: the default {variable.start:g} is not within its bounds {bounds}"
                )
            check_nominal(variable, kind)
            if sign := contradiction(variable.symbol, variable.start):  # by its assumptions SymPy simplifies
                raise error(
                    f"{kind} {variable.name!r}: the default {variable.start:g} contradicts the assumptions of its "
                    f"symbol, which is {sign}"
                )
    for enumeration in model.enumerations:
        declare(enumeration.symbol, "parameter")
        if not enumeration.items:
            raise error(f"enumeration {enumeration.name!r} has no items")
        for item in enumeration.items:
            check_name(item, f"{enumeration.name} item")
            declare(sympy.Symbol(f"{enumeration.name}_{item}"), f"{enumeration.name} item")
    for term in model.terms:
        units.parse(term.unit)
        check_symbols(term.expression, f"term {term.symbol.name!r}")
        declare(term.symbol, "term")
    for state, derivative in zip(model.states, model.derivatives, strict=True):
        check_symbols(derivative, f"the derivative of {state.name!r}")
    for output in model.outputs:
        units.parse(output.unit)
        check_nominal(output, "output")
        check_symbols(output.expression, f"output {output.name!r}")
    for output in model.outputs:
        declare(output.symbol, "output")
    for limit in model.limits:
        check_symbols(limit.expression, f"limit {limit.name!r}")
        units.parse(limit.unit)
        if not limit.min < limit.max:
            raise error(
                f"limit {limit.name!r}: its bounds are [{limit.min:g}, {limit.max:g}], the first must be smaller"
            )
    connectable = {
        *(state.symbol for state in model.states if state.output),
        *(variable.symbol for variable in model.inputs),
        *(output.symbol for output in model.outputs),
    }
    names = set[str]()
    for terminal in model.terminals:
        check_name(terminal.name, "terminal")
        if terminal.name in names:
            raise error(f"there are two terminals {terminal.name!r}")
        names.add(terminal.name)
        for symbol in terminal.symbols:
            if symbol not in connectable:
                raise error(
                    f"terminal {terminal.name!r}: {str(symbol)!r} is neither an input nor an output of the model"
                )
