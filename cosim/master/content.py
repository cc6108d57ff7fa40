"""What decides on the numbers of a run besides the resolved text: controllers, FMUs, and the files that it names."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path

from lxml import etree

from cosim.control.law import Law
from cosim.fmu.vehicle import Fmu
from cosim.scenario.grammar import named_files
from cosim.scenario.scenario import Scenario


def parts_told(scenario: Scenario, laws: Mapping[str, Law], fmus: Mapping[str, Fmu]) -> Iterator[str]:
    """Return a line for each law with its environment, each FMU, and each file that a scenario names, as it is now."""
    for name, law in laws.items():
        yield f"law {name} {law.package} {law.version} {law.content}"
        yield from (f"of {name} {library} {its}" for library, its in law.environment.items())
    for name, fmu in fmus.items():
        yield f"plant {name} {fmu.sha256}"
    yield from (f"file {name} {its}" for name, its in checksums(scenario).items())


def checksums(scenario: Scenario) -> dict[str, str]:
    """Return the SHA-256 of each file that the text of a scenario names, FMUs apart, by the name that it has there."""
    root = etree.fromstring(scenario.text.encode(), etree.XMLParser(remove_comments=True, remove_pis=True))
    found = {name: checksum(scenario.folder / name) for name in named_files(root)}
    return {name: its for name, its in found.items() if its}


def checksum(file: Path) -> str:
    """Return the SHA-256 of a file; empty if it cannot be read, as it was read when the scenario was."""
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError:
        return ""
