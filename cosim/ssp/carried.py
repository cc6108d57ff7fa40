"""The scenario that an SSP carries with it, with the files that it names, so that it can be read again."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path

from lxml import etree

from cosim.errors import InputError
from cosim.missing_file import absent
from cosim.scenario.document import parse_document
from cosim.scenario.grammar import NAMESPACE, paths_in
from cosim.scenario.scenario import Scenario
from cosim.ssp.document import SCENARIO
from cosim.ssp.structure import RESOURCES

_FOLDER = "scenario"
"""The folder beside it with the files that it names."""
_EXPECT = f"{{{NAMESPACE}}}expect"


def carried(scenario: Scenario) -> tuple[dict[str, Path | bytes], list[str]]:
    """Return the scenario and the files that it names by their paths in the SSP, and what is left out, as sentences.

    Raises
    ------
    InputError
        A file that it names cannot be read.
    """
    root = parse_document(scenario.text, scenario.folder / scenario.path.name, scenario.places).root
    notes = [_without(element) for element in _comparing(root)]
    files: dict[Path, str] = {}

    def kept(path: str) -> str:
        file = scenario.folder / path
        files.setdefault(file, f"{_FOLDER}/{len(files) + 1}_{file.name}")
        return files[file]

    text = with_paths(root, kept)
    content: dict[str, Path | bytes] = {f"{RESOURCES}/{name}": content_of(file) for file, name in files.items()}
    return {SCENARIO: text, **content}, notes


def with_paths(root: etree._Element, renamed: Callable[[str], str]) -> bytes:
    """Return the text of a scenario in which each path of a file is renamed."""
    for element, name in paths_in(root):
        element.set(name, renamed(element.get(name, "")))
    text: bytes = etree.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"


def content_of(file: Path) -> Path | bytes:
    """Return a file, or a folder as an archive.

    Raises
    ------
    InputError
        There is no such file.
    """
    if not file.exists():
        raise InputError(f"{file} cannot be put into the SSP: {absent(file)}")
    if not file.is_dir():
        return file
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for part in sorted(file.rglob("*")):
            if part.is_file() and not part.is_symlink():
                archive.write(part, part.relative_to(file).as_posix())
    return packed.getvalue()


def _comparing(root: etree._Element) -> list[etree._Element]:
    """Return the expectations that name another scenario."""
    found = {element for element, _ in paths_in(root)}
    return [element for parent in root.iter(_EXPECT) for element in parent.iter("*") if element in found]


def _without(element: etree._Element) -> str:
    parent = element.getparent()
    assert parent is not None
    parent.remove(element)
    return f"the expectation <{etree.QName(element).localname}> compares with another scenario, which is not carried"
