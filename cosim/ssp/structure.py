"""A system of FMUs as plain data: the part of SSP (System Structure and Parameterization) that a formation needs."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from cosim.errors import InputError, Location
from plants import units

NAMESPACES: Mapping[str, str] = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "ssm": "http://ssp-standard.org/SSP1/SystemStructureParameterMapping",
}
"""The namespaces of both versions. Some tools go by the prefixes alone, so that these are the only ones to write."""

DESCRIPTION = "SystemStructure.ssd"
"""The file of an SSP that describes the system."""

RESOURCES = "resources"
"""The folder of an SSP with everything that the description refers to."""

VERSIONS = ("1.0", "2.0")
"""The versions of SSP that are written and read."""

FMU_TYPE = "application/x-fmu-sharedlibrary"
"""The type of a component that is an FMU, which is also the type of one that states none."""


IMPLEMENTATIONS = ("any", "CoSimulation", "ModelExchange")
"""The interfaces of an FMU that a component may ask for, the one of a component that states none first."""

Units = Mapping[str, tuple[tuple[int, ...], float]]
"""Units by name: the exponents of the base units, in the order of `plants.units.BASE_UNITS`, and the factor."""

PURE_NUMBER = (units.Unit().exponents, 1.0)
"""The unit of a number without one, as `Units` has it."""

_ROUNDED = 5e-4
"""Relative difference of the factors of a unit that the SSP and the FMU define with digits of their own."""


@dataclass(frozen=True)
class Connector:
    """A variable of a component that can be connected.

    Attributes
    ----------
    kind : str
        ``input``, ``output`` or another one of the standard.
    type : str
        ``Real``, ``Integer``, ``Boolean`` or another one of the standard.
    unit : str
        The name of its unit; empty for none.
    """

    name: str
    kind: str
    type: str = "Real"
    unit: str = ""


@dataclass(frozen=True)
class Parameter:
    """A value that a variable of a component has from the start.

    Attributes
    ----------
    type : str
        ``Real``, ``Integer``, ``Boolean`` or ``String``.
    unit : str
        The name of the unit of the value; empty for none.
    where : Location or None
        Its place in the file; None if it was not read.
    """

    name: str
    type: str
    value: float | int | bool | str
    unit: str = ""
    where: Location | None = field(default=None, compare=False)

    @property
    def text(self) -> str:
        """Its value as XML has it, to the last bit."""
        if isinstance(self.value, bool):
            return str(self.value).lower()
        return repr(self.value) if isinstance(self.value, float) else str(self.value)

    @property
    def number(self) -> float:
        """Its value as a number.

        Raises
        ------
        InputError
            It is a text or a truth value.
        """
        if isinstance(self.value, bool | str):
            raise InputError(f"<Parameter>: {self.name!r} is {self.text!r}, where a number is needed", self.where)
        return float(self.value)

    def in_unit(self, name: str, exponents: tuple[int, ...], factor: float, known: Units) -> float:
        """Return its value as a number in a unit; without a unit of its own it is in that one.

        Parameters
        ----------
        name, exponents, factor
            The unit.
        known
            The units of the SSP.

        Raises
        ------
        InputError
            It is no number, or in the unit of another quantity.
        """
        if not self.unit:
            return self.number
        own_exponents, own_factor = known[self.unit]
        if self.unit == name and math.isclose(own_factor, factor, rel_tol=_ROUNDED):
            angle = units.BASE_UNITS.index("rad")  # angles may be defined as pure numbers
            if all(n == m for place, (n, m) in enumerate(zip(own_exponents, exponents, strict=True)) if place != angle):
                return self.number
        if own_exponents != exponents:
            raise InputError(
                f"<Parameter>: {self.name!r} is in {self.unit!r}, and the FMU has it in {name!r}, which is another "
                "quantity",
                self.where,
            )
        if not math.isfinite(value := self.number * (own_factor / factor)):
            raise InputError(
                f"<Parameter>: {self.name!r} is {self.number:g} in {self.unit!r}, and no finite number in {name!r}",
                self.where,
            )
        return value


@dataclass(frozen=True)
class Component:
    """A component.

    Attributes
    ----------
    source : str
        The path of its FMU in the SSP.
    connectors : tuple of Connector
        Its connectors.
    parameters : tuple of Parameter
        Its parameter set.
    parameters_source : str
        The path of the parameter set in the SSP; empty if it stands in the description.
    where : Location or None
        Its place in the file; None if it was not read.
    implementation : str
        The interface of the FMU that is to be used, one of `IMPLEMENTATIONS`.
    """

    name: str
    source: str
    connectors: tuple[Connector, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    parameters_source: str = ""
    description: str = ""
    where: Location | None = field(default=None, compare=False)
    implementation: str = "CoSimulation"

    @property
    def units(self) -> tuple[str, ...]:
        """The units of its connectors and parameters."""
        used = [*(one.unit for one in self.connectors), *(one.unit for one in self.parameters)]
        return tuple(unit for unit in used if unit)


@dataclass(frozen=True)
class Connection:
    """A connection from an output to an input: ``input = factor * output + offset``.

    Attributes
    ----------
    more : tuple of str
        What else is done with the value, as XML or in words; Formation writes nothing of this kind.
    """

    start: tuple[str, str]
    end: tuple[str, str]
    factor: float = 1.0
    offset: float = 0.0
    where: Location | None = field(default=None, compare=False)
    more: tuple[str, ...] = ()


@dataclass(frozen=True)
class Facts:
    """What an SSP of Formation states of itself, so that it can be read again.

    Attributes
    ----------
    scenario : str
        The path of the scenario in the SSP.
    sha256 : dict
        The checksum of each file that was written, by its path in the SSP.
    connections : str
        A checksum of the connections that were written.
    """

    scenario: str
    sha256: Mapping[str, str]
    connections: str


@dataclass(frozen=True)
class Structure:
    """A system.

    Attributes
    ----------
    version : str
        One of `VERSIONS`.
    units : dict
        The units that are used; see `Units`.
    stop : float
        The end of the default experiment, which starts at 0 [s]; 0 if none is stated.
    step : float
        The communication step [s] that libcosim is told; 0 if none is stated.
    stop_where, step_where : Location or None
        The elements that state them.
    facts : Facts or None
        What Formation states of the system; None of a system that Formation has not written.
    """

    name: str
    description: str
    components: tuple[Component, ...]
    connections: tuple[Connection, ...]
    units: Units
    stop: float
    step: float
    version: str = "1.0"
    facts: Facts | None = None
    stop_where: Location | None = field(default=None, compare=False)
    step_where: Location | None = field(default=None, compare=False)

    @property
    def connected(self) -> str:
        """A checksum of its connections, whatever their order; an offset of -0.0 is one of 0.0."""
        lines = sorted(repr((c.start, c.end, c.factor, c.offset + 0.0, *c.more)) for c in self.connections)
        return hashlib.sha256("\n".join(lines).encode()).hexdigest()

    @cached_property
    def by_name(self) -> dict[str, Component]:
        """The components by their names."""
        return {component.name: component for component in self.components}

    def used_units(self) -> Iterator[str]:
        """Yield the units of connectors and parameters, each once, in the order of their first use."""
        found: dict[str, None] = {}
        for component in self.components:
            found |= dict.fromkeys(component.units)
        yield from found
