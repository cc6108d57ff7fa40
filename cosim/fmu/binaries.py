"""The binaries of an FMU: for which machines, and what they cannot share a process with."""

from __future__ import annotations

import fmpy

from cosim.errors import InputError, Location
from cosim.fmu.bundled_code import brought_code
from cosim.fmu.model_description import ModelDescription
from cosim.fmu.package import Package


def check_binary(package: Package, identifier: str, where: Location | None) -> None:
    """Refuse an FMU that has no binary for this machine.

    Raises
    ------
    InputError
        It has none; the message names the platforms that it has.
    """
    platform = this_machine(package.description)
    folder = package.directory / "binaries" / platform
    if not folder.is_dir():
        sources = '; "fmpy compile" may make one of the sources in it' if has_sources(package) else ""
        raise InputError(
            f"the FMU {package.path} has no binary for this machine ({platform}), only for: "
            f"{', '.join(machines(package)) or 'none'}{sources}",
            where,
        )
    name = identifier + fmpy.sharedLibraryExtension
    if not (folder / name).is_file():
        found = ", ".join(sorted(entry.name for entry in folder.iterdir())) or "nothing"
        raise InputError(f"the FMU {package.path} has no {name} in binaries/{platform}, only: {found}", where)


def code_of(package: Package) -> str:
    """Return the code of an FMU that a process can hold only once, in words."""
    about = package.description
    interfaces_ = (about.coSimulation, about.modelExchange, about.scheduledExecution)
    names = [one.modelIdentifier + fmpy.sharedLibraryExtension for one in interfaces_ if one and one.modelIdentifier]
    return brought_code(package.directory, this_machine(about), names)


def this_machine(description: ModelDescription) -> str:
    """Return the folder of the binaries for this machine, as an FMU of this version names it."""
    return str(fmpy.platform_tuple if description.fmiVersion.startswith("3") else fmpy.platform)


def machines(package: Package) -> list[str]:
    """Return the platforms that an FMU has binaries for, by the names of its folders."""
    folder = package.directory / "binaries"
    return sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else []


def has_sources(package: Package) -> bool:
    """Return whether an FMU brings C sources that FMPy can compile."""
    return "c-code" in fmpy.supported_platforms(str(package.directory))
