"""A scenario as an SSP file."""

from __future__ import annotations

import shutil
from contextlib import ExitStack
from pathlib import Path

from cosim.errors import InputError
from cosim.fmu.unpack_folder import plain_folder
from cosim.results.files import replacing
from cosim.scenario.scenario import Scenario
from cosim.ssp.container import write_container
from cosim.ssp.document import write_archive
from cosim.ssp.structure import VERSIONS
from cosim.ssp.system import system_of
from plants import scratch


def export_ssp(scenario: Scenario, path: Path, *, version: str = "1.0") -> tuple[str, ...]:
    """Write a scenario as an SSP, whole or not at all.

    Parameters
    ----------
    scenario
        The scenario.
    path
        The file.
    version
        The version of SSP, one of `cosim.ssp.structure.VERSIONS`.

    Returns
    -------
    tuple of str
        What other masters do otherwise, or cannot be told, each a sentence.

    Raises
    ------
    InputError
        The scenario is wrong, or states what a system of FMUs cannot.
    OutputError
        The file cannot be written.
    """
    if version not in VERSIONS:
        raise InputError(f"SSP {version} is not written; choose {' or '.join(VERSIONS)}")
    with ExitStack() as cleanup:
        system = system_of(scenario, cleanup, version=version)
        with replacing(path) as file:
            write_archive(file, system.structure, system.content)
    return system.notes


def export_fmu(scenario: Scenario, path: Path) -> tuple[str, ...]:
    """Write a scenario as one FMU, whole or not at all; as `export_ssp`.

    Raises
    ------
    InputError
        As there; or the FMU Manipulation Toolbox, which makes such an FMU, is not installed.
    OutputError
        The file cannot be written.
    """
    with ExitStack() as cleanup:
        system = system_of(scenario, cleanup)
        folder = plain_folder("formation-container-")
        cleanup.callback(scratch.remove, folder)
        made = folder / "made.fmu"
        write_container(made, system.structure, system.content, folder)
        with replacing(path) as file, made.open("rb") as source:
            shutil.copyfileobj(source, file)
    return system.notes
