"""The table of the variables of an ODE model's FMU, from which modelDescription.xml and config.h are written."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np
import sympy

from plants import units
from plants.errors import ModelError
from plants.factory.variables import Entry, Item, Table, Unknown
from plants.ode import TIME, Enumeration, OdeModel, Parameter, State, Variable, contradiction, real_number

SOLVER = Enumeration(
    sympy.Symbol("solver", integer=True),
    {
        "euler": "explicit Euler, order 1",
        "runge_kutta_4": "classical Runge-Kutta, order 4",
        "dormand_prince_45": "Dormand-Prince 5(4), order 5, with step-size control",
    },
    "Method that integrates the states in Co-Simulation",
)
"""The methods of template/solver.h, in the same order."""

AT_SINGULARITY = Enumeration(
    sympy.Symbol("at_singularity", integer=True),
    {
        "warn": "warn once, return the status Warning as long as it lasts, and go on",
        "stop": "end the simulation with an error",
    },
    "What to do where the equations cease to hold; a parameter of models that state limits",
)

SOLVER_STEP = Parameter(
    sympy.Symbol("solver_step"),
    "s",
    "Largest internal step: a communication step is divided into the fewest equal steps that are no longer;"
    " dormand_prince_45 takes shorter ones as its tolerance asks for",
    start=0.02,
    min=1e-9,
    nominal=0.01,
    tunable=False,
)

TOLERANCE = Parameter(
    sympy.Symbol("tolerance"),
    "1",
    "Error that dormand_prince_45 tolerates in an internal step, relative to a state's magnitude plus nominal value",
    start=1e-6,
    min=1e-14,
    max=0.1,
    nominal=1e-6,
    tunable=False,
)


def tabulate(model: OdeModel) -> Table:
    """Return the table of the variables of a model's FMU, the solver's parameters among them."""
    references = itertools.count()

    def variability(variable: Variable) -> str:
        if not isinstance(variable, Parameter):
            return "continuous"
        return "tunable" if variable.tunable else "fixed"

    def entries(causality: str, variables: Iterable[Variable]) -> tuple[Entry, ...]:
        return tuple(
            Entry(
                reference=next(references),
                name=v.name,
                causality="local" if isinstance(v, State) and not v.output else causality,
                variability=variability(v),
                initial=None if causality == "input" else "exact",
                description=v.description,
                unit=v.unit,
                start=v.start,
                min=v.min,
                max=v.max,
                nominal=v.nominal,
            )
            for v in variables
        )

    def calculated(causality: str, name: str, description: str, unit: str) -> Entry:
        return Entry(next(references), name, causality, "continuous", "calculated", description, unit)

    states = entries("output", model.states)
    derivatives = tuple(
        replace(
            calculated("local", state.name, f"Time derivative of {state.name}", units.per_second(state.unit)),
            derivative_of=state.reference,
        )
        for state in states
    )
    inputs = entries("input", model.inputs)
    parameters = entries("parameter", (*model.reals, SOLVER_STEP, TOLERANCE))
    outputs = tuple(
        replace(calculated("output", output.name, output.description, output.unit), nominal=output.nominal)
        for output in model.outputs
    )
    all_enumerations = (*model.enumerations, SOLVER, *([AT_SINGULARITY] if model.limits else []))
    names = {entry.name for entry in (*states, *inputs, *parameters, *outputs)} | {e.name for e in all_enumerations}
    enumerations = tuple(
        Entry(
            reference=next(references),
            name=enumeration.name,
            causality="parameter",
            variability="fixed",
            initial="exact",
            description=enumeration.description,
            start=1,
            min=1,
            max=len(enumeration.items),
            items=tuple(Item(name, i + 1, text) for i, (name, text) in enumerate(enumeration.items.items())),
            type_name=_type_name(enumeration, names),
        )
        for enumeration in all_enumerations
    )
    time = Entry(next(references), TIME.name, "independent", "continuous", None, "Time", unit="s")

    known = [
        *_named(states, model.states),
        *_named(inputs, model.inputs),
        *_named(parameters, model.reals),
        *_named(enumerations, model.enumerations),
        (time, TIME),
    ]
    derivative_of = list(zip(derivatives, map(model.expand, model.derivatives), strict=True))
    output_of = list(zip(outputs, (model.expand(output.expression) for output in model.outputs), strict=True))
    itself = [(entry, symbol) for entry, symbol in _named(states, model.states) if entry.causality == "output"]
    tunable = {parameter.symbol for parameter in model.reals if parameter.tunable}
    fixed = {parameter.symbol for parameter in model.parameters} - tunable
    return Table(
        states,
        derivatives,
        inputs,
        parameters,
        outputs,
        enumerations,
        time,
        output_unknowns=tuple(_unknown(*pair, known, fixed, tunable) for pair in (*itself, *output_of)),
        derivative_unknowns=tuple(_unknown(*pair, known, fixed, tunable) for pair in derivative_of),
        initial_unknowns=tuple(_unknown(*pair, known, set(), set()) for pair in (*derivative_of, *output_of)),
        step=SOLVER_STEP.start,
        tolerance=TOLERANCE.start,
    )


def with_starts(model: OdeModel, starts: Mapping[str, float | str]) -> Table:
    """Return the table of a model's FMU in which variables have other start values.

    Parameters
    ----------
    model
        The model.
    starts
        The values, by the names of states and parameters; of an enumeration the item.

    Raises
    ------
    ModelError
        There is no such variable, or it cannot have this value.
    """
    table, left = tabulate(model), dict(starts)
    symbols = {variable.name: variable.symbol for variable in (*model.states, *model.reals)}

    def begun(entry: Entry) -> Entry:
        if entry.name not in left:
            return entry
        value = left.pop(entry.name)
        if entry.items:
            number = next((item.value for item in entry.items if item.name == value), None)
            if number is None:
                raise ModelError(f"{entry.name} has no item {value!r}; it has {', '.join(i.name for i in entry.items)}")
            return replace(entry, start=number)
        try:
            start = math.nan if np.asarray(value).dtype.kind in "bSU" else real_number(value)
        except (TypeError, ValueError, OverflowError):
            start = math.nan
        if not (math.isfinite(start) and entry.min <= start <= entry.max):
            raise ModelError(f"{entry.name} cannot start at {value!r}; it lies from {entry.min:g} to {entry.max:g}")
        if entry.name in symbols and (sign := contradiction(symbols[entry.name], start)):
            raise ModelError(f"{entry.name} cannot start at {value!r}; its symbol is {sign}")
        return replace(entry, start=start)

    parameters = tuple(map(begun, table.parameters))
    begun_table = replace(
        table,
        states=tuple(map(begun, table.states)),
        parameters=parameters,
        integers=tuple(map(begun, table.integers)),
        tolerance=next(entry.start for entry in parameters if entry.name == TOLERANCE.name),
    )
    if left:
        raise ModelError(f"there is no state or parameter {next(iter(left))!r} that could have a start value")
    return begun_table


def _type_name(enumeration: Enumeration, taken: set[str]) -> str:
    """Return the name of an enumeration's type, and take it: it differs from all other types and variables."""
    stem = enumeration.name.title().replace("_", "") + "Variant"
    name = next(
        name for name in itertools.chain([stem], (f"{stem}{i}" for i in itertools.count(2))) if name not in taken
    )
    taken.add(name)
    return name


def _named(
    entries: Iterable[Entry], declared: Iterable[Variable | Enumeration]
) -> Iterator[tuple[Entry, sympy.Symbol]]:
    # Those at the end of `entries` that every FMU has are not in the model's equations.
    return ((entry, variable.symbol) for entry, variable in zip(entries, declared, strict=False))


def _unknown(
    entry: Entry,
    expression: sympy.Expr,
    known: Iterable[tuple[Entry, sympy.Symbol]],
    fixed: set[sympy.Symbol],
    tunable: set[sympy.Symbol],
) -> Unknown:
    """Return the dependencies of an expression and their kinds: slope constant, `fixed`, `tunable`, or any other."""
    pieces = [piece for piecewise in expression.atoms(sympy.Piecewise) for piece in piecewise.args]
    deciding = set[sympy.Symbol]().union(*(condition.free_symbols for _, condition in pieces))
    dependencies, kinds = [], []
    for other, symbol in known:
        if symbol not in expression.free_symbols:
            continue
        # The condition of a branch counts, though the derivative within each branch does not show it.
        slope = symbol if other.items or symbol in deciding else expression.diff(symbol)
        if slope != 0:
            dependencies.append(other.reference)
            free = slope.free_symbols
            if not free:
                kinds.append("constant")
            elif symbol in free or not free <= fixed | tunable:
                kinds.append("dependent")
            else:
                kinds.append("tunable" if free & tunable else "fixed")
    return Unknown(entry.reference, tuple(dependencies), tuple(kinds))
