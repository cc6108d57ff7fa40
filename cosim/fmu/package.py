"""An FMU as a file: opened with care, described by FMPy, unpacked for as long as it is needed."""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

import fmpy

from cosim.errors import InputError, Location
from cosim.fmu.archive import unpack
from cosim.fmu.binding import Binding, bind
from cosim.fmu.bundled_code import brought_code
from cosim.fmu.description import Reading, read
from cosim.fmu.model_description import Interface, ModelDescription, Variable
from cosim.fmu.unpack_folder import plain_folder
from cosim.plant.spec import CO_SIMULATION, MODEL_EXCHANGE
from cosim.scenario.scenario import BindingSource
from plants import scratch


@dataclass(frozen=True)
class Package:
    """An unpacked FMU.

    Attributes
    ----------
    path, sha256
        The file or the unpacked folder, and its checksum.
    description : ModelDescription
        Its model description.
    problems : tuple of str
        Breaches of the schema and of the rules that FMPy checks: many FMUs in use have one or two.
    capabilities : dict of dict of str
        The attributes of each interface that it offers, by the interface's name; see `cosim.fmu.description.Reading`.
    directory : Path
        Where it is unpacked, until `close`.
    """

    path: Path
    sha256: str
    description: ModelDescription
    problems: tuple[str, ...]
    capabilities: dict[str, dict[str, str]]
    directory: Path

    def close(self) -> None:
        """Remove the unpacked files."""
        scratch.remove(self.directory)


@dataclass(frozen=True)
class Fmu(Package):
    """An unpacked FMU that is a vehicle of a known kind.

    Attributes
    ----------
    interface : str
        The interface that is used: `CO_SIMULATION` or `MODEL_EXCHANGE`.
    binding : Binding
        The variable of each role.
    brought_code : str
        Code that it brings and that a process can hold only once, in words; see `cosim.fmu.bundled_code`.
    """

    interface: str
    binding: Binding
    brought_code: str

    @property
    def about_interface(self) -> Interface:
        """The FMU's description of the interface that is used."""
        return interfaces(self.description)[self.interface]

    @cached_property
    def inputs(self) -> dict[str, Variable]:
        """Its inputs, by name."""
        return {v.name: v for v in self.description.modelVariables if v.causality == "input"}

    @cached_property
    def settable(self) -> dict[str, Variable]:
        """The variables that a scenario can set by their own names: parameters, and inputs that do not drive it."""
        kind = self.binding.kind
        driven = self.binding.of((*kind.command, *kind.disturbance))
        commands = {id(b.played_by.variable) for b in driven if b is not None and b.played_by is not None}
        return {
            v.name: v
            for v in self.description.modelVariables
            if v.causality == "parameter" or (v.causality == "input" and id(v) not in commands)
        }


def open_package(path: Path, where: Location | None = None) -> Package:
    """Check an FMU, a file or the folder of an unpacked one, and unpack it or copy it.

    Raises
    ------
    InputError
        The file is no FMU. The message names file and reason; `where` is the place that names the FMU.
    """
    directory = plain_folder("formation-fmu-")
    try:
        sha256 = unpack(path, directory, where)
        return Package(path, sha256, *_described(path, directory, where), directory)
    except BaseException:
        scratch.remove(directory)
        raise


def open_fmu(
    path: Path, where: Location | None = None, declared: BindingSource | None = None, interface: str = ""
) -> Fmu:
    """Check an FMU, find its kind of vehicle and unpack it.

    Parameters
    ----------
    path, where
        The file, and the place in the scenario that asks for it.
    declared
        The binding; without it, variables have the names of the roles that they play.
    interface
        The one to use; if empty, Co-Simulation if the FMU offers it, else Model Exchange.

    Raises
    ------
    InputError
        The FMU cannot be used here; the message names file and reason.
    """
    package = open_package(path, where)
    try:
        return as_vehicle(package, where, declared, interface)
    except BaseException:
        package.close()
        raise


def as_vehicle(
    package: Package, where: Location | None = None, declared: BindingSource | None = None, interface: str = ""
) -> Fmu:
    """Return an opened FMU as a vehicle; it shares the unpacked files. See `open_fmu`."""
    chosen = choose_interface(package, interface, where)
    check_binary(package, interfaces(package.description)[chosen].modelIdentifier, where)
    binding = bind(package.description, str(package.path), declared, where)
    parts = {field.name: getattr(package, field.name) for field in fields(Package)}
    return Fmu(**parts, interface=chosen, binding=binding, brought_code=_brought_code(package))


def interfaces(description: ModelDescription) -> dict[str, Interface]:
    """Return the FMU's description of each interface that can be used here, by the interface's name."""
    known = {CO_SIMULATION: description.coSimulation, MODEL_EXCHANGE: description.modelExchange}
    return {name: about for name, about in known.items() if about is not None}


def experiment_number(description: ModelDescription, name: str) -> float | None:
    """Return a number of an FMU's default experiment, such as its ``tolerance``; None if it is not more than zero."""
    try:
        number = float(getattr(description.defaultExperiment, name, None) or 0.0)
    except ValueError:
        return None
    return number if 0.0 < number < math.inf else None


def _described(path: Path, directory: Path, where: Location | None) -> Reading:
    try:
        return read(directory)
    except Exception as error:  # FMPy raises exceptions of any kind; the text names the fault of the file
        said = " ".join(str(error).replace(f"{directory}{os.sep}", "").split())
        raise InputError(f"the FMU {path} has no valid model description: {said}", where) from None


def choose_interface(package: Package, wanted: str, where: Location | None) -> str:
    """Return the interface that is used of an FMU: the wanted one, or the first that it offers.

    Raises
    ------
    InputError
        It does not offer it, or nothing that can be used here.
    """
    description = package.description
    version = description.fmiVersion
    offered = interfaces(description)
    if not version.startswith(("1.", "2.", "3.")) or not offered:
        kinds = [
            name
            for name, about in (
                ("Co-Simulation", description.coSimulation),
                ("Model Exchange", description.modelExchange),
                ("Scheduled Execution", description.scheduledExecution),
            )
            if about is not None
        ]
        raise InputError(
            f"the FMU {package.path} is FMI {version} {' and '.join(kinds) or 'of another kind'}; expected "
            "Co-Simulation or Model Exchange of FMI 1.0, 2.0 or 3.0",
            where,
        )
    if wanted and wanted not in offered:
        raise InputError(f"the FMU {package.path} does not offer {wanted}, only {', '.join(offered)}", where)
    chosen = wanted or next(iter(offered))
    identifier = offered[chosen].modelIdentifier
    if problem := _unusable(identifier or "", version):
        raise InputError(f"the FMU {package.path} has the model identifier {identifier!r}, {problem}", where)
    clocks = [v.name for v in description.modelVariables if v.type == "Clock" and _ticked_from_outside(v)]
    if clocks:
        raise InputError(
            f"the FMU {package.path} has the input clock{'s' * (len(clocks) > 1)} {', '.join(map(repr, clocks[:3]))}"
            f"{', ...' if len(clocks) > 3 else ''}, which the importer must tick: input clocks are not supported here",
            where,
        )
    return chosen


def _ticked_from_outside(clock: Variable) -> bool:
    """Return whether an importer must let a clock of FMI 3.0 tick; triggered ones may well never tick."""
    return bool(clock.causality == "input" and clock.intervalVariability != "triggered")


def _unusable(identifier: str, version: str) -> str:
    """Return why a model identifier cannot be used: it is a file's name, and part of C functions' names in FMI 1.0."""
    if version == "1.0":
        return "" if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", identifier) else "which is no C identifier"
    outside = identifier in ("", ".", "..") or any(character in identifier for character in "/\\:\0")
    return "which is no name of a file" if outside else ""


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


def _brought_code(package: Package) -> str:
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
