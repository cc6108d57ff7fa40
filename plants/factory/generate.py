"""The files of an FMU: the generated C, XML and HTML of a model, the hand-written runtime, and the headers of FMI."""

import hashlib
import importlib.metadata
import importlib.util
import math
import string
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import jinja2
import sympy
from sympy.core.relational import Relational
from sympy.functions.elementary.piecewise import ExprCondPair
from sympy.logic.boolalg import BooleanAtom
from sympy.printing.c import C99CodePrinter
from sympy.printing.precedence import PRECEDENCE

from plants import units
from plants.errors import BuildError, ModelError
from plants.factory import c_functions, experiment
from plants.factory.document import document
from plants.factory.shared_functions import Call, Result, share_functions, together
from plants.factory.table import Entry, Table, tabulate, with_starts
from plants.jacobian import differentiate
from plants.ode import TIME, Enumeration, OdeModel, Term
from plants.printing import OWN_FUNCTIONS, Powers

TEMPLATE = Path(__file__).parent / "template"
RUNTIME = ("instance.c", "instance.h", "model.h", "simulation.c", "simulation.h", "solver.c", "solver.h")


@dataclass(frozen=True)
class Version:
    """Differences between the versions of FMI: runtime, headers; by path in the FMU, templates and other files."""

    runtime: str
    headers: tuple[str, ...]
    templates: dict[str, str]
    files: dict[str, str]


VERSIONS = {
    "2.0": Version(
        "fmi2.c",
        ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
        {"modelDescription.xml": "modelDescription2.xml.jinja"},
        {"model.png": "icon.png"},
    ),
    "3.0": Version(
        "fmi3.c",
        ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
        {
            "modelDescription.xml": "modelDescription3.xml.jinja",
            "sources/buildDescription.xml": "buildDescription.xml.jinja",
            "terminalsAndIcons/terminalsAndIcons.xml": "terminalsAndIcons.xml.jinja",
        },
        {"terminalsAndIcons/icon.png": "icon.png", "terminalsAndIcons/icon.svg": "icon.svg"},
    ),
}
_TEMPLATES = {
    "documentation/index.html": "documentation.html.jinja",
    "sources/config.h": "config.h.jinja",
    "sources/model.c": "model.c.jinja",
}
_REFERENCE_TEMPLATES = {
    "documentation/fmi-ls-ref.txt": "fmi-ls-ref.txt.jinja",
    f"{experiment.FOLDER}/fmi-ls-manifest.xml": "referenceManifest.xml.jinja",
    f"{experiment.FOLDER}/experiments.exp": "referenceExperiments.xml.jinja",
    f"{experiment.FOLDER}/parameters.ssv": "referenceParameters.xml.jinja",
}


def tool() -> str:
    """Return the name and version of this tool, for the FMU's description."""
    try:
        return f"Formation {importlib.metadata.version('formation-cosim')}"
    except importlib.metadata.PackageNotFoundError:  # used from a source tree that is not installed
        return "Formation"


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
        The model uses a function that C has not, or one that cannot be differentiated; or a start value does not fit.
    BuildError
        FMPy, which brings the headers of FMI, is not complete.
    """
    version = VERSIONS[fmi]
    runtime = (version.runtime, *RUNTIME)
    files = {f"sources/{name}": (TEMPLATE / name).read_bytes() for name in runtime}
    files["sources/" + c_functions.FILE] = c_functions.header().encode()
    files |= {f"sources/{name}": _fmi_header(name) for name in version.headers}
    files |= {path: (TEMPLATE / name).read_bytes() for path, name in version.files.items()}

    table = with_starts(tabulate(model), starts) if starts else tabulate(model)
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
        "tool": tool(),
        "functions": functions,
        "partials": running[2],
        "parameter_partials": at_start[2],
        "source_files": sorted(["model.c", *(name for name in runtime if name.endswith(".c"))]),
        "page": document(model),
        "experiment": reference,
        "solver_item": experiment.SOLVER_ITEM,
        "digits": experiment.DIGITS,
        "infinity": math.inf,
    }

    def render(guid: str) -> dict[str, bytes]:
        return files | {
            path: _JINJA.get_template(name).render(context, guid=guid).encode() for path, name in templates.items()
        }

    # The GUID stands for the content: it is the digest of everything else.
    digest = hashlib.sha256()
    for path, content in sorted(render(guid="").items()):
        digest.update(f"{path} {len(content)}\n".encode() + content)
    return render(guid=f"{{{uuid.UUID(bytes=digest.digest()[:16])}}}")


def _fmi_header(name: str) -> bytes:
    fmpy = importlib.util.find_spec("fmpy")
    for folder in (fmpy.submodule_search_locations or ()) if fmpy else ():
        path = Path(folder) / "c-code" / name
        if path.is_file():
            return path.read_bytes()
    raise BuildError(f"the FMI header {name} is not there: it comes with FMPy; install it with 'pip install fmpy'")


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
        *(s.symbol for s in model.states if s.output),
        *model.derivatives,
        *(o.expression for o in model.outputs),
    )
    entries = (*(s for s in table.states if s.causality == "output"), *table.derivatives, *table.outputs)
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


class _Printer(Powers, C99CodePrinter):  # type: ignore[misc]
    """C expressions in double arithmetic, in which a variant of an enumeration goes by its name."""

    own_prefix = c_functions.PREFIX

    def __init__(self, model: OdeModel) -> None:
        # A named constant such as M_PI is not part of C11: constants are printed as numbers. abs is for int.
        own = {name: self.own_prefix + function for name, function in OWN_FUNCTIONS.items()}
        super().__init__(
            {"math_macros": {}, "strict": True, "user_functions": {"Abs": "fabs", "exp2": self._exp2, **own}}
        )
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

    def _exp2(self, exponent: sympy.Expr) -> str:
        return f"{self.own_prefix}pow(2.0, {self._print(exponent)})"

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
        """Print the remainder that has the sign of the divisor, as in SymPy and NumPy; fmod has the dividend's."""
        dividend, divisor = (self.parenthesize(e, PRECEDENCE["Pow"]) for e in expression.args)
        return f"({dividend} - {divisor}*floor({dividend}/{divisor}))"

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


def _c_string(text: str) -> str:
    """Return a C string literal in UTF-8; an octal escape always ends after three digits."""
    plain = {ord(c) for c in string.ascii_letters + string.digits + string.punctuation + " "} - set(b'"\\?')
    return '"' + "".join(chr(byte) if byte in plain else f"\\{byte:03o}" for byte in text.encode()) + '"'


def _c_number(value: float) -> str:
    return ("INFINITY" if value > 0 else "-INFINITY") if math.isinf(value) else repr(float(value))


def _c_comment(text: str) -> str:
    return " ".join(text.split()).replace("*/", "* /")


_JINJA = jinja2.Environment(
    loader=jinja2.FileSystemLoader(TEMPLATE),
    autoescape=lambda name: name is not None and name.endswith((".xml.jinja", ".html.jinja")),
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_JINJA.filters |= {"c_string": _c_string, "c_number": _c_number, "c_comment": _c_comment}
