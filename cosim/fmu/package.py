"""An FMU as a file: opened with care, described, unpacked for as long as it is needed."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from cosim.errors import InputError, Location
from cosim.fmu.archive import unpack
from cosim.fmu.description import Reading, read
from cosim.fmu.model_description import ModelDescription
from cosim.fmu.unpack_folder import plain_folder
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


def _described(path: Path, directory: Path, where: Location | None) -> Reading:
    try:
        return read(directory)
    except Exception as error:  # FMPy raises exceptions of any kind; the text names the fault of the file
        said = " ".join(str(error).replace(f"{directory}{os.sep}", "").split())
        raise InputError(f"the FMU {path} has no valid model description: {said}", where) from None
