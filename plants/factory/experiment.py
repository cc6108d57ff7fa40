"""The reference experiment that an FMU carries, so that every importer can replay it and compare.

The files follow the draft layered standard FMI-LS-REF 1.0.0-alpha.1: the manifest its section 2.1, related files 2.2,
the archive's folders 2.3, the page on it 2.4, the parameter set (SSV of SSP) 2.5.1 and the experiments 2.5.2. The
format of experiments is in its appendix A, now the Harmonized Specification MA-HS-Experiments.

The results do not come from the FMU: the model's equations are evaluated here, in Python, and integrated with the
classical Runge-Kutta method. The parameter set chooses the same method for the FMU. The numbers are Python's: NumPy is
slower for single numbers. The functions are our own, so that the files are the same, wherever they are made.
"""

import csv
import io
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import sympy
from sympy.printing.pycode import PythonCodePrinter

from plants.errors import ModelError
from plants.factory.table import SOLVER, SOLVER_STEP
from plants.factory.variables import Entry, Table
from plants.ode import OdeModel
from plants.printing import OWN_FUNCTIONS, PythonPrinting, python_function, scalar_functions
from plants.runge_kutta import runge_kutta_4

FOLDER = "extra/org.fmi-standard.fmi-ls-ref"
SOLVER_ITEM = "runge_kutta_4"
STEP = SOLVER_STEP.start
"""Communication step [s]."""
STEPS = 250
PIECE = 50
"""For how many steps the inputs are held."""
SAMPLES = 50
"""Largest number of results after the start."""
LEVELS = (1.0, -1.0, 0.5, -0.5, 0.0)
"""Values of an input, piece by piece, in nominal values from its start value; their sum is zero. Each input is one
piece behind the one before it."""
DIGITS = 10
"""Digits of a result, relative to the largest magnitude of its variable."""
TOLERANCE = 1e-6
_MOVED = 1e-12
"""By how much of themselves times and states are moved, to see whether the results depend on the last bits."""
_PARTED = 0.5 * TOLERANCE
"""Difference at which the results of moved ones have parted, relative to the largest magnitude of each variable, or
to a thousandth of its nominal value if that is larger: of a sum that is zero, the last bits are all there is."""
_LARGEST = 1e9
"""Largest magnitude of a state, in nominal values; a model beyond it has diverged."""

_BROKEN = (ArithmeticError, ValueError, TypeError)
"""Errors of an evaluation: a number that is too large, outside of a function's domain, or complex."""


@dataclass(frozen=True)
class Setting:
    """A parameter of the parameter set: an enumeration's value is the name of an item."""

    name: str
    value: float | str


@dataclass(frozen=True)
class Experiment:
    """The reference experiment of a model.

    Attributes
    ----------
    stop, step
        Its end and its communication step [s]; it begins at 0 s.
    tolerance
        The tolerance of its results, relative to the largest magnitude of each variable.
    parameters
        The parameter set: all parameters.
    stimuli, results
        Two tables in CSV, with the time in the first column. At a jump, the stimuli have two rows of the same time.
    has_inputs
        Whether there are any stimuli.
    """

    stop: float
    step: float
    tolerance: float
    parameters: tuple[Setting, ...]
    stimuli: str
    results: str
    has_inputs: bool

    def files(self) -> dict[str, bytes]:
        """Return the two tables, by their paths in the FMU."""
        tables = {"results.csv": self.results} | ({"stimuli.csv": self.stimuli} if self.has_inputs else {})
        return {f"{FOLDER}/{name}": text.encode() for name, text in tables.items()}


def reference_experiment(model: OdeModel, table: Table) -> Experiment | None:
    """Return the reference experiment of a model.

    It ends well before a state diverges, a limit is left or the equations have no value, and before a result depends on
    the last bits of the time or a state, as at a step in time that falls on a communication point. There is no
    experiment if not a single step comes before, or if Python lacks a function.
    """
    try:
        equations = _Equations(model)
    except ModelError:
        return None
    inputs = [[_level(entry, number, k) for number, entry in enumerate(table.inputs)] for k in range(STEPS)]
    rows = _simulate(equations, table, inputs)
    if len(rows) <= STEPS:
        rows = rows[: len(rows) // 2 + 1]
    computed = (*table.states, *table.outputs)
    for moved in (-_MOVED, _MOVED):
        rows = _as_far_as_agreed(rows, _simulate(equations, table, inputs[: len(rows)], moved), computed)
    every = max(1, (len(rows) - 1) // SAMPLES)
    rows = rows[::every]
    if len(rows) < 2:
        return None
    steps = (len(rows) - 1) * every
    return Experiment(
        stop=_time(steps),
        step=STEP,
        tolerance=TOLERANCE,
        parameters=_parameters(table),
        stimuli=_stimuli(table.inputs, inputs[:steps]),
        results=_results([e.name for e in computed], every, rows),
        has_inputs=bool(table.inputs),
    )


def _time(step: int) -> float:
    return round(step * STEP, 9)


def _level(entry: Entry, number: int, step: int) -> float:
    level = LEVELS[(step // PIECE - number) % len(LEVELS)]
    return min(max(entry.start_value + level * entry.nominal, entry.min), entry.max)


def _parameters(table: Table) -> tuple[Setting, ...]:
    numbers = [Setting(entry.name, entry.start_value) for entry in table.parameters]
    chosen = [(entry.name, entry.items[int(entry.start_value) - 1].name) for entry in table.integers]
    return (*numbers, *(Setting(name, SOLVER_ITEM if name == SOLVER.name else item) for name, item in chosen))


class _Printer(PythonPrinting, PythonCodePrinter):  # type: ignore[misc]
    """Expressions of Python that call functions of our own."""


class _Equations:
    """Derivatives, outputs and limits of a model at its default parameters, on Python's numbers."""

    def __init__(self, model: OdeModel) -> None:
        self._model = model
        self._parameters = [1.0 if p in model.enumerations else p.start for p in model.parameters]  # type: ignore[union-attr]
        self._derivatives = self._function(model.derivatives)
        self._outputs = self._function([output.expression for output in model.outputs])
        self._limited = self._function([limit.expression for limit in model.limits])

    def derivatives(self, inputs: Sequence[float], time: float, states: Sequence[float]) -> Sequence[float]:
        return _real(self._derivatives(time, states, inputs, self._parameters))

    def outputs(self, time: float, states: Sequence[float], inputs: Sequence[float]) -> Sequence[float]:
        return _real(self._outputs(time, states, inputs, self._parameters))

    def hold(self, time: float, states: Sequence[float], inputs: Sequence[float]) -> bool:
        """Return whether the equations hold, and the states have not diverged."""
        limited = _real(self._limited(time, states, inputs, self._parameters))
        return all(
            limit.min <= value <= limit.max for limit, value in zip(self._model.limits, limited, strict=True)
        ) and all(abs(x) <= _LARGEST * s.nominal for x, s in zip(states, self._model.states, strict=True))

    def _function(self, expressions: Sequence[sympy.Expr]) -> Callable[..., list[float]]:
        printer = _Printer({"fully_qualified_modules": False, "user_functions": OWN_FUNCTIONS})
        terms = self._model.terms_of(expressions)
        return python_function(self._model, expressions, terms, printer, {**vars(math), **scalar_functions()})


def _real(values: Iterable[float]) -> list[float]:
    """Return values; refuse infinity, NaN and complex numbers."""
    numbers = [float(value) for value in values]
    if not all(map(math.isfinite, numbers)):
        raise ArithmeticError
    return numbers


def _simulate(
    equations: _Equations, table: Table, inputs: Sequence[Sequence[float]], moved: float = 0.0
) -> list[list[float]]:
    """Return states and outputs at the start and after each step, as long as the equations hold.

    As in Co-Simulation, inputs are held over a step, and the outputs at its end belong to these inputs. All times are
    moved, and the states after each step, by a fraction of themselves; the start is exact.
    """
    times = [_time(k) * (1.0 + moved) for k in range(len(inputs) + 1)]
    rows: list[list[float]] = []
    x = [entry.start_value for entry in table.states]
    try:
        rows.append([*x, *equations.outputs(0.0, x, inputs[0])])
        for k, u in enumerate(inputs):
            x = runge_kutta_4(partial(equations.derivatives, u), times[k], x, STEP)
            x = [value * (1.0 + moved) for value in x]
            if not equations.hold(times[k + 1], x, u):
                break
            rows.append([*x, *equations.outputs(times[k + 1], x, u)])
    except _BROKEN:
        pass
    return rows


def _as_far_as_agreed(
    rows: list[list[float]], others: list[list[float]], computed: Iterable[Entry]
) -> list[list[float]]:
    """Return the first rows, as long as others agree with them."""
    columns = zip(computed, zip(*rows, strict=True), strict=bool(rows))
    largest = [max(1e-3 * entry.nominal, *map(abs, column)) for entry, column in columns]
    for k, (row, other) in enumerate(zip(rows, others, strict=False)):
        if any(abs(a - b) > _PARTED * most for a, b, most in zip(row, other, largest, strict=True)):
            return rows[:k]
    return rows[: len(others)]


# Tables -----------------------------------------------------------------------------------------------------


def _stimuli(entries: Sequence[Entry], inputs: Sequence[Sequence[float]]) -> str:
    rows: list[tuple[float, Sequence[float]]] = [(0.0, inputs[0])]
    for k, (before, after) in enumerate(pairwise(inputs), start=1):
        if before != after:
            rows += [(_time(k), before), (_time(k), after)]
    rows.append((_time(len(inputs)), inputs[-1]))
    return _csv([entry.name for entry in entries], ((time, *values) for time, values in rows))


def _results(names: Sequence[str], every: int, rows: Sequence[Sequence[float]]) -> str:
    columns = list(map(_rounded, zip(*rows, strict=True)))
    return _csv(names, ((_time(k * every), *row) for k, row in enumerate(zip(*columns, strict=True))))


def _rounded(column: Sequence[float]) -> list[float]:
    largest = max(map(abs, column))
    if largest == 0.0:
        return [0.0] * len(column)
    digits = DIGITS - 1 - math.floor(math.log10(largest))
    return [round(value, digits) + 0.0 for value in column]  # no negative zero


def _csv(names: Iterable[str], rows: Iterable[Iterable[float]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("time", *names))
    writer.writerows([repr(value).removesuffix(".0") for value in row] for row in rows)
    return text.getvalue()
