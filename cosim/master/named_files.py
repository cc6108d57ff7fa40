"""The files that a scenario names, by what they hold."""

from __future__ import annotations

import hashlib

from lxml import etree

from cosim.scenario.grammar import named_files
from cosim.scenario.scenario import Scenario


def checksums(scenario: Scenario) -> dict[str, str]:
    """Return the SHA-256 of each file that the text of a scenario names, FMUs apart, by the name that it has there."""
    root = etree.fromstring(scenario.text.encode(), etree.XMLParser(remove_comments=True, remove_pis=True))
    files = {name: scenario.folder / name for name in named_files(root)}
    return {name: hashlib.sha256(file.read_bytes()).hexdigest() for name, file in files.items() if file.is_file()}
