"""The text of an FMU: the generated C and XML of a model, the hand-written runtime, and the headers of FMI."""

import hashlib
import importlib.metadata
import importlib.util
import json
import math
import uuid
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import jinja2
import sympy
from sympy.printing.c import C99CodePrinter

from plants import units
from plants.errors import BuildError, ModelError
from plants.factory.table import tabulate
from plants.ode import TIME, Enumeration, OdeModel

TEMPLATE = Path(__file__).parent / "template"
RUNTIME_SOURCES = ("fmi2.c", "simulation.c", "solver.c")
RUNTIME_HEADERS = ("model.h", "simulation.h", "solver.h")
FMI_HEADERS = ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h")


def tool() -> str:
    """Return the name and version of this tool, for the FMU's description."""
    try:
        return f"Formation {importlib.metadata.version('formation-cosim')}"
    except importlib.metadata.PackageNotFoundError:  # used from a source tree that is not installed
        return "Formation"


def generate(model: OdeModel) -> dict[str, str]:
    """Return the text files of a model's FMU for FMI 2.0 Co-Simulation, by their path in the FMU.

    Raises
    ------
    ModelError
        The model uses a function that C has not.
    BuildError
        FMPy, which brings the headers of FMI, is not complete.
    """
    runtime = (*RUNTIME_SOURCES, *RUNTIME_HEADERS)
    files = {f"sources/{name}": (TEMPLATE / name).read_text(encoding="utf-8") for name in runtime}
    files |= {f"sources/{name}": _fmi_header(name) for name in FMI_HEADERS}

    context = {
        "model": model,
        "table": tabulate(model),
        "tool": tool(),
        "functions": (
            _function(model, "model_derivatives", "derivatives", "STATE", _derivative_lines(model)),
            _function(model, "model_outputs", "outputs", "OUTPUT", _output_lines(model)),
        ),
        "source_files": sorted(["model.c", *RUNTIME_SOURCES]),
    }
    templates = {
        "modelDescription.xml": "modelDescription.xml.jinja",
        "sources/config.h": "config.h.jinja",
        "sources/model.c": "model.c.jinja",
    }

    def render(guid: str) -> dict[str, str]:
        return files | {path: _JINJA.get_template(name).render(context, guid=guid) for path, name in templates.items()}

    # The GUID stands for the content: it is the digest of everything else.
    digest = hashlib.sha256(json.dumps(render(guid=""), sort_keys=True).encode()).digest()
    return render(guid=f"{{{uuid.UUID(bytes=digest[:16])}}}")


def _fmi_header(name: str) -> str:
    fmpy = importlib.util.find_spec("fmpy")
    for folder in (fmpy.submodule_search_locations or ()) if fmpy else ():
        path = Path(folder) / "c-code" / name
        if path.is_file():
            return path.read_text(encoding="utf-8")
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


def _derivative_lines(model: OdeModel) -> list[tuple[str, sympy.Expr, str]]:
    return [
        (state.name, derivative, _comment(units.per_second(state.unit), equation))
        for state, derivative, equation in zip(model.states, model.derivatives, model.equations, strict=True)
    ]


def _output_lines(model: OdeModel) -> list[tuple[str, sympy.Expr, str]]:
    return [(output.name, output.expression, _comment(output.unit)) for output in model.outputs]


def _comment(unit: str, equation: str = "") -> str:
    return f"[{unit}] {equation}".rstrip()


def _function(
    model: OdeModel, name: str, result: str, prefix: str, lines: Sequence[tuple[str, sympy.Expr, str]]
) -> _Function:
    printer = _Printer(model)
    expressions = [expression for _, expression, _ in lines]
    terms = model.terms_of(expressions)
    used = set[sympy.Symbol]().union(*(e.free_symbols for e in (*expressions, *(term.expression for term in terms))))

    locals_, unused = [], [] if TIME in used else [TIME.name]
    for argument, variables, kind in (
        ("states", model.states, "STATE"),
        ("inputs", model.inputs, "INPUT"),
        ("parameters", model.reals, "PARAMETER"),
        ("enumerations", model.enumerations, "ENUMERATION"),
    ):
        needed = [variable for variable in variables if variable.symbol in used]
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
    locals_ += [_Line(t.symbol.name, printer.doprint(t.expression), _comment(t.unit, t.equation)) for t in terms]
    results = tuple(_Line(f"{prefix}_{target}", printer.doprint(e), comment) for target, e, comment in lines)
    return _Function(name, result, tuple(unused), tuple(locals_), results)


class _Printer(C99CodePrinter):  # type: ignore[misc]
    """C expressions in which a variant of an enumeration goes by its name."""

    def __init__(self, model: OdeModel) -> None:
        # A named constant such as M_PI is not part of C11: constants are printed as numbers.
        super().__init__({"math_macros": {}})
        self._model = model
        self._enumerations = {enumeration.symbol: enumeration for enumeration in model.enumerations}

    def doprint(self, expression: sympy.Expr) -> str:
        numbers = {constant: sympy.Float(constant, 17) for constant in expression.atoms(sympy.NumberSymbol)}
        try:
            text = str(super().doprint(expression.xreplace(numbers)))
        except NotImplementedError as error:
            text = f"// Not supported in C: {error}"
        if "// Not supported" in text or "nan" in text.lower() or expression.has(sympy.I, sympy.zoo, sympy.nan):
            raise ModelError(f"model {self._model.name!r}: {expression} cannot be written in C")
        return text

    def _print_Piecewise(self, expression: sympy.Piecewise) -> str:
        *branches, (otherwise, condition) = expression.args
        if condition != sympy.true:
            raise ModelError(f"model {self._model.name!r}: {expression} has no value where no condition holds")
        chosen = [f"{self._print(c)} ? {self._print(e)} : " for e, c in branches]
        return f"({''.join(chosen)}{self._print(otherwise)})"

    def _print_Equality(self, expression: sympy.Eq) -> str:
        left, right = expression.args
        if left in self._enumerations and right.is_Integer:
            enumeration = self._enumerations[left]
            return f"{left} == {enumeration.name}_{list(enumeration.items)[int(right) - 1]}"
        return f"{self._print(left)} == {self._print(right)}"


def _c_number(value: float) -> str:
    return ("INFINITY" if value > 0 else "-INFINITY") if math.isinf(value) else repr(float(value))


def _c_comment(text: str) -> str:
    return " ".join(text.split()).replace("*/", "* /")


_JINJA = jinja2.Environment(
    loader=jinja2.FileSystemLoader(TEMPLATE),
    autoescape=lambda name: name is not None and name.endswith(".xml.jinja"),
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_JINJA.filters |= {"c_string": json.dumps, "c_number": _c_number, "c_comment": _c_comment}
