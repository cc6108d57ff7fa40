"""An SSP from anywhere, checked and read into plain data; its files are unpacked into a folder.

Components are FMUs in one flat system, as FMPy, libcosim and ecos take them too.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlsplit

from lxml import etree

from cosim.errors import InputError, Location, nearest
from cosim.fmu.archive import Sort, unpack
from cosim.scenario.xml_tree import parsed
from cosim.ssp.document import OSP, OWN
from cosim.ssp.structure import (
    DESCRIPTION,
    FMU_TYPE,
    IMPLEMENTATIONS,
    NAMESPACES,
    VERSIONS,
    Component,
    Connection,
    Connector,
    Facts,
    Parameter,
    Structure,
    Units,
)
from plants import UnitError, units

SSP = Sort("SSP", DESCRIPTION, "system description", (DESCRIPTION,))

MAX_ELEMENTS = 1_000_000
"""Of a file; a thousand robots have a tenth of that."""

_TYPES = ("Real", "Float64", "Float32", "Integer", "Boolean", "String", "Enumeration")
_SCALES = {"Float64": "Real", "Float32": "Real", "Enumeration": "String"}
_Units = dict[str, tuple[tuple[int, ...], float]]


def read_ssp(path: Path, directory: Path) -> Structure:
    """Unpack an SSP into an empty folder, and read its system.

    Raises
    ------
    InputError
        It is no SSP, or one that cannot be read here; with the file, the line and the element.
    """
    unpack(path, directory, sort=SSP)
    return _Reader(path, directory).structure()


def parameters_of(path: Path, directory: Path, name: str) -> tuple[list[Parameter], Units]:
    """Return the parameters of a file with a set, and their units, in the folder in which an SSP is unpacked.

    Raises
    ------
    InputError
        The file is no parameter set.
    """
    return _Reader(path, directory).parameters(name)


class _Reader:
    """Reads the files of one SSP.

    Parameters
    ----------
    path
        The SSP, for messages.
    directory
        Where it is unpacked.
    """

    def __init__(self, path: Path, directory: Path) -> None:
        self._path, self._directory = path, directory
        self._places: dict[etree._Element, Location] = {}

    def structure(self) -> Structure:
        root = self._root(DESCRIPTION, "ssd:SystemStructureDescription")
        version = root.get("version", "")
        if version not in VERSIONS and not version.startswith("1."):
            raise self._error(root, f"has version {version!r}; versions {' and '.join(VERSIONS)} are read")
        system = root.find(_tag("ssd:System"))
        if system is None:
            raise self._error(root, "has no <System>")
        units_here = self._units(root, {}, "ssd:Units")
        components = [self._component(element, units_here) for element in self._elements(system)]
        names = set[str]()
        for component in components:
            if component.name in names:
                raise InputError(f"<Component>: {component.name!r} is the name of two components", component.where)
            names.add(component.name)
        self._spread(system, components, units_here)
        experiment = root.find(_tag("ssd:DefaultExperiment"))
        step = root.find(f".//{{{OSP}}}FixedStepAlgorithm")
        begin = 0.0 if experiment is None else self._number(experiment, "startTime", 0.0)
        if begin != 0.0:
            assert experiment is not None
            raise self._error(experiment, f"starts at {begin:g} s; a scenario starts at 0 s")
        return Structure(
            name=root.get("name", ""),
            description=system.get("description", ""),
            components=tuple(components),
            connections=tuple(self._connections(system, names)),
            units=units_here,
            stop=0.0 if experiment is None else self._positive(experiment, "stopTime"),
            step=0.0 if step is None else self._positive(step, "baseStepSize"),
            version=version,
            facts=self._facts(root),
            stop_where=None if experiment is None else self._places[experiment],
            step_where=None if step is None else self._places[step],
        )

    def parameters(self, name: str) -> tuple[list[Parameter], Units]:
        known: _Units = {}
        return self._parameters(self._root(name, "ssv:ParameterSet"), known), known

    # Components

    def _elements(self, system: etree._Element) -> Iterator[etree._Element]:
        elements = system.find(_tag("ssd:Elements"))
        for element in elements if elements is not None else ():
            if element.tag == _tag("ssd:System"):
                raise self._error(
                    element,
                    "is a system within the system: only flat systems are read, so move its components up into the "
                    "system above",
                )
            if element.tag != _tag("ssd:Component"):
                raise self._error(element, "is no <Component>: only components that are FMUs are read")
            yield element

    def _component(self, element: etree._Element, known: _Units) -> Component:
        if not (name := element.get("name", "")):
            raise self._error(element, "has no name")
        if (kind := element.get("type") or FMU_TYPE) != FMU_TYPE:
            raise self._error(element, f"is of type {kind!r}; only FMUs are read, {FMU_TYPE}")
        if (implementation := element.get("implementation", IMPLEMENTATIONS[0])) not in IMPLEMENTATIONS:
            said = f"has implementation={implementation!r}; read are {', '.join(IMPLEMENTATIONS)}"
            raise self._error(element, said)
        source = self._source(element, "FMU")
        parameters, files = [], []
        for binding in element.iterfind(f"{_tag('ssd:ParameterBindings')}/{_tag('ssd:ParameterBinding')}"):
            parameters += self._binding(binding, known)
            files.append(binding.get("source", ""))
        if len(element.findall(_tag("ssd:ParameterBindings"))) > 1:
            raise self._error(element, "has <ParameterBindings> twice")
        return Component(
            name=name,
            source=source,
            connectors=tuple(
                self._connector(connector, known)
                for connector in element.iterfind(f"{_tag('ssd:Connectors')}/{_tag('ssd:Connector')}")
            ),
            parameters=tuple(_last(parameters)),
            parameters_source=files[0] if len(files) == 1 else "",
            description=element.get("description", ""),
            where=self._places[element],
            implementation=implementation,
        )

    def _connector(self, element: etree._Element, known: _Units) -> Connector:
        kind = next((child for child in element if _local(child) in _TYPES), None)
        unit = "" if kind is None else kind.get("unit", "")
        if unit and unit not in known:
            known[unit] = self._unit_by_name(element, unit)
        name = "Real" if kind is None else _local(kind)
        return Connector(element.get("name", ""), element.get("kind", ""), _SCALES.get(name, name), unit)

    def _source(self, element: etree._Element, what: str) -> str:
        """Return the path in the SSP to which a source refers, which is there."""
        written = element.get("source", "")
        if not written:
            raise self._error(element, f"names no {what}: source=... is missing")
        try:
            parts = urlsplit(written)
        except ValueError as error:  # such as http://[
            raise self._error(element, f"names the {what} {written!r}, which is no place of a file: {error}") from None
        place = PurePosixPath(unquote(parts.path))
        if parts.scheme or parts.netloc or parts.query or parts.fragment or place.is_absolute() or ".." in place.parts:
            raise self._error(element, f"names the {what} {written!r}; only files in the SSP itself are read")
        if not os.path.isfile(self._directory / place):  # pathlib raises an error for a name that is too long
            raise self._error(element, f"names the {what} {written!r}, which is not in the SSP")
        return place.as_posix()

    # Parameters

    def _binding(self, binding: etree._Element, known: _Units) -> list[Parameter]:
        if binding.find(_tag("ssd:ParameterMapping")) is not None:
            raise self._error(
                binding, "has a <ParameterMapping>, which is not read: name the parameters as the FMU does"
            )
        if binding.get("sourceBase", "SSD") != "SSD":
            raise self._error(binding, "has its source within an FMU, which is not read: put the file into the SSP")
        prefix = binding.get("prefix", "")
        if binding.get("source"):
            root = self._root(self._source(binding, "parameter set"), "ssv:ParameterSet")
        else:
            found = binding.find(f"{_tag('ssd:ParameterValues')}/{_tag('ssv:ParameterSet')}")
            if found is None:
                raise self._error(binding, "has neither a source nor <ParameterValues>")
            root = found
        return self._parameters(root, known, prefix)

    def _parameters(self, root: etree._Element, known: _Units, prefix: str = "") -> list[Parameter]:
        own = self._units(root, known, "ssv:Units")
        for name, unit in own.items():
            if known.setdefault(name, unit) != unit:
                raise self._error(root, f"defines the unit {name!r} otherwise than the system does")
        found = []
        for element in root.iterfind(f"{_tag('ssv:Parameters')}/{_tag('ssv:Parameter')}"):
            name = element.get("name", "")
            value = next((child for child in element if _local(child) in _TYPES), None)
            if not name or value is None:
                raise self._error(
                    element, "has no name" if not name else f"has no value that is read ({', '.join(_TYPES)})"
                )
            unit = value.get("unit", "")
            if unit and unit not in known:
                known[unit] = self._unit_by_name(value, unit)
            kind = _SCALES.get(_local(value), _local(value))
            found.append(Parameter(prefix + name, kind, self._value(value, kind), unit, self._places[element]))
        return found

    def _value(self, element: etree._Element, kind: str) -> float | int | bool | str:
        text: str = element.get("value", "")
        if kind == "Real":
            return self._number(element, "value")
        if kind == "Integer":
            try:
                return int(text)
            except ValueError:
                raise self._error(element, f"has the value {text!r}, which is no whole number") from None
        if kind == "Boolean":
            if text not in ("true", "false", "1", "0"):
                raise self._error(element, f"has the value {text!r}, which is neither true nor false")
            return text in ("true", "1")
        return text

    def _spread(self, system: etree._Element, components: list[Component], known: _Units) -> None:
        """Give components the parameters that are bound to the system, by names that begin with the component's."""
        path = f"{_tag('ssd:ParameterBindings')}/{_tag('ssd:ParameterBinding')}"
        for binding in system.iterfind(path):
            for parameter in self._binding(binding, known):
                fitting = [n for n, c in enumerate(components) if parameter.name.startswith(f"{c.name}.")]
                if not fitting:
                    raise InputError(
                        f"<Parameter>: {parameter.name!r} belongs to no component of the system: "
                        f"{nearest(parameter.name, [component.name for component in components])}",
                        parameter.where,
                    )
                place = max(fitting, key=lambda n: len(components[n].name))
                found = components[place]
                own = replace(parameter, name=parameter.name[len(found.name) + 1 :])
                components[place] = replace(found, parameters=tuple(_last([*found.parameters, own])))

    # Units

    def _units(self, root: etree._Element, known: Mapping[str, object], tag: str) -> _Units:
        found: _Units = {}
        for element in root.iterfind(f"{_tag(tag)}/{_tag('ssc:Unit')}"):
            name, base = element.get("name", ""), element.find(_tag("ssc:BaseUnit"))
            if base is None:
                found[name] = self._unit_by_name(element, name)
                continue
            factor, offset = self._number(base, "factor", 1.0), self._number(base, "offset", 0.0)
            if offset != 0.0 or not 0.0 < factor < math.inf:
                raise self._error(
                    element, f"{name!r} has an offset or a factor that is not positive, so it is not read"
                )
            exponents = [self._number(base, unit, 0.0) for unit in units.BASE_UNITS]
            if not all(exponent.is_integer() for exponent in exponents):
                raise self._error(element, f"{name!r} has an exponent that is no whole number, so it is not read")
            found[name] = (tuple(map(int, exponents)), factor)
        return found

    def _unit_by_name(self, element: etree._Element, name: str) -> tuple[tuple[int, ...], float]:
        try:
            unit = units.parse(name)
        except UnitError as error:
            raise self._error(element, f"has the unit {name!r}, which the SSP does not define: {error}") from None
        return unit.exponents, unit.factor

    # Connections, and the rest

    def _connections(self, system: etree._Element, known: set[str]) -> Iterator[Connection]:
        for element in system.iterfind(f"{_tag('ssd:Connections')}/{_tag('ssd:Connection')}"):
            start, end = element.get("startElement", ""), element.get("endElement", "")
            for name in (start, end):
                if name and name not in known:
                    raise self._error(
                        element, f"names the element {name!r}, which is not there: {nearest(name, [*known])}"
                    )
            linear = element.find(_tag("ssc:LinearTransformation"))
            factor = 1.0 if linear is None else self._number(linear, "factor", 1.0)
            if linear is not None and factor == 0.0:
                raise self._error(linear, 'has factor="0", by which nothing is connected: leave the connection out')
            offset = 0.0 if linear is None else self._number(linear, "offset", 0.0)
            more = [etree.tostring(child, method="c14n", with_tail=False).decode() for child in _transformed(element)]
            if (factor, offset) != (1.0, 0.0) and element.get("suppressUnitConversion") not in ("true", "1"):
                more.append("its unit is converted")
            yield Connection(
                (start, element.get("startConnector", "")),
                (end, element.get("endConnector", "")),
                factor,
                offset,
                self._places[element],
                tuple(more),
            )

    def _facts(self, root: etree._Element) -> Facts | None:
        element = root.find(f".//{{{OWN}}}Scenario")
        if element is None:
            return None
        files = {file.get("source", ""): file.get("sha256", "") for file in element.iterfind(f"{{{OWN}}}File")}
        return Facts(self._source(element, "scenario"), files, element.get("connections", ""))

    def _root(self, name: str, tag: str) -> etree._Element:
        shown = Path(f"{self._path}/{name}")
        try:
            data = (self._directory / name).read_bytes()
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}", Location(str(shown))) from None
        what = "system description" if tag.startswith("ssd:") else "parameter set"
        root, places = parsed(data, shown, what, MAX_ELEMENTS)
        self._places |= places
        if root.tag != _tag(tag):
            raise self._error(root, f"is no {what} of SSP: expected <{tag}> in the namespace {NAMESPACES[tag[:3]]}")
        return root

    def _number(self, element: etree._Element, name: str, missing: float | None = None) -> float:
        text = element.get(name)
        if text is None and missing is not None:
            return missing
        try:
            number = float(text or "") if "_" not in (text or "") else math.nan  # as in 1_000, which XML does not know
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise self._error(element, f'has {name}="{text or ""}", which is no number')
        return number

    def _positive(self, element: etree._Element, name: str) -> float:
        """Return a positive number; 0 if none is stated."""
        number = self._number(element, name, 0.0)
        if name in element.attrib and number <= 0.0:
            raise self._error(element, f'has {name}="{element.get(name)}", which is not positive')
        return number

    def _error(self, element: etree._Element, sentence: str) -> InputError:
        name = element.get("name")
        named = f"<{_local(element)}" + (f' name="{name}">' if name else ">")
        return InputError(f"{named} {sentence}", self._places[element])


def _last(parameters: list[Parameter]) -> list[Parameter]:
    """Return one parameter for each name: the last, which takes precedence."""
    return list({parameter.name: parameter for parameter in parameters}.values())


def _transformed(connection: etree._Element) -> Iterator[etree._Element]:
    """Yield what a connection does with its value, besides a linear transformation."""
    for child in connection.iterchildren("*"):
        if _local(child) not in ("LinearTransformation", "ConnectionGeometry", "Annotations"):
            yield child


def _tag(name: str) -> str:
    prefix, _, local = name.partition(":")
    return f"{{{NAMESPACES[prefix]}}}{local}"


def _local(element: etree._Element) -> str:
    return str(element.tag).rpartition("}")[2]
