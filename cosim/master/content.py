"""What decides on the numbers of a run besides the resolved text: controllers, FMUs, and the files that it names."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path

from lxml import etree

from cosim.control.law import Law
from cosim.fmu.vehicle import Fmu
from cosim.scenario.grammar import local_name, paths_in
from cosim.scenario.scenario import Scenario


def parts_told(laws: Mapping[str, Law], fmus: Mapping[str, Fmu]) -> Iterator[str]:
    """Return a line for each version of a law and of its environment, and for the checksum of each FMU."""
    for name, law in laws.items():
        yield f"law {name} {law.package} {law.version}"
        yield from (f"of {name} {library} {its}" for library, its in law.environment.items())
    for name, fmu in fmus.items():
        yield f"plant {name} {fmu.sha256}"


def files_told(scenario: Scenario) -> Iterator[str]:
    """Return a line with the checksum of each file that a scenario names, as it is now; without FMUs and scenarios."""
    root = etree.fromstring(scenario.text.encode())
    for element, name in paths_in(root):
        if (local_name(element), name) != ("plant", "fmu"):
            yield f"file {name} {checksum(scenario.folder / element.get(name, ''))}"


def checksum(file: Path) -> str:
    """Return the SHA-256 of a file; empty if it cannot be read, as it was read when the scenario was."""
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError:
        return ""
