"""What can be told of an FMU to people: what it can, what stands in its way."""

from __future__ import annotations

from lxml import etree

from cosim.errors import InputError
from cosim.fmu import Package, check_binary, choose_interface, interfaces
from cosim.fmu_description import PARSER
from cosim.plant.spec import CO_SIMULATION, MODEL_EXCHANGE

SCHEDULED_EXECUTION = "scheduled_execution"
NAMES = {
    CO_SIMULATION: "Co-Simulation",
    MODEL_EXCHANGE: "Model Exchange",
    SCHEDULED_EXECUTION: "Scheduled Execution",
}
"""What people call the interfaces."""
_INTERFACES = {
    "CoSimulation": CO_SIMULATION,
    "ModelExchange": MODEL_EXCHANGE,
    "ScheduledExecution": SCHEDULED_EXECUTION,
}


def capabilities(package: Package) -> dict[str, dict[str, str]]:
    """Return the attributes of each interface that an FMU offers, by the interface's name, also of those unusable here.

    FMPy does not read all of them: none of FMI 1.0, and not ``providesDirectionalDerivatives`` of FMI 3.0.
    """
    root = etree.parse(package.directory / "modelDescription.xml", PARSER).getroot()
    if package.description.fmiVersion != "1.0":
        return {
            name: dict(element.attrib) for tag, name in _INTERFACES.items() if (element := root.find(tag)) is not None
        }
    implementation = root.find("Implementation")
    if implementation is None:
        return {MODEL_EXCHANGE: {}}
    said = implementation.find(".//Capabilities")
    attributes = {} if said is None else dict(said.attrib)
    if implementation.find("CoSimulation_Tool") is not None:
        attributes["needsExecutionTool"] = "true"
    return {CO_SIMULATION: attributes}


def obstacle(package: Package) -> str:
    """Return why an FMU cannot be run on this machine; empty if it can, as far as its file tells."""
    try:
        chosen = choose_interface(package, "", None)
        check_binary(package, interfaces(package.description)[chosen].modelIdentifier, None)
    except InputError as error:
        return error.message
    return ""
