"""An FMU as a file: opened with care, described by FMPy, unpacked for as long as it is needed."""

from __future__ import annotations

import hashlib
import re
import shutil
import tempfile
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.parsers import expat

import fmpy

from cosim.contract import Binding, bind
from cosim.errors import InputError, Location

MAX_UNPACKED_BYTES = 2 * 1024**3
MAX_DESCRIPTION_BYTES = 64 * 1024**2


@dataclass(frozen=True)
class Fmu:
    """An unpacked FMU that satisfies a vehicle contract.

    Attributes
    ----------
    path, sha256
        The file and its checksum.
    description : fmpy.model_description.ModelDescription
        What it says of itself.
    binding : Binding
        Which variable plays which role.
    directory : Path
        Where it is unpacked, until `close`.
    """

    path: Path
    sha256: str
    description: Any
    binding: Binding
    directory: Path

    def close(self) -> None:
        """Remove what was unpacked."""
        shutil.rmtree(self.directory, ignore_errors=True)


def open_fmu(path: Path, where: Location | None = None) -> Fmu:
    """Check an FMU, match it with a vehicle contract and unpack it.

    Raises
    ------
    InputError
        The file is not an FMU that can be used here: why, and which file; `where` is the place that asks for it.
    """
    try:
        if path.exists() and not path.is_file():  # a pipe or a device may never end
            raise InputError(f"the FMU {path} is not a regular file", where)
        with path.open("rb") as file:
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"the FMU {path} cannot be read: {error.strerror}", where) from None
    _check_archive(path, where)
    directory = Path(tempfile.mkdtemp(prefix="formation-fmu-"))
    try:
        description = _unpack(path, directory, where)
        _check_interface(path, description, directory, where)
        return Fmu(path, sha256, description, bind(description, str(path), where), directory)
    except BaseException:
        shutil.rmtree(directory, ignore_errors=True)
        raise


def _unpack(path: Path, directory: Path, where: Location | None) -> Any:
    try:
        fmpy.extract(str(path), str(directory))
    except Exception as error:  # FMPy raises what it comes across; the text says what is wrong with the file
        raise InputError(f"the FMU {path} cannot be unpacked: {error}", where) from None
    try:
        return fmpy.read_model_description(str(directory))
    except Exception as error:
        raise InputError(f"the FMU {path} has no valid model description: {error}", where) from None


def _check_archive(path: Path, where: Location | None) -> None:
    """Refuse what is no archive, points outside of it, or is larger than any FMU."""
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            names = {entry.filename for entry in entries}
            if "modelDescription.xml" not in names:
                raise InputError(f"{path} is not an FMU: it holds no modelDescription.xml", where)
            for entry in entries:
                if ".." in Path(entry.filename).parts or Path(entry.filename).is_absolute():
                    raise InputError(f"the FMU {path} has the entry {entry.filename!r}, outside of itself", where)
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


def _check_interface(path: Path, description: Any, directory: Path, where: Location | None) -> None:
    identifier = description.coSimulation.modelIdentifier if description.coSimulation else ""
    if description.coSimulation and not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", identifier or ""):
        raise InputError(f"the FMU {path} has the model identifier {identifier!r}, which is no C identifier", where)
    if description.fmiVersion != "2.0" or description.coSimulation is None:
        kinds = [
            name
            for name, interface in (
                ("Co-Simulation", description.coSimulation),
                ("Model Exchange", description.modelExchange),
            )
            if interface is not None
        ]
        raise InputError(
            f"the FMU {path} is FMI {description.fmiVersion} {' and '.join(kinds) or 'of another kind'}; "
            "expected is FMI 2.0 Co-Simulation",
            where,
        )
    platforms = fmpy.supported_platforms(str(directory))
    if fmpy.platform not in platforms:
        raise InputError(
            f"the FMU {path} has no binary for this machine ({fmpy.platform}), only for: "
            f"{', '.join(sorted(platforms)) or 'none'}",
            where,
        )
