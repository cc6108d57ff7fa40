"""The table of an FMU's variables, from which modelDescription.xml and config.h are written."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import sympy

from plants import units
from plants.errors import ModelError
from plants.ode import TIME, Enumeration, OdeModel, Parameter, State, Variable

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

_DISPLAY_UNITS = {"rad": "deg", "rad/s": "deg/s", "rad/s2": "deg/s2"}


@dataclass(frozen=True)
class Item:
    """A variant of an enumeration."""

    name: str
    value: int
    description: str


@dataclass(frozen=True)
class Entry:
    """One variable of the FMU; `start` is None if it is computed, `type_name` names the type of an enumeration."""

    reference: int
    name: str
    causality: str
    variability: str
    initial: str | None
    description: str
    unit: str = ""
    start: float | int | None = None
    min: float = -math.inf
    max: float = math.inf
    nominal: float = 1.0
    derivative_of: int | None = None
    items: tuple[Item, ...] = ()
    type_name: str = ""

    @property
    def full_name(self) -> str:
        """The name in the model description; ``der(x)`` for the derivative of x."""
        return f"der({self.name})" if self.derivative_of is not None else self.name

    @property
    def start_value(self) -> float:
        """The value after instantiation."""
        return 0.0 if self.start is None else float(self.start)

    @property
    def unit_or_items(self) -> str:
        """For messages: the unit, or the items with their numbers."""
        return self.unit if not self.items else ", ".join(f"{item.value} ({item.name})" for item in self.items)

    @property
    def real_attributes(self) -> Iterator[tuple[str, str | float]]:
        """The attributes that a real variable has in the model description, besides its unit and its derivative."""
        if display := _DISPLAY_UNITS.get(self.unit):
            yield "displayUnit", display
        if math.isfinite(self.min):
            yield "min", self.min
        if math.isfinite(self.max):
            yield "max", self.max
        if self.nominal != 1.0:
            yield "nominal", self.nominal
        if self.start is not None:
            yield "start", self.start


@dataclass(frozen=True)
class UnitEntry:
    """One unit of the model description."""

    name: str
    exponents: tuple[tuple[str, int], ...]
    factor: float
    display: str | None
    display_factor: float


@dataclass(frozen=True)
class Unknown:
    """One line of the model structure: a variable and its dependencies, by value reference in ascending order."""

    reference: int
    dependencies: tuple[int, ...]
    kinds: tuple[str, ...]


@dataclass(frozen=True)
class Table:
    """All variables of an FMU by section; value references count through the sections in this order (template/model.h).

    The model's own parameters and enumerations come before those that every FMU has.
    """

    states: tuple[Entry, ...]
    derivatives: tuple[Entry, ...]
    inputs: tuple[Entry, ...]
    parameters: tuple[Entry, ...]
    outputs: tuple[Entry, ...]
    enumerations: tuple[Entry, ...]
    time: Entry
    output_unknowns: tuple[Unknown, ...]
    derivative_unknowns: tuple[Unknown, ...]
    initial_unknowns: tuple[Unknown, ...]
    step: float = SOLVER_STEP.start
    tolerance: float = TOLERANCE.start

    @property
    def variables(self) -> tuple[Entry, ...]:
        """All variables, by value reference."""
        sections = (self.states, self.derivatives, self.inputs, self.parameters, self.outputs, self.enumerations)
        return (*itertools.chain.from_iterable(sections), self.time)

    @property
    def units(self) -> Iterator[UnitEntry]:
        """The units in use, sorted by name."""
        for name in sorted({variable.unit for variable in self.variables if variable.unit}):
            unit = units.parse(name)
            exponents = tuple((n, e) for n, e in zip(units.BASE_UNITS, unit.exponents, strict=True) if e)
            display = _DISPLAY_UNITS.get(name)
            yield UnitEntry(
                name, exponents, unit.factor, display, units.convert(1.0, name, display) if display else 1.0
            )

    def without_parameters(self, unknowns: Iterable[Unknown]) -> tuple[Unknown, ...]:
        """Leave dependencies on parameters out: to FMI 2.0 they are no knowns of a running simulation."""
        parameters = {variable.reference for variable in (*self.parameters, *self.enumerations)}

        def strip(unknown: Unknown) -> Unknown:
            pairs = zip(unknown.dependencies, unknown.kinds, strict=True)
            kinds = {reference: kind for reference, kind in pairs if reference not in parameters}
            return Unknown(unknown.reference, tuple(kinds), tuple(kinds.values()))

        return tuple(map(strip, unknowns))


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
    )


def with_starts(table: Table, starts: Mapping[str, float | str]) -> Table:
    """Return a table in which variables have other start values.

    Parameters
    ----------
    table
        The table.
    starts
        The values, by the names of states and parameters; of an enumeration the item.

    Raises
    ------
    ModelError
        There is no such variable, or it cannot have this value.
    """
    left = dict(starts)

    def begun(entry: Entry) -> Entry:
        if entry.name not in left:
            return entry
        value = left.pop(entry.name)
        if entry.items:
            number = next((item.value for item in entry.items if item.name == value), None)
            if number is None:
                raise ModelError(f"{entry.name} has no item {value!r}; it has {', '.join(i.name for i in entry.items)}")
            return replace(entry, start=number)
        if not (isinstance(value, float | int) and entry.min <= value <= entry.max):
            raise ModelError(f"{entry.name} cannot start at {value!r}; it lies from {entry.min:g} to {entry.max:g}")
        return replace(entry, start=float(value))

    begun_table = replace(
        table,
        states=tuple(map(begun, table.states)),
        parameters=tuple(map(begun, table.parameters)),
        enumerations=tuple(map(begun, table.enumerations)),
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
