"""One run of a study as a scenario file of its own, a variant, which every command takes."""

from __future__ import annotations

import copy
import os
from functools import cache
from pathlib import Path

from lxml import etree

from cosim.scenario.edits import as_setting, split_setting
from cosim.scenario.grammar import NAMESPACE, attributes_of_types, local_name, paths_in
from cosim.scenario.variant import RULES
from cosim.studies.plan import Run
from cosim.studies.study import Study


def as_variant(study: Study, run: Run, folder: Path, name: str = "", title: str = "") -> str:
    """Return the text of a variant that is one run of a study, to be written in a folder.

    Its paths are relative to that folder. It has the scenario's expectations, and not the study's measures. Without
    name and title, they tell the run.

    Raises
    ------
    InputError
        The study's scenarios are changed by a function, which no file can state.
    """
    root = study.document.root
    cases = _cases(root, run.cases)
    of = next((case.get("of", "") for case in cases if case.get("of")), root.get("of", ""))
    here = study.document.path.parent.absolute()
    named = (name or f"{study.name}-{run.number}")[-100:].lstrip("_.-")
    variant = etree.Element("variant", {"name": named, "of": _moved(of, here, folder)}, {None: NAMESPACE})
    etree.SubElement(variant, "title").text = title or f"Run {run.number} of {study.name}: {study.title}"
    for case in cases:
        for rule in case.iterchildren(*(f"{{{NAMESPACE}}}{tag}" for tag in RULES)):
            variant.append(copied := copy.deepcopy(rule))
            for element, attribute in paths_in(copied):
                element.set(attribute, _moved(element.get(attribute, ""), here, folder))
            for element in copied.iter("*"):
                element.tag = local_name(element)
    for setting in (*map(as_setting, study.changes), *run.changes):
        select, value = split_setting(setting)
        etree.SubElement(variant, "set", {"select": select, "value": value})
    for rule in variant.iterchildren("set"):
        if rule.get("select", "").rpartition("/@")[2] in _path_attributes():
            rule.set("value", _moved(rule.get("value", ""), here, folder))
    etree.indent(variant)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{etree.tostring(variant, encoding="unicode")}\n'


def _cases(root: etree._Element, chosen: tuple[int, ...]) -> list[etree._Element]:
    tag = f"{{{NAMESPACE}}}case"
    having = [vary for vary in root.iterchildren(f"{{{NAMESPACE}}}vary") if vary.find(tag) is not None]
    return [vary.findall(tag)[index] for vary, index in zip(having, chosen, strict=True)]


@cache
def _path_attributes() -> frozenset[str]:
    """Return the names of attributes that are paths, of any element."""
    return frozenset().union(*attributes_of_types("path").values())


def _moved(path: str, here: Path, folder: Path) -> str:
    """Return a path that is relative to one folder as it is from another."""
    target = here / path
    try:
        return Path(os.path.relpath(target, folder.absolute())).as_posix()
    except ValueError:  # another drive
        return target.as_posix()
