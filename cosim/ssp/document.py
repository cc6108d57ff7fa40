"""The files of an SSP: from a system as plain data to XML, and to the archive."""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import replace
from importlib.metadata import version as version_of
from io import FileIO
from pathlib import Path

from lxml import etree

from cosim.errors import printable
from cosim.ssp.structure import (
    DESCRIPTION,
    FMU_TYPE,
    NAMESPACES,
    Component,
    Connection,
    Connector,
    Facts,
    Parameter,
    Structure,
)
from plants import units

OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
OSP_TYPE = "com.opensimulationplatform"
"""Namespace and type of the annotation by which libcosim is told its step."""

OWN = "urn:formation-cosim:ssp:1"
OWN_TYPE = "org.formation-cosim"
"""Namespace and type of the annotation in which Formation states from what the system was made."""

PARAMETER_SET = "scenario"
"""The name of the parameter sets, which ecos asks for."""

ALL_PARAMETERS = "resources/parameters.ssv"
"""All parameters in one set, for a program that takes one for the whole system."""

SCENARIO = "resources/scenario.xml"
"""The scenario from which the system was made."""

_TIME = (1980, 1, 1, 0, 0, 0)
"""The time of each entry of the archive: the same system is the same file."""
_MAPS = {**NAMESPACES, "osp": OSP, "formation": OWN}


def write_archive(file: FileIO, structure: Structure, content: Mapping[str, Path | bytes]) -> None:
    """Write an SSP.

    Parameters
    ----------
    file
        The archive, open to be written.
    structure
        The system.
    content
        Other files of the archive by their paths in it: FMUs, and the scenario at `SCENARIO` with its files.
    """
    files = {**parameter_sets(structure), **content}
    facts = Facts(SCENARIO, {name: _sha256(data) for name, data in files.items()}, structure.connected)
    files = {DESCRIPTION: description(replace(structure, facts=facts)), **files}
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            packed = zipfile.ZIP_STORED if name.endswith(".fmu") else zipfile.ZIP_DEFLATED  # it is an archive itself
            entry = zipfile.ZipInfo(name, _TIME)
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, data if isinstance(data, bytes) else data.read_bytes(), packed)


def parameter_sets(structure: Structure) -> dict[str, Path | bytes]:
    """Return the parameter sets of a system by their paths in the SSP: of each component, and of all together."""
    sets: dict[str, Path | bytes] = {
        component.parameters_source: parameter_set(PARAMETER_SET, component.parameters, structure)
        for component in structure.components
        if component.parameters_source
    }
    return {**sets, ALL_PARAMETERS: parameter_set(PARAMETER_SET, _of_all(structure.components), structure)}


def _sha256(content: Path | bytes) -> str:
    return hashlib.sha256(content if isinstance(content, bytes) else content.read_bytes()).hexdigest()


def _of_all(components: Iterable[Component]) -> list[Parameter]:
    """Return the parameters of all components, named after them."""
    return [
        Parameter(f"{component.name}.{parameter.name}", parameter.type, parameter.value, parameter.unit)
        for component in components
        for parameter in component.parameters
    ]


def description(structure: Structure) -> bytes:
    """Return the description of a system."""
    root = _root("ssd:SystemStructureDescription", structure.version, structure.name)
    system = _add(root, "ssd:System", name=structure.name, description=structure.description)
    elements = _add(system, "ssd:Elements")
    for component in structure.components:
        _component(elements, component, structure.version)
    connections = _add(system, "ssd:Connections")
    unit_of = {(of.name, connector.name): connector.unit for of in structure.components for connector in of.connectors}
    for connection in structure.connections:
        _connection(connections, connection, unit_of[connection.start] == unit_of[connection.end])
    if structure.units:
        _units(_add(root, "ssd:Units"), structure.used_units(), structure)
    experiment = _add(root, "ssd:DefaultExperiment", startTime="0", stopTime=repr(structure.stop))
    annotation = _add(_add(experiment, "ssd:Annotations"), "ssc:Annotation", type=OSP_TYPE)
    _add(_add(annotation, "osp:Algorithm"), "osp:FixedStepAlgorithm", baseStepSize=repr(structure.step))
    if structure.facts is not None:
        _facts(_add(_add(root, "ssd:Annotations"), "ssc:Annotation", type=OWN_TYPE), structure.facts)
    return _text(root)


def parameter_set(name: str, parameters: Iterable[Parameter], structure: Structure) -> bytes:
    """Return a parameter set as a file, with the units that it needs."""
    root = _root("ssv:ParameterSet", structure.version, name)
    listed = _add(root, "ssv:Parameters")
    used: dict[str, None] = {}
    for parameter in parameters:
        unit = {"unit": parameter.unit} if parameter.unit else {}
        _add(_add(listed, "ssv:Parameter", name=parameter.name), f"ssv:{parameter.type}", value=parameter.text, **unit)
        used |= dict.fromkeys(unit.values())
    if used:
        _units(_add(root, "ssv:Units"), used, structure)
    return _text(root)


def _component(elements: etree._Element, component: Component, version: str) -> None:
    told = {"description": component.description} if component.description else {}
    element = _add(
        elements,
        "ssd:Component",
        name=component.name,
        type=FMU_TYPE,
        source=component.source,
        implementation="CoSimulation",
        **told,
    )
    if component.connectors:
        connectors = _add(element, "ssd:Connectors")
        for connector in component.connectors:
            _connector(connectors, connector)
    if component.parameters_source:
        bindings = _add(element, "ssd:ParameterBindings")
        source = component.parameters_source
        _add(bindings, "ssd:ParameterBinding", type="application/x-ssp-parameter-set", source=source)


def _connector(connectors: etree._Element, connector: Connector) -> None:
    element = _add(connectors, "ssd:Connector", name=connector.name, kind=connector.kind)
    _add(element, f"ssc:{connector.type}", **({"unit": connector.unit} if connector.unit else {}))


def _connection(connections: etree._Element, connection: Connection, same_unit: bool) -> None:
    (start, output), (end, into) = connection.start, connection.end
    element = _add(
        connections, "ssd:Connection", startElement=start, startConnector=output, endElement=end, endConnector=into
    )
    changes = (connection.factor, connection.offset) != (1.0, 0.0)
    if changes or not same_unit:
        element.set("suppressUnitConversion", "true")  # the factor holds the conversion, also where it is 1
    if changes:
        factor, offset = repr(connection.factor), repr(connection.offset)
        _add(element, "ssc:LinearTransformation", factor=factor, offset=offset)


def _units(element: etree._Element, used: Iterable[str], structure: Structure) -> None:
    for name in used:
        exponents, factor = structure.units[name]
        base = {unit: str(n) for unit, n in zip(units.BASE_UNITS, exponents, strict=True) if n}
        _add(_add(element, "ssc:Unit", name=name), "ssc:BaseUnit", **base, factor=repr(factor))


def _facts(annotation: etree._Element, facts: Facts) -> None:
    element = _add(annotation, "formation:Scenario", source=facts.scenario, connections=facts.connections)
    for name, sha256 in facts.sha256.items():
        _add(element, "formation:File", source=name, sha256=sha256)


def _root(tag: str, version: str, name: str) -> etree._Element:
    prefixes = ("ssd", "ssc", "ssv", "osp", "formation") if tag.startswith("ssd:") else ("ssv", "ssc")
    root = etree.Element(_qualified(tag), nsmap={prefix: _MAPS[prefix] for prefix in prefixes})
    root.set("version", version)
    root.set("name", printable(name))
    root.set("generationTool", f"Formation {version_of('formation-cosim')}")
    return root


def _add(parent: etree._Element, tag: str, **attributes: str) -> etree._Element:
    texts = {name: printable(text) for name, text in attributes.items()}
    return etree.SubElement(parent, _qualified(tag), texts)


def _qualified(tag: str) -> str:
    prefix, _, name = tag.partition(":")
    return f"{{{_MAPS[prefix]}}}{name}"


def _text(root: etree._Element) -> bytes:
    etree.indent(root)
    text: bytes = etree.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"
