"""An FMU as a file: opened with care, described by FMPy, unpacked for as long as it is needed."""

from __future__ import annotations

import hashlib
import math
import os
import re
import shutil
import stat
import zipfile
import zlib
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any
from xml.parsers import expat

import fmpy
from lxml import etree

from cosim.binding import NEGATED, Binding, bind
from cosim.brought_code import brought_code
from cosim.errors import InputError, Location
from cosim.paths import absent
from cosim.plain_folder import plain_folder
from cosim.plant.spec import CO_SIMULATION, MODEL_EXCHANGE
from cosim.scenario import BindingSource

MAX_UNPACKED_BYTES = 2 * 1024**3
MAX_DESCRIPTION_BYTES = 64 * 1024**2

PARSER = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True)
_OF_THE_SCHEMA = re.compile(r"[A-Z]+ \(line ")
"""How FMPy writes that a model description breaks the schema of its version."""


@dataclass(frozen=True)
class Package:
    """An unpacked FMU.

    Attributes
    ----------
    path, sha256
        The file and its checksum.
    description : fmpy.model_description.ModelDescription
        What it says of itself.
    problems : tuple of str
        What FMPy finds wrong with that, beyond the schema: many FMUs in use break a rule or two.
    directory : Path
        Where it is unpacked, until `close`.
    """

    path: Path
    sha256: str
    description: Any
    problems: tuple[str, ...]
    directory: Path

    def close(self) -> None:
        """Remove what was unpacked."""
        shutil.rmtree(self.directory, ignore_errors=True)


@dataclass(frozen=True)
class Fmu(Package):
    """An unpacked FMU that satisfies a vehicle contract.

    Attributes
    ----------
    interface : str
        The one that is used: `CO_SIMULATION` or `MODEL_EXCHANGE`.
    binding : Binding
        Which variable plays which role.
    brought_code : str
        What it brings that a process can hold only once, in words; see `cosim.brought_code`.
    """

    interface: str
    binding: Binding
    brought_code: str

    @property
    def about_interface(self) -> Any:
        """What the FMU says of the interface that is used."""
        return interfaces(self.description)[self.interface]


def open_package(path: Path, where: Location | None = None) -> Package:
    """Check the file of an FMU and unpack it.

    Raises
    ------
    InputError
        The file is no FMU: why, and which file; `where` is the place that asks for it.
    """
    try:
        if path.exists() and not path.is_file():  # a pipe or a device may never end
            raise InputError(f"the FMU {path} is not a regular file", where)
        with path.open("rb") as file:
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError:
        raise InputError(f"the FMU {path} cannot be read: {absent(path)}", where) from None
    except OSError as error:
        raise InputError(f"the FMU {path} cannot be read: {error.strerror}", where) from None
    _check_archive(path, where)
    directory = plain_folder("formation-fmu-")
    try:
        description, problems = _unpack(path, directory, where)
        return Package(path, sha256, description, problems, directory)
    except BaseException:
        shutil.rmtree(directory, ignore_errors=True)
        raise


def open_fmu(
    path: Path, where: Location | None = None, declared: BindingSource | None = None, interface: str = ""
) -> Fmu:
    """Check an FMU, match it with a vehicle contract and unpack it.

    Parameters
    ----------
    path, where
        The file, and the place in the scenario that asks for it.
    declared
        The binding; without it, variables have the names of the roles that they play.
    interface
        The one to use; empty for what the FMU offers, Co-Simulation first.

    Raises
    ------
    InputError
        The file is not an FMU that can be used here: why, and which file.
    """
    package = open_package(path, where)
    try:
        chosen = choose_interface(package, interface, where)
        check_binary(package, interfaces(package.description)[chosen].modelIdentifier, where)
        binding = bind(package.description, str(path), declared, where)
        return Fmu(**vars(package), interface=chosen, binding=binding, brought_code=_brought_code(package))
    except BaseException:
        package.close()
        raise


def interfaces(description: Any) -> dict[str, Any]:
    """Return what an FMU says of each interface that it offers and that can be used here, by its name."""
    known = {CO_SIMULATION: description.coSimulation, MODEL_EXCHANGE: description.modelExchange}
    return {name: about for name, about in known.items() if about is not None}


def experiment_number(description: Any, name: str) -> float | None:
    """Return a number of an FMU's default experiment, such as its ``tolerance``; None if it is not more than zero."""
    try:
        number = float(getattr(description.defaultExperiment, name, None) or 0.0)
    except ValueError:
        return None
    return number if 0.0 < number < math.inf else None


def _unpack(path: Path, directory: Path, where: Location | None) -> tuple[Any, tuple[str, ...]]:
    try:
        fmpy.extract(str(path), str(directory))
    except Exception as error:  # FMPy raises what it comes across; the text says what is wrong with the file
        raise InputError(f"the FMU {path} cannot be unpacked: {error}", where) from None
    problems: tuple[str, ...] = ()
    try:
        _check_root(directory / "modelDescription.xml")
        try:
            description = fmpy.read_model_description(str(directory))
        except fmpy.model_description.ValidationError as error:
            if any(_OF_THE_SCHEMA.match(problem) for problem in error.problems):
                raise
            problems = tuple(map(str, error.problems))
            description = fmpy.read_model_description(str(directory), validate=False)
        if description.fmiVersion == "1.0":
            _complete(description, directory)
        return description, problems
    except Exception as error:
        said = str(error).replace(f"{directory}{os.sep}", "")
        raise InputError(f"the FMU {path} has no valid model description: {said}", where) from None


def _check_root(path: Path) -> None:
    """Refuse another root element than that of FMI, which FMPy stumbles over; what is not XML, FMPy says better."""
    with path.open("rb") as file, suppress(etree.XMLSyntaxError):
        _, root = next(etree.iterparse(file, events=("start",), resolve_entities=False, no_network=True))
        if root.tag != "fmiModelDescription" or not root.get("fmiVersion"):
            raise ValueError(f"it begins with <{root.tag}>; expected is <fmiModelDescription fmiVersion=...>")


def _complete(description: Any, directory: Path) -> None:
    """Add what FMPy does not read of an FMI 1.0 model description: negated aliases, and the capabilities."""
    root = etree.parse(directory / "modelDescription.xml", PARSER).getroot()
    elements = root.iterfind("ModelVariables/ScalarVariable")
    negated = {element.get("name") for element in elements if element.get("alias") == NEGATED}
    for variable in description.modelVariables:
        if variable.name in negated:
            variable.causality = NEGATED
    if (about := description.coSimulation) is None:
        return
    [implementation] = root.iterfind("Implementation")
    about.needsExecutionTool = implementation.find("CoSimulation_Tool") is not None
    for capabilities in implementation.iterfind("*/Capabilities"):
        for name in ("canBeInstantiatedOnlyOncePerProcess", "canHandleVariableCommunicationStepSize"):
            setattr(about, name, capabilities.get(name) in ("true", "1"))


def _check_archive(path: Path, where: Location | None) -> None:
    """Refuse what is no archive, points outside of it, has a file twice, or is larger than any FMU."""
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            if "modelDescription.xml" not in archive.namelist():
                raise InputError(f"{path} is not an FMU: it holds no modelDescription.xml", where)
            seen = set()
            for entry in entries:
                place = PurePosixPath(entry.filename.replace("\\", "/"))
                if ".." in place.parts or place.is_absolute():
                    raise InputError(f"the FMU {path} has the entry {entry.filename!r}, outside of itself", where)
                if stat.S_ISLNK(entry.external_attr >> 16):
                    raise InputError(f"the FMU {path} has the symbolic link {entry.filename!r}, not a file", where)
                if place in seen and not entry.is_dir():  # what is checked here might not be what is used
                    raise InputError(f"the FMU {path} has the entry {str(place)!r} twice", where)
                seen.add(place)
            unpacked = sum(entry.file_size for entry in entries)
            if unpacked > MAX_UNPACKED_BYTES:
                raise InputError(f"the FMU {path} would unpack to {unpacked / 1024**3:.1f} GiB", where)
            if archive.getinfo("modelDescription.xml").file_size > MAX_DESCRIPTION_BYTES:
                raise InputError(f"the FMU {path} has a model description of more than 64 MiB", where)
            if has_document_type(archive.read("modelDescription.xml")):
                raise InputError(f"the FMU {path} declares a document type in its modelDescription.xml", where)
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError) as error:
        raise InputError(f"{path} is not an FMU: {error}", where) from None


def has_document_type(xml: bytes) -> bool:
    """Return whether an XML document, in any encoding, declares a document type; what is not XML does not."""

    def found(*_: object) -> None:
        raise StopIteration

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = found
    try:
        parser.Parse(xml, True)
    except StopIteration:
        return True
    except (expat.ExpatError, LookupError, ValueError):
        return False
    return False


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
            f"the FMU {package.path} is FMI {version} {' and '.join(kinds) or 'of another kind'}; expected is "
            "Co-Simulation or Model Exchange of FMI 1.0, 2.0 or 3.0",
            where,
        )
    if wanted and wanted not in offered:
        raise InputError(f"the FMU {package.path} does not offer {wanted}, only {', '.join(offered)}", where)
    chosen = wanted or next(iter(offered))
    identifier = offered[chosen].modelIdentifier
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", identifier or ""):
        raise InputError(
            f"the FMU {package.path} has the model identifier {identifier!r}, which is no C identifier", where
        )
    clocks = [v.name for v in description.modelVariables if v.type == "Clock" and _ticked_from_outside(v)]
    if clocks:
        raise InputError(
            f"the FMU {package.path} has the input clock{'s' * (len(clocks) > 1)} {', '.join(map(repr, clocks[:3]))}"
            f"{', ...' if len(clocks) > 3 else ''}, which an importer must let tick at its times: here, no clock ticks",
            where,
        )
    return chosen


def _ticked_from_outside(clock: Any) -> bool:
    """Return whether an importer must let a clock of FMI 3.0 tick; triggered ones may well never tick."""
    return bool(clock.causality == "input" and clock.intervalVariability != "triggered")


def check_binary(package: Package, identifier: str, where: Location | None) -> None:
    """Refuse an FMU that has no binary for this machine.

    Raises
    ------
    InputError
        It has none: for which it has one.
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
    """Return what an FMU brings that a process can hold only once, in words."""
    about = package.description
    interfaces_ = (about.coSimulation, about.modelExchange, about.scheduledExecution)
    names = [one.modelIdentifier + fmpy.sharedLibraryExtension for one in interfaces_ if one is not None]
    return brought_code(package.directory, this_machine(about), names)


def this_machine(description: Any) -> str:
    """Return what an FMU of this version calls the folder of its binaries for this machine."""
    return str(fmpy.platform_tuple if description.fmiVersion.startswith("3") else fmpy.platform)


def machines(package: Package) -> list[str]:
    """Return what an FMU has binaries for, as its folders are called."""
    folder = package.directory / "binaries"
    return sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else []


def has_sources(package: Package) -> bool:
    """Return whether an FMU brings C sources that FMPy can compile."""
    return "c-code" in fmpy.supported_platforms(str(package.directory))
