"""From an SSP to a scenario with the files that it needs."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from cosim.errors import InputError
from cosim.fmu.unpack_folder import plain_folder
from cosim.scenario.grammar import matches
from cosim.ssp.own_scenario import own_scenario
from cosim.ssp.reading import read_ssp
from cosim.ssp.recognised import recognised_scenario
from plants import scratch


@dataclass(frozen=True)
class Imported:
    """A scenario from an SSP.

    Attributes
    ----------
    scenario : Path
        Its file.
    files : dict
        The content of each file to write, by its path; the scenario's is the last.
    notes : tuple of str
        Parts of the SSP that differ from what Formation wrote or that a scenario cannot state, each a sentence.
    to_do : tuple of str
        What the user must add or look at, each a sentence; the scenario has them as comments.
    runs : bool
        Whether the scenario can run as it is.
    """

    scenario: Path
    files: Mapping[Path, bytes]
    notes: tuple[str, ...]
    to_do: tuple[str, ...]
    runs: bool


@contextmanager
def _named(path: Path, directory: Path) -> Iterator[None]:
    """Let an error name the files of an SSP, not the folder that it is unpacked in."""
    try:
        yield
    except InputError as error:
        where, unpacked = error.where, f"{directory}{os.sep}"
        if where is not None:
            where = replace(where, file=where.file.replace(unpacked, f"{path}/"))
        raise InputError(error.message.replace(unpacked, f"{path}, "), where) from None


def import_ssp(path: Path, scenario: Path | None = None) -> Imported:
    """Return the scenario of an SSP; nothing is written.

    Parameters
    ----------
    path
        The SSP.
    scenario
        The file of the scenario; by default here, named after the SSP. Its other files go into a folder beside it.

    Raises
    ------
    InputError
        The SSP cannot be read, or holds no vehicle that is recognised; with the file, the line and the element.
    """
    scenario = scenario or Path(f"{path.stem}.xml")
    if scenario.suffix != ".xml":
        raise InputError(f"{scenario}: name a file that ends in .xml, such as {scenario.with_suffix('.xml')}")
    if not matches("name", scenario.stem) or len(scenario.stem) > 90:
        raise InputError(
            f"{scenario}: the file's name becomes the scenario's name: use at most 90 letters, digits, '_', '-' and "
            "'.', a letter or digit first; --out names another file"
        )
    with ExitStack() as cleanup:
        directory = plain_folder("formation-ssp-")
        cleanup.callback(scratch.remove, directory)
        cleanup.enter_context(_named(path, directory))
        structure = read_ssp(path, directory)
        folder = f"{scenario.stem}_files"
        if structure.facts is not None:
            found = own_scenario(path, structure, directory, folder, scenario.stem, cleanup)
        else:
            found = recognised_scenario(path, structure, directory, folder, scenario.stem, cleanup)
    beside = {scenario.parent / name: data for name, data in found.files.items()}
    return Imported(scenario, {**beside, scenario: found.text}, found.notes, found.to_do, not found.open)
