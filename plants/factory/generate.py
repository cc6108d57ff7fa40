"""The files of an FMU: the generated C, XML and HTML of a model, the hand-written runtime, and the headers of FMI."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import sympy
from sympy.core.relational import Relational
from sympy.functions.elementary.piecewise import ExprCondPair
from sympy.logic.boolalg import BooleanAtom
from sympy.printing.c import C99CodePrinter

from plants import units
from plants.errors import ModelError
from plants.factory import c_functions, experiment
from plants.factory.assemble import VERSIONS, rendered, runtime_of
from plants.factory.document import document
from plants.factory.shared_functions import Call, Result, share_functions, together
from plants.factory.table import tabulate, with_starts
from plants.factory.variables import Entry, Table
from plants.jacobian import differentiate
from plants.ode import TIME, Enumeration, OdeModel, Term
from plants.printing import OWN_FUNCTIONS, Printing

RUNTIME = ("model.h", "simulation.c", "simulation_state.h", "solver.c", "solver.h")
_TEMPLATES = {
    "documentation/index.html": "documentation.html.jinja",
    "sources/config.h": "config.h.jinja",
    "sources/model.c": "model.c.jinja",
}
_ALL = {"providesDirectionalDerivative": "true"}
_ALL_3 = {"providesDirectionalDerivatives": "true", "providesAdjointDerivatives": "true"}
_VARIABLE = {"canHandleVariableCommunicationStepSize": "true"}
_INTERFACES = {
    "2.0": {"ModelExchange": _ALL, "CoSimulation": {**_VARIABLE, "canInterpolateInputs": "true", **_ALL}},
    "3.0": {
        "ModelExchange": {"needsCompletedIntegratorStep": "true", **_ALL_3},  # limits are checked there
        "CoSimulation": {**_VARIABLE, **_ALL_3},
    },
}
"""What each interface offers besides saved states, as attributes of its element in the description."""
_REFERENCE_TEMPLATES = {
    "documentation/fmi-ls-ref.txt": "fmi-ls-ref.txt.jinja",
    f"{experiment.FOLDER}/fmi-ls-manifest.xml": "referenceManifest.xml.jinja",
    f"{experiment.FOLDER}/experiments.exp": "referenceExperiments.xml.jinja",
    f"{experiment.FOLDER}/parameters.ssv": "referenceParameters.xml.jinja",
}


def generate(model: OdeModel, fmi: str, starts: Mapping[str, float | str] | None = None) -> dict[str, bytes]:
    """Return the files of a model's FMU, but the binaries, by their path in the FMU.

    Parameters
    ----------
    model
        The model.
    fmi
        Version of FMI, one of `VERSIONS`.
    starts
        Start values in place of the model's, see `plants.build`.

    Raises
    ------
    ModelError
        The model uses a function that C has not, or one that cannot be differentiated; a name is one that the
        runtime has in C; or a start value does not fit.
    BuildError
        FMPy, which brings the headers of FMI, is not complete.
    """
    version = VERSIONS[fmi]
    files = runtime_of(version, RUNTIME)
    files["sources/" + c_functions.FILE] = c_functions.header().encode()
    _check_names(model, b"\n".join(content for path, content in files.items() if path.startswith("sources/")).decode())

    table = with_starts(model, starts) if starts else tabulate(model)
    running = _jacobian(model, table, table.states + table.inputs + (table.time,))
    at_start = _jacobian(model, table, table.parameters[: len(model.reals)])
    functions = (
        _function(model, "model_get_derivatives", "derivatives", model.terms, _derivative_lines(model)),
        _function(model, "model_get_outputs", "outputs", model.terms, _output_lines(model)),
        _function(model, "model_get_limited", "limited", model.terms, _limit_lines(model)),
        _function(model, "model_get_partials", "partials", *running[:2]),
        _function(model, "model_get_parameter_partials", "partials", *at_start[:2]),
    )
    # Last, as the functions above have refused a model that C cannot compute.
    reference = None if starts else experiment.reference_experiment(model, table)
    templates = version.templates | _TEMPLATES | (_REFERENCE_TEMPLATES if reference else {})
    files |= reference.files() if reference else {}
    context = {
        "model": model,
        "table": table,
        "interfaces": _INTERFACES[fmi],
        "stop": 10,
        "functions": functions,
        "partials": running[2],
        "parameter_partials": at_start[2],
        "page": document(model),
        "experiment": reference,
        "solver_item": experiment.SOLVER_ITEM,
        "digits": experiment.DIGITS,
    }
    return rendered(files, templates, context)


def _check_names(model: OdeModel, runtime: str) -> None:
    """Refuse names that the runtime, which is compiled as one unit with the model, has for something of its own.

    The model's symbols are local in C: only a macro takes their place. Items of enumerations have file scope.
    """
    macros, names = _names_of(runtime)
    symbols = [variable.symbol.name for variable in (*model.states, *model.inputs, *model.parameters, *model.terms)]
    items = [f"{enumeration.name}_{item}" for enumeration in model.enumerations for item in enumeration.items]
    for name in (*sorted(macros.intersection(symbols)), *sorted((macros | names).intersection(items))):
        raise ModelError(
            f"model {model.name!r}: the generated C code uses the name {name!r} for something else: "
            f"choose another name{' for the enumeration or its item' if name in items else ''}"
        )


_NO_CODE = re.compile(r"""/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'""", re.DOTALL)
_CPLUSPLUS = re.compile(r"^[ \t]*#[ \t]*ifdef __cplusplus.*?#[ \t]*endif", re.DOTALL | re.MULTILINE)
_DIRECTIVE = re.compile(r"^[ \t]*#(?:\\\n|.)*", re.MULTILINE)
_BRACES = re.compile(r"(\benum\b\s*\w*\s*)?\{([^{}]*)\}")
_ARGUMENTS = re.compile(r"\((?!\s*\*)[^()]*\)")  # but not the name of a pointer to a function


def _names_of(code: str) -> tuple[set[str], set[str]]:
    """Return the macros of C code and its names of file scope: not members, arguments, locals or words of comments."""
    code = _CPLUSPLUS.sub("", _NO_CODE.sub(" ", code))
    macros = set(re.findall(r"^[ \t]*#[ \t]*define[ \t]+(\w+)", code, re.MULTILINE))
    types = set(re.findall(r"\w+_t\b|va_list", code))  # of system headers, wherever they are used
    code = _DIRECTIVE.sub("", code)
    # From the innermost ones outwards; the items of an enum have the scope of the enum.
    while (outer := _BRACES.sub(lambda found: f" {found[2]} " if found[1] else " ", code)) != code:
        code = outer
    while (outer := _ARGUMENTS.sub(" ", code)) != code:
        code = outer
    return macros, types | set(re.findall(r"\w+", code))


@dataclass(frozen=True)
class _Line:
    """``type name = value; /* comment */``."""

    name: str
    value: str
    comment: str
    type: str = "double"


@dataclass(frozen=True)
class _Function:
    """A C function that computes the entries of the array `result`."""

    name: str
    result: str
    unused: tuple[str, ...]
    locals: tuple[_Line, ...]
    results: tuple[_Line, ...]


def _derivative_lines(model: OdeModel) -> list[Result]:
    return [
        (f"STATE_{state.name}", derivative, _comment(units.per_second(state.unit), equation))
        for state, derivative, equation in zip(model.states, model.derivatives, model.equations, strict=True)
    ]


def _output_lines(model: OdeModel) -> list[Result]:
    return [(f"OUTPUT_{output.name}", output.expression, _comment(output.unit)) for output in model.outputs]


def _limit_lines(model: OdeModel) -> list[Result]:
    return [(str(i), limit.expression, _comment(limit.unit)) for i, limit in enumerate(model.limits)]


def _jacobian(
    model: OdeModel, table: Table, knowns: Sequence[Entry]
) -> tuple[tuple[Term, ...], list[Result], list[tuple[Entry, Entry]]]:
    """Return the terms, the result lines and the unknown and known of each partial derivative that is not zero."""
    expressions = (
        *(s.symbol for s in model.states),
        *model.derivatives,
        *(o.expression for o in model.outputs),
    )
    entries = (*table.states, *table.derivatives, *table.outputs)
    unknown = {entry.full_name: entry for entry in entries}
    known = {entry.name: entry for entry in knowns}
    jacobian = differentiate(
        model,
        [(entry.full_name, expression, entry.unit) for entry, expression in zip(entries, expressions, strict=True)],
        known,
    )
    lines = [
        (str(i), partial.expression, f"d {partial.unknown} / d {partial.known} [{partial.unit}]")
        for i, partial in enumerate(jacobian.partials)
    ]
    return jacobian.terms, lines, [(unknown[p.unknown], known[p.known]) for p in jacobian.partials]


def _comment(unit: str, equation: str = "") -> str:
    return f"[{unit}] {equation}".rstrip()


def _function(model: OdeModel, name: str, result: str, terms: Sequence[Term], lines: Sequence[Result]) -> _Function:
    printer = _Printer(model)
    terms, lines = share_functions(model, _needed(terms, lines), lines)
    expressions = [*(term.expression for term in terms), *(expression for _, expression, _ in lines)]
    used = {symbol.name for expression in expressions for symbol in expression.free_symbols}

    locals_, unused = [], [] if TIME.name in used else [TIME.name]
    for argument, variables, kind in (
        ("states", model.states, "STATE"),
        ("inputs", model.inputs, "INPUT"),
        ("parameters", model.reals, "PARAMETER"),
        ("enumerations", model.enumerations, "ENUMERATION"),
    ):
        needed = [variable for variable in variables if variable.name in used]
        for variable in needed:
            value = f"{argument}[{kind}_{variable.name}]"
            if isinstance(variable, Enumeration):
                locals_.append(_Line(variable.name, value, variable.description, "int"))
            else:
                locals_.append(_Line(variable.name, value, f"{_comment(variable.unit)} {variable.description}"))
        if not needed:
            unused.append(argument)
    if not lines:
        unused.append(result)
    calls, made = together(model, terms), set[Call]()
    for term in terms:
        call, place = calls.get(term.symbol, (None, 0))
        if call is not None and call not in made:
            made.add(call)
            kind, called = c_functions.result_type(call.function), c_functions.PREFIX + call.function
            locals_.append(
                _Line(call.name, f"{called}({printer.doprint(call.angle)})", ", ".join(call.functions), kind)
            )
        value = printer.doprint(term.expression) if call is None else f"{call.name}.item_{place}"
        locals_.append(_Line(term.symbol.name, value, _comment(term.unit, term.equation)))
    results = tuple(_Line(index, printer.doprint(e), comment) for index, e, comment in lines)
    return _Function(name, result, tuple(unused), tuple(locals_), results)


def _needed(terms: Sequence[Term], lines: Sequence[Result]) -> list[Term]:
    """Return the terms that the results need, in order."""
    needed = {symbol.name for _, expression, _ in lines for symbol in expression.free_symbols}
    used = []
    for term in reversed(terms):
        if term.symbol.name in needed:
            used.append(term)
            needed |= {symbol.name for symbol in term.expression.free_symbols}
    return used[::-1]


_NODES = (
    sympy.Symbol,
    sympy.Number,
    sympy.NumberSymbol,
    sympy.Add,
    sympy.Mul,
    sympy.Pow,
    sympy.Piecewise,
    ExprCondPair,
    Relational,
    BooleanAtom,
    sympy.And,
    sympy.Or,
    sympy.Not,
    sympy.ITE,
)
"""Parts of an expression besides functions; the printer would print others as text that is not C."""


class _Printer(Printing, C99CodePrinter):  # type: ignore[misc]
    """C expressions in double arithmetic, in which a variant of an enumeration goes by its name."""

    own_prefix = c_functions.PREFIX

    def __init__(self, model: OdeModel) -> None:
        # A named constant such as M_PI is not part of C11: constants are printed as numbers. abs is for int.
        own = {name: self.own_prefix + function for name, function in OWN_FUNCTIONS.items()}
        super().__init__({"math_macros": {}, "strict": True, "user_functions": {"Abs": "fabs", **own}})
        self._model = model
        self._enumerations = {enumeration.name: enumeration for enumeration in model.enumerations}
        self._functions = {*self.known_functions, *self._rewriteable_functions, "Mod", "sign"}

    def doprint(self, expression: sympy.Expr) -> str:
        for part in sympy.preorder_traversal(expression):
            if not (isinstance(part, _NODES) or type(part).__name__ in self._functions):
                raise self._error(expression, f": C has no {part}")
        if expression.has(sympy.I, sympy.zoo, sympy.nan):
            raise self._error(expression)
        try:
            return str(super().doprint(expression))
        except NotImplementedError:
            raise self._error(expression) from None

    def _error(self, expression: sympy.Expr, reason: str = "") -> ModelError:
        return ModelError(f"model {self._model.name!r}: {expression} cannot be written in C{reason}")

    # A quotient of two integers would be an integer in C: in arithmetic all is double.
    def _print_Integer(self, value: sympy.Integer) -> str:
        return f"{int(value)}.0"

    def _print_BooleanTrue(self, value: BooleanAtom) -> str:
        return "1"

    def _print_BooleanFalse(self, value: BooleanAtom) -> str:
        return "0"

    def _print_Symbol(self, symbol: sympy.Symbol) -> str:
        return f"(double){symbol.name}" if symbol.name in self._enumerations else symbol.name

    def _print_NumberSymbol(self, constant: sympy.NumberSymbol) -> str:
        return str(self._print(sympy.Float(constant, 17)))

    def _print_sign(self, expression: sympy.Expr) -> str:
        argument = self._print(expression.args[0])
        return f"(double)(({argument} > 0.0) - ({argument} < 0.0))"

    def _print_Mod(self, expression: sympy.Mod) -> str:
        return f"{self.own_prefix}mod({', '.join(map(self._print, expression.args))})"

    def _print_Piecewise(self, expression: sympy.Piecewise) -> str:
        *branches, (otherwise, condition) = expression.args
        if condition != sympy.true:
            raise ModelError(f"model {self._model.name!r}: {expression} has no value where no condition holds")
        chosen = [f"{self._print(c)} ? {self._print(e)} : " for e, c in branches]
        return f"({''.join(chosen)}{self._print(otherwise)})"

    def _print_Relational(self, expression: Relational) -> str:
        left, right = expression.args
        enumeration = self._enumerations.get(str(left))
        if enumeration and isinstance(expression, sympy.Eq) and right.is_Integer:
            return f"{enumeration.name} == {enumeration.name}_{list(enumeration.items)[int(right) - 1]}"
        return f"{self._print(left)} {expression.rel_op} {self._print(right)}"
