"""A model description in Python.

The attributes have the names of the standard's, as FMPy has them too, so that its functions take these objects. Nothing
changes them after `cosim.fmu.description_reader` has made them. They are compared by identity.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

from cosim.fmu.alike import all_without_numbers

NEGATED = "negatedAlias"
"""Stands for the causality of a negated alias of FMI 1.0."""


@dataclass(slots=True, eq=False)
class BaseUnit:
    """A unit by its exponents of SI base units, its factor and its offset."""

    kg: int
    m: int
    s: int
    A: int
    K: int
    mol: int
    cd: int
    rad: int
    factor: float
    offset: float


@dataclass(slots=True, eq=False)
class DisplayUnit:
    """A unit in which values may be shown."""

    name: str | None


@dataclass(slots=True, eq=False)
class Unit:
    """A unit that an FMU names, and defines or not."""

    name: str | None
    baseUnit: BaseUnit | None
    displayUnits: Sequence[DisplayUnit]


@dataclass(slots=True, eq=False)
class Item:
    """An item of an enumeration; its value as text."""

    name: str
    value: str


@dataclass(slots=True, eq=False)
class SimpleType:
    """A type that variables may declare."""

    name: str | None
    unit: str | None
    min: str | None
    max: str | None
    items: Sequence[Item]


@dataclass(slots=True, eq=False)
class Dimension:
    """A dimension of an array: its size, or the variable that holds it."""

    start: int | None
    variable: Variable | None


@dataclass(slots=True, eq=False)
class Alias:
    """Another name of a variable, of FMI 3.0."""

    name: str
    description: str | None
    displayUnit: str | None


@dataclass(slots=True, eq=False)
class Variable:
    """A variable of an FMU; texts as the file has them.

    Attributes
    ----------
    type
        ``Real``, ``Float64``, ``Boolean``, ...
    causality, variability, initial
        As stated, or the standard's default.
    alias
        The variable that it is another name of, of FMI 3.0.
    derivative
        The variable whose derivative it is.
    """

    name: str
    valueReference: int
    type: str
    causality: str
    variability: str
    initial: str | None
    start: str | None
    unit: str | None
    displayUnit: str | None
    declaredType: SimpleType | None
    min: str | None
    max: str | None
    description: str | None
    sourceline: int
    derivative: Variable | None = None
    alias: Variable | None = None
    dimensions: Sequence[Dimension] = ()
    aliases: Sequence[Alias] = ()
    clocks: Sequence[Variable] = ()
    intervalVariability: str | None = None

    @property
    def identity(self) -> tuple[str, int]:
        """Base type and value reference: equal for all names of the same value, its aliases."""
        return ("Integer" if self.type == "Enumeration" else self.type, self.valueReference)

    @property
    def shape(self) -> tuple[int, ...]:
        """Size of each dimension, none of a scalar.

        Raises
        ------
        ValueError
            A size is not known.
        """
        return tuple(_size(self, dimension) for dimension in self.dimensions)


def _size(variable: Variable, dimension: Dimension) -> int:
    start = dimension.start
    if start is None and dimension.variable is not None and dimension.variable.start is not None:
        start = int(dimension.variable.start)
    if start is None:
        raise ValueError(f"has {variable.name!r} with an unknown dimension")
    return start


@dataclass(slots=True, eq=False)
class Unknown:
    """An entry of the model structure; None stands for a part that is not stated."""

    variable: Variable
    dependencies: list[Variable] | None
    dependenciesKind: list[str] | None
    sourceline: int


@dataclass(slots=True, eq=False)
class Interface:
    """An interface that an FMU offers, as far as the harness uses its description."""

    modelIdentifier: str
    needsExecutionTool: bool
    canBeInstantiatedOnlyOncePerProcess: bool
    canHandleVariableCommunicationStepSize: bool
    fixedInternalStepSize: str | None
    needsCompletedIntegratorStep: bool
    canSerializeFMUState: bool


@dataclass(slots=True, eq=False)
class DefaultExperiment:
    """How an FMU is meant to be run; texts as the file has them."""

    startTime: str | None
    stopTime: str | None
    tolerance: str | None
    stepSize: str | None


@dataclass(eq=False, kw_only=True)
class ModelDescription:
    """The model description of an FMU."""

    fmiVersion: str
    modelName: str | None
    guid: str | None
    description: str | None
    author: str | None
    version: str | None
    copyright: str | None
    license: str | None
    generationTool: str | None
    generationDateAndTime: str | None
    variableNamingConvention: str
    numberOfContinuousStates: int
    numberOfEventIndicators: int
    defaultExperiment: DefaultExperiment | None
    coSimulation: Interface | None
    modelExchange: Interface | None
    scheduledExecution: Interface | None
    unitDefinitions: Sequence[Unit]
    modelVariables: Sequence[Variable]
    outputs: Sequence[Unknown] = field(default=())
    derivatives: Sequence[Unknown] = field(default=())
    clockedStates: Sequence[Unknown] = field(default=())
    eventIndicators: Sequence[Unknown] = field(default=())
    initialUnknowns: Sequence[Unknown] = field(default=())

    @cached_property
    def names_without_numbers(self) -> list[str]:
        """`without_numbers` of the variables' names, in their order."""
        return all_without_numbers(variable.name for variable in self.modelVariables)

    @cached_property
    def by_name(self) -> dict[str, Variable | None]:
        """The variables by their names; None for a name that several have, which FMI forbids."""
        known: dict[str, Variable | None] = {variable.name: variable for variable in self.modelVariables}
        if len(known) < len(self.modelVariables):
            numbers = Counter(variable.name for variable in self.modelVariables)
            known.update((name, None) for name, number in numbers.items() if number > 1)
        return known
