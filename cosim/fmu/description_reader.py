"""From the XML of a model description to `cosim.fmu.model_description`, for all versions of FMI.

FMPy reads them too; for the hundred thousand variables that an FMU may have, it takes three times as long.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from typing import NamedTuple

from lxml import etree

from cosim.fmu.model_description import (
    NEGATED,
    Alias,
    BaseUnit,
    DefaultExperiment,
    Dimension,
    DisplayUnit,
    Interface,
    Item,
    ModelDescription,
    SimpleType,
    Unit,
    Unknown,
    Variable,
)

_TRUE = ("true", "1")
_TYPES_1_AND_2 = ("Real", "Integer", "Boolean", "String", "Enumeration")
OPTIONAL = frozenset(
    (
        "initial",
        "fixed",
        "start",
        "unit",
        "displayUnit",
        "declaredType",
        "min",
        "max",
        "description",
        "derivative",
        "clocks",
    )
)
"""Attributes that few variables state: it takes long to ask each of many for what none of them has."""
_STARTS_INSIDE = ("String", "Binary")
"""Types of FMI 3.0 that have their start values in elements of their own."""
_INITIAL: Mapping[tuple[str, str], str | None] = {
    **dict.fromkeys((("constant", "output"), ("constant", "local")), "exact"),
    **{
        (variability, causality): initial
        for variability in ("fixed", "tunable")
        for causality, initial in (
            ("structuralParameter", "exact"),
            ("parameter", "exact"),
            ("calculatedParameter", "calculated"),
            ("local", "calculated"),
        )
    },
    **{
        (variability, causality): initial
        for variability in ("discrete", "continuous")
        for causality, initial in (("input", "exact"), ("output", "calculated"), ("local", "calculated"))
    },
    ("continuous", "independent"): None,
}
"""The default of ``initial``, by variability and causality: FMI 2.0, section 2.2.7; FMI 3.0, section 2.4.7.4."""


class _Structure(NamedTuple):
    """The entries of the model structure."""

    outputs: list[Unknown]
    derivatives: list[Unknown]
    clocked_states: list[Unknown]
    initial_unknowns: list[Unknown]
    event_indicators: list[Unknown]


def description_of(root: etree._Element, stated: Set[str] = OPTIONAL) -> ModelDescription:
    """Return a model description.

    Parameters
    ----------
    root
        Its root element.
    stated
        Those of `OPTIONAL` that occur in it.

    Raises
    ------
    ValueError, LookupError, TypeError
        It lacks a part that the standard demands, or refers to something that does not exist.
    """
    get = root.get
    version = get("fmiVersion", "")
    if version not in ("1.0", "2.0") and not version.startswith("3."):
        raise ValueError(f"Unsupported FMI version: {version}")
    major = int(version[0])
    variables, structure = (_variables_3 if major == 3 else _variables_1_and_2)(root, _types(root, major), stated)
    states = len(structure.derivatives)
    indicators = int(get("numberOfEventIndicators") or 0)
    if major == 1:
        states = int(root.attrib["numberOfContinuousStates"])
    elif major == 3:
        states, indicators = _elements(structure.derivatives), _elements(structure.event_indicators)
    for what, number in (("continuous states", states), ("event indicators", indicators)):
        if number < 0:
            raise ValueError(f"the number of {what} is {number}")
    experiment = root.find("DefaultExperiment")
    return ModelDescription(
        fmiVersion=version,
        modelName=get("modelName"),
        guid=get("instantiationToken" if major == 3 else "guid"),
        description=get("description"),
        author=get("author"),
        version=get("version"),
        copyright=get("copyright"),
        license=get("license"),
        generationTool=get("generationTool"),
        generationDateAndTime=get("generationDateAndTime"),
        variableNamingConvention=get("variableNamingConvention", "flat"),
        numberOfContinuousStates=states,
        numberOfEventIndicators=indicators,
        defaultExperiment=None
        if experiment is None
        else DefaultExperiment(*map(experiment.get, ("startTime", "stopTime", "tolerance", "stepSize"))),
        **_interfaces(root, major),
        unitDefinitions=_units(root, major),
        modelVariables=variables,
        outputs=structure.outputs,
        derivatives=structure.derivatives,
        clockedStates=structure.clocked_states,
        eventIndicators=structure.event_indicators,
        initialUnknowns=structure.initial_unknowns,
    )


def _interfaces(root: etree._Element, major: int) -> dict[str, Interface | None]:
    if major > 1:
        tags = ("CoSimulation", "ModelExchange", "ScheduledExecution")
        elements = {tag[0].lower() + tag[1:]: root.find(tag) for tag in tags}
        return {name: None if e is None else _interface(e, major) for name, e in elements.items()}
    implementation = root.find("Implementation")
    identifier = root.get("modelIdentifier")
    if implementation is None:
        exchanged = Interface(identifier, False, False, True, None, False, False)
        return {"coSimulation": None, "modelExchange": exchanged, "scheduledExecution": None}
    said = implementation.find("*/Capabilities")
    once, variable = (
        said is not None and said.get(name) in _TRUE
        for name in ("canBeInstantiatedOnlyOncePerProcess", "canHandleVariableCommunicationStepSize")
    )
    tool = implementation.find("CoSimulation_Tool") is not None
    coupled = Interface(identifier, tool, once, variable, None, False, False)
    return {"coSimulation": coupled, "modelExchange": None, "scheduledExecution": None}


def _interface(element: etree._Element, major: int) -> Interface:
    def true(name: str) -> bool:
        return element.get(name) in _TRUE

    exchange = element.tag == "ModelExchange"
    completed = not true("completedIntegratorStepNotNeeded") if major == 2 else true("needsCompletedIntegratorStep")
    return Interface(
        element.get("modelIdentifier"),
        true("needsExecutionTool"),
        true("canBeInstantiatedOnlyOncePerProcess"),
        exchange or true("canHandleVariableCommunicationStepSize"),
        element.get("fixedInternalStepSize"),
        exchange and completed,
        all(true(f"can{ability}FMU{'State' if major == 3 else 'state'}") for ability in ("GetAndSet", "Serialize")),
    )


# Units and types --------------------------------------------------------------------------------------------


def _units(root: etree._Element, major: int) -> list[Unit]:
    if major == 1:
        return [
            Unit(unit.get("unit"), None, [DisplayUnit(d.get("displayUnit")) for d in unit.iterfind("*")])
            for unit in root.iterfind("UnitDefinitions/BaseUnit")
        ]
    return [
        Unit(
            unit.get("name"),
            None if (base := unit.find("BaseUnit")) is None else _base_unit(base),
            [DisplayUnit(d.get("name")) for d in unit.iterfind("DisplayUnit")],
        )
        for unit in root.iterfind("UnitDefinitions/Unit")
    ]


def _base_unit(element: etree._Element) -> BaseUnit:
    kg, m, s, ampere, kelvin, mol, cd, rad = (
        int(element.get(symbol, "0")) for symbol in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
    )
    factor, offset = float(element.get("factor", "1")), float(element.get("offset", "0"))
    return BaseUnit(kg, m, s, ampere, kelvin, mol, cd, rad, factor, offset)


def _types(root: etree._Element, major: int) -> dict[str | None, SimpleType | None]:
    """Return the types that variables may declare, by name; no type of no name."""
    types: dict[str | None, SimpleType | None] = {None: None}
    for element in root.iterfind("TypeDefinitions/*"):
        [said, *_] = [element] if major == 3 else element.iterchildren("*")
        items = [
            Item(item.get("name"), str(number) if major == 1 else item.get("value"))
            for number, item in enumerate(said.iterfind("Item"), start=1)
        ]
        types[element.get("name")] = SimpleType(
            element.get("name"), said.get("unit"), said.get("min"), said.get("max"), items
        )
    return types


# Variables --------------------------------------------------------------------------------------------------


def _variables_1_and_2(
    root: etree._Element, types: dict[str | None, SimpleType | None], stated: Set[str]
) -> tuple[list[Variable], _Structure]:
    first = root.get("fmiVersion") == "1.0"
    found: list[Variable] = []
    derivatives: list[tuple[Variable, str]] = []
    for element in _elements_of_variables(root):
        get = element.get
        if (name := get("name")) is None:
            continue
        value = element[0]
        if (kind := value.tag) not in _TYPES_1_AND_2:
            value, kind = next((child, child.tag) for child in element if child.tag in _TYPES_1_AND_2)
        get_value = value.get
        causality, variability = get("causality", "local"), get("variability", "continuous")
        initial = get("initial") if "initial" in stated else None
        if first:
            if variability == "parameter":
                causality, variability = "parameter", "fixed"
            elif causality == "internal":
                causality = "local"
            if get("alias") == NEGATED:
                causality = NEGATED
            if "fixed" in stated and get_value("fixed") == "false":  # its start value is a guess
                initial = "approx"
        elif initial is None and (initial := _INITIAL.get((variability, causality), "")) == "":
            raise _illegal(element, causality, variability)
        declared = get_value("declaredType") if "declaredType" in stated else None
        variable = Variable(
            name,
            _reference(get("valueReference", "")),
            kind,
            causality,
            variability,
            initial,
            get_value("start") if "start" in stated else None,
            get_value("unit") if "unit" in stated else None,
            get_value("displayUnit") if "displayUnit" in stated else None,
            types[declared] if declared in types else _undeclared(element, declared),
            get_value("min") if "min" in stated else None,
            get_value("max") if "max" in stated else None,
            get("description") if "description" in stated else None,
            element.sourceline or 0,
        )
        found.append(variable)
        if "derivative" in stated and (derivative := get_value("derivative")) is not None and not first:
            derivatives.append((variable, derivative))

    def numbered(text: str) -> Variable:
        if int(text) < 1:
            raise IndexError(text)
        return found[int(text) - 1]

    for variable, text in derivatives:
        variable.derivative = numbered(text)

    def unknowns(name: str) -> list[Unknown]:
        return [_unknown(e, "index", numbered) for e in root.iterfind(f"ModelStructure/{name}/Unknown")]

    if first:
        return found, _Structure([], [], [], [], [])
    return found, _Structure(unknowns("Outputs"), unknowns("Derivatives"), [], unknowns("InitialUnknowns"), [])


def _reference(text: str) -> int:
    """Return a value reference, which FMI passes as an unsigned number of 32 bits."""
    reference = int(text)
    if not 0 <= reference < 1 << 32:
        raise ValueError(f"the value reference {text} is not within 0 to {(1 << 32) - 1}")
    return reference


def _variables_3(
    root: etree._Element, types: dict[str | None, SimpleType | None], stated: Set[str]
) -> tuple[list[Variable], _Structure]:
    found: list[Variable] = []
    derivatives: list[tuple[Variable, str]] = []
    clocked: list[tuple[Variable, str]] = []
    arrays: list[tuple[Variable, Sequence[etree._Element]]] = []
    for element in _elements_of_variables(root):
        get, kind = element.get, element.tag
        if (name := get("name")) is None:
            continue
        causality, variability = get("causality", "local"), get("variability")
        initial = get("initial") if "initial" in stated else None
        if variability is None:
            if causality.lower().endswith("parameter"):
                variability = "fixed"
            else:
                variability = "continuous" if kind in ("Float64", "Float32") else "discrete"
        if initial is None and (initial := _INITIAL.get((variability, causality), "")) == "":
            raise _illegal(element, causality, variability)
        declared = get("declaredType") if "declaredType" in stated else None
        variable = Variable(
            name,
            _reference(get("valueReference", "")),
            kind,
            causality,
            variability,
            initial,
            get("start") if kind not in _STARTS_INSIDE else None,
            get("unit") if "unit" in stated else None,
            get("displayUnit") if "displayUnit" in stated else None,
            types[declared] if declared in types else _undeclared(element, declared),
            get("min") if "min" in stated else None,
            get("max") if "max" in stated else None,
            get("description") if "description" in stated else None,
            element.sourceline or 0,
        )
        found.append(variable)
        if "derivative" in stated and (derivative := get("derivative")) is not None:
            derivatives.append((variable, derivative))
        if "clocks" in stated and (clocks := get("clocks")) is not None:
            clocked.append((variable, clocks))
        if kind == "Clock":
            variable.intervalVariability = get("intervalVariability")
        if len(element):
            variable.aliases = [
                Alias(alias.attrib["name"], alias.get("description"), alias.get("displayUnit"))
                for alias in element.iterfind("Alias")
            ]
            if kind in _STARTS_INSIDE and (start := element.find("Start")) is not None:
                variable.start = start.get("value")
            if dimensions := element.findall("Dimension"):
                arrays.append((variable, dimensions))
    known = {variable.valueReference: variable for variable in found}

    def referred(text: str) -> Variable:
        return known[int(text)]

    for variable, elements in arrays:
        variable.dimensions = [
            Dimension(None, referred(e.attrib["valueReference"])) if start is None else Dimension(int(start), None)
            for e in elements
            for start in (e.get("start"),)
        ]
    for variable, text in derivatives:
        variable.derivative = referred(text)
    for variable, text in clocked:
        variable.clocks = [referred(reference) for reference in text.split()]
    found += [_by_another_name(variable, alias) for variable in found for alias in variable.aliases]

    def unknowns(name: str) -> list[Unknown]:
        return [_unknown(e, "valueReference", referred) for e in root.iterfind(f"ModelStructure/{name}")]

    tags = ("Output", "ContinuousStateDerivative", "ClockedState", "InitialUnknown", "EventIndicator")
    return found, _Structure(*map(unknowns, tags))


def _elements_of_variables(root: etree._Element) -> Iterable[etree._Element]:
    variables = root.find("ModelVariables")
    if variables is None:
        raise ValueError("it has no <ModelVariables>")
    elements: Iterable[etree._Element] = variables.iterchildren("*")
    return elements


def _illegal(element: etree._Element, causality: str, variability: str) -> ValueError:
    return ValueError(
        f'Variable "{element.get("name")}" (line {element.sourceline}) has an illegal combination of '
        f'causality="{causality}" and variability="{variability}".'
    )


def _undeclared(element: etree._Element, declared: str | None) -> SimpleType:
    raise ValueError(
        f'Variable "{element.get("name")}" (line {element.sourceline}) has declaredType="{declared}" '
        "which has not been defined."
    )


def _by_another_name(variable: Variable, alias: Alias) -> Variable:
    """Return a variable by another name that it has."""
    return Variable(
        alias.name,
        variable.valueReference,
        variable.type,
        variable.causality,
        variable.variability,
        variable.initial,
        variable.start,
        variable.unit,
        alias.displayUnit or variable.displayUnit,
        variable.declaredType,
        variable.min,
        variable.max,
        alias.description or variable.description,
        variable.sourceline,
        variable.derivative,
        variable,
        variable.dimensions,
        variable.aliases,
        variable.clocks,
        variable.intervalVariability,
    )


# The model structure ----------------------------------------------------------------------------------------


def _unknown(element: etree._Element, attribute: str, variable_of: Callable[[str], Variable]) -> Unknown:
    dependencies, kinds = element.get("dependencies"), element.get("dependenciesKind")
    return Unknown(
        variable_of(element.attrib[attribute]),
        None if dependencies is None else list(map(variable_of, dependencies.split())),
        None if kinds is None else kinds.split(),
        element.sourceline or 0,
    )


def _elements(unknowns: Iterable[Unknown]) -> int:
    """Return of how many numbers the variables of some unknowns are made."""
    return sum(math.prod(unknown.variable.shape) for unknown in unknowns)
