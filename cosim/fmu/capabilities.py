"""Facts about an FMU in words: its interfaces, and reasons why it cannot run here."""

from __future__ import annotations

from cosim.errors import InputError
from cosim.fmu.binaries import check_binary
from cosim.fmu.description import SCHEDULED_EXECUTION
from cosim.fmu.interfaces import choose_interface, interfaces
from cosim.fmu.package import Package
from cosim.plant.spec import CO_SIMULATION, MODEL_EXCHANGE

NAMES = {
    CO_SIMULATION: "Co-Simulation",
    MODEL_EXCHANGE: "Model Exchange",
    SCHEDULED_EXECUTION: "Scheduled Execution",
}
"""Names of the interfaces in messages."""


def obstacle(package: Package) -> str:
    """Return why an FMU cannot be run on this machine; empty if nothing in its file speaks against it."""
    try:
        chosen = choose_interface(package, "", None)
        check_binary(package, interfaces(package.description)[chosen].modelIdentifier, None)
    except InputError as error:
        return error.message
    return ""
