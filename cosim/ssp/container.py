"""The whole formation as one FMU, for programs that take a single one: a container of the FMU Manipulation Toolbox."""

from __future__ import annotations

import logging
import zipfile
from collections.abc import Mapping
from pathlib import Path

from lxml import etree

from cosim.errors import InputError
from cosim.ssp.structure import Structure

_MISSING = (
    "one FMU with the whole formation is made by the FMU Manipulation Toolbox, which is not installed: "
    'pip install "formation-cosim[container]"'
)


def write_container(file: Path, structure: Structure, content: Mapping[str, Path | bytes], folder: Path) -> None:
    """Write a system as one FMU (FMI 2.0), whose outputs are those of its components, as in ``follower_1.x``.

    Parameters
    ----------
    file
        The FMU to write.
    structure, content
        The system, and its FMUs by their paths in an SSP.
    folder
        An empty folder to work in.

    Raises
    ------
    InputError
        The toolbox is not installed, or cannot hold such a system.
    """
    try:
        from fmu_manipulation_toolbox.assembly import AssemblyNode
        from fmu_manipulation_toolbox.container import FMUContainerError
    except ImportError:
        raise InputError(_MISSING) from None
    for connection in structure.connections:
        if (connection.factor, connection.offset) != (1.0, 0.0):
            raise InputError(
                f"the connection from {'.'.join(connection.start)} to {'.'.join(connection.end)} has a factor or an "
                "offset, which a container cannot have: it needs plants whose variables are in the roles' units"
            )
    logging.getLogger("fmu_manipulation_toolbox").setLevel(logging.CRITICAL)
    node = AssemblyNode("formation.fmu", step_size=structure.step, auto_link=False, auto_input=False, auto_output=False)
    for component in structure.components:
        data = content[component.source]
        (folder / f"{component.name}_fmu.fmu").write_bytes(data if isinstance(data, bytes) else data.read_bytes())
        node.add_fmu(f"{component.name}_fmu.fmu")
        for connector in component.connectors:
            if connector.kind == "output":
                node.add_output(f"{component.name}_fmu.fmu", connector.name, f"{component.name}.{connector.name}")
        for parameter in component.parameters:
            node.add_start_value(f"{component.name}_fmu.fmu", parameter.name, parameter.text)
    for connection in structure.connections:
        (start, output), (end, into) = connection.start, connection.end
        node.add_link(f"{start}_fmu.fmu", output, f"{end}_fmu.fmu", into)
    try:
        node.make_fmu(folder, fmi_version=2)
    except FMUContainerError as error:
        raise InputError(f"the FMU Manipulation Toolbox refuses the system: {error.reason}") from None
    with zipfile.ZipFile(folder / "formation.fmu") as made, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry in made.infolist():
            content_of_entry = made.read(entry)
            if entry.filename == "modelDescription.xml":
                content_of_entry = _described(content_of_entry, structure)
            archive.writestr(entry, content_of_entry)


def _described(text: bytes, structure: Structure) -> bytes:
    """Return the description with what the toolbox takes from the first FMU, or promises without need."""
    root = etree.fromstring(text)
    for interface in root.iter("CoSimulation"):
        # Its own steps are of constant length: after a communication step that is no multiple, outputs are older.
        interface.set("canHandleVariableCommunicationStepSize", "false")
    for experiment in root.iter("DefaultExperiment"):
        experiment.set("stopTime", f"{structure.stop:.12g}")
        experiment.set("stepSize", f"{structure.step:.12g}")
    described: bytes = etree.tostring(root, encoding="UTF-8", xml_declaration=True)
    return described
