"""The variables of an FMU as its description and its C state them, whatever the kind of model."""

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from plants import units

_DISPLAY_UNITS = {"rad": "deg", "rad/s": "deg/s", "rad/s2": "deg/s2"}


@dataclass(frozen=True)
class Item:
    """A variant of an enumeration."""

    name: str
    value: int
    description: str


@dataclass(frozen=True)
class Entry:
    """One variable of the FMU; `start` is None if it is computed, `type_name` names the type of an enumeration.

    `whole` is an Integer; `above` and `below` say that a value must not equal its bound.
    """

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
    whole: bool = False
    above: bool = False
    below: bool = False

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
    """All variables of an FMU by section; value references count through these in this order (template/variables.h).

    The model's own parameters and enumerations come before those that every FMU has. `integers` are enumerations and
    Integers.
    """

    states: tuple[Entry, ...]
    derivatives: tuple[Entry, ...]
    inputs: tuple[Entry, ...]
    parameters: tuple[Entry, ...]
    outputs: tuple[Entry, ...]
    integers: tuple[Entry, ...]
    time: Entry
    output_unknowns: tuple[Unknown, ...]
    derivative_unknowns: tuple[Unknown, ...]
    initial_unknowns: tuple[Unknown, ...]
    step: float
    tolerance: float | None = None

    @property
    def variables(self) -> tuple[Entry, ...]:
        """All variables, by value reference."""
        sections = (self.states, self.derivatives, self.inputs, self.parameters, self.outputs, self.integers)
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
        parameters = {variable.reference for variable in (*self.parameters, *self.integers)}

        def strip(unknown: Unknown) -> Unknown:
            pairs = zip(unknown.dependencies, unknown.kinds, strict=True)
            kinds = {reference: kind for reference, kind in pairs if reference not in parameters}
            return Unknown(unknown.reference, tuple(kinds), tuple(kinds.values()))

        return tuple(map(strip, unknowns))
