"""The model description of an FMU, and its breaches of the standard.

Many FMUs in use break a rule of their standard and run all the same: breaches are reported, and the rest is read.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Set
from contextlib import suppress
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from lxml import etree

from cosim.beside import beside
from cosim.collection import without_collection
from cosim.errors import printable
from cosim.fmu.archive import DESCRIPTION, MAX_TAGS
from cosim.fmu.breaches import OPTIONS, Breaches
from cosim.fmu.description_reader import OPTIONAL, description_of
from cosim.fmu.model_description import ModelDescription
from cosim.plant.spec import CO_SIMULATION, MODEL_EXCHANGE

PARSER = etree.XMLParser(**OPTIONS)
_PIECE = 4096

SCHEDULED_EXECUTION = "scheduled_execution"
_INTERFACES = {
    "CoSimulation": CO_SIMULATION,
    "ModelExchange": MODEL_EXCHANGE,
    "ScheduledExecution": SCHEDULED_EXECUTION,
}
_LONGEST = 300
"""Characters of a problem: some of FMPy's name every variable there is."""
_B_NAME = r"(?:[A-Za-z_][A-Za-z0-9_]*|'(?:[A-Za-z0-9_!#$%&()*+,\-./:;<>=?@\[\]^{}|~ ]|\\['\"?\\abfnrtv])+')"
_INDICES = r"(?:\[[0-9]+(?:,[0-9]+)*\])?"
_IDENTIFIER = rf"{_B_NAME}{_INDICES}(?:\.{_B_NAME}{_INDICES})*"
_STRUCTURED = re.compile(rf"{_IDENTIFIER}|der\({_IDENTIFIER}(?:,[0-9]+)?\)")
"""A name by the convention "structured": FMI 2.0, section 2.2.9; FMI 3.0, section 2.4.7.5.1."""


class Reading(NamedTuple):
    """The model description of an FMU, with its breaches of the standard.

    Attributes
    ----------
    description : ModelDescription
        As it is read.
    problems : tuple of str
        Breaches of the schema and of the rules that FMPy checks beyond it, each in a line.
    capabilities : dict of dict of str
        The attributes of each interface that it offers, by the interface's name, also of those unusable here.
    """

    description: ModelDescription
    problems: tuple[str, ...]
    capabilities: dict[str, dict[str, str]]


def read(directory: Path) -> Reading:
    """Return the model description of an unpacked FMU.

    Raises
    ------
    Exception
        It cannot be read: why.
    """
    path = directory / DESCRIPTION
    data = path.read_bytes()
    schema = _schema(_version(data))
    with without_collection(), beside(etree.parse, path, PARSER) as parsed:
        import_module("fmpy.validation")  # takes long; libxml2 leaves the interpreter to others meanwhile
        with Breaches(data, schema) as breaches:
            stated = _stated(data)
            return _reading(parsed().getroot(), breaches, stated)


def _reading(root: etree._Element, breaches: Breaches, stated: Set[str]) -> Reading:
    if root.tag != "fmiModelDescription" or not root.get("fmiVersion"):
        raise ValueError(f"it begins with <{root.tag}>; expected <fmiModelDescription fmiVersion=...>")
    try:
        description = description_of(root, stated)
    except Exception as error:  # a breach of the schema is nearer to the cause
        raise ValueError(_cause(root, breaches.of(root), error)) from None
    rules = list(_complaints(description))
    problems = (" ".join(problem.split()) for problem in chain(breaches.of(root), rules))
    return Reading(description, tuple(problems), _capabilities(root))


def _stated(data: bytes) -> Set[str]:
    """Return which optional attributes may occur in a file; all of them if its encoding is not like ASCII."""
    return {name for name in OPTIONAL if name.encode() in data} if b"<fmiModelDescription" in data else OPTIONAL


def summed_up(problems: Iterable[str]) -> list[str]:
    """Return problems; those that differ only in names and numbers become one line with a count, long ones are cut."""
    alike: dict[str, list[str]] = {}
    for problem in problems:
        alike.setdefault(re.sub(r'"[^"]*"|\'[^\']*\'|\(?\bline \d+\)?:?|\d+', "", problem), []).append(problem)
    return [shortened(first) + (f" ({len(more)} more like it)" if more else "") for first, *more in alike.values()]


def shortened(problem: str) -> str:
    """Return a problem that is not too long to read."""
    text = printable(problem)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."


def _version(data: bytes) -> str:
    """Return the major version of FMI; refuse more tags than any FMU has before a tree is made of them."""
    if (tags := data.count(b"<")) > MAX_TAGS:
        raise ValueError(f"it has {tags} beginnings and ends of elements; at most {MAX_TAGS} are read")
    parser = etree.XMLPullParser(events=("start",), **OPTIONS)
    for begin in range(0, len(data), _PIECE):
        with suppress(etree.XMLSyntaxError):  # to be told by who parses all of it
            parser.feed(data[begin : begin + _PIECE])
        for _, root in parser.read_events():
            return str(root.get("fmiVersion", ""))[:1]
    return ""


def _cause(root: etree._Element, problems: list[str], error: Exception) -> str:
    """Return why a description cannot be read."""
    if found := next(chain(_dangling(root), problems), ""):
        return found
    if isinstance(error, (LookupError, TypeError, AttributeError)):
        return f"an attribute or a reference in it is missing or wrong ({type(error).__name__}: {error})"
    return str(error)


def _dangling(root: etree._Element) -> Iterator[str]:
    """Return which references to variables lead nowhere: by number in FMI 2.0, by value reference in FMI 3.0."""
    three = root.get("fmiVersion", "").startswith("3")
    variables = list(root.iterfind("ModelVariables/*"))
    known = {v.get("valueReference", "") for v in variables} if three else {str(i + 1) for i in range(len(variables))}
    what = "value reference" if three else "variable number"
    there = "but no variable has it" if three else f"but there are {len(variables)} variables"
    attributes = ("valueReference" if three else "index", "dependencies", "derivative", "clocks")
    for element in chain(root.iterfind("ModelStructure//*"), root.iterfind("ModelVariables//*")):
        for attribute in attributes:
            for reference in element.get(attribute, "").split():
                if reference not in known:
                    yield (
                        f"line {element.sourceline}: the attribute {attribute} of <{element.tag}> refers to the {what} "
                        f"{reference}, {there}"
                    )


def _capabilities(root: etree._Element) -> dict[str, dict[str, str]]:
    if root.get("fmiVersion") != "1.0":
        return {
            name: dict(element.attrib) for tag, name in _INTERFACES.items() if (element := root.find(tag)) is not None
        }
    implementation = root.find("Implementation")
    if implementation is None:
        return {MODEL_EXCHANGE: {}}
    said = implementation.find(".//Capabilities")
    attributes = {} if said is None else dict(said.attrib)
    if implementation.find("CoSimulation_Tool") is not None:
        attributes["needsExecutionTool"] = "true"
    return {CO_SIMULATION: attributes}


@cache
def _schema(version: str) -> etree.XMLSchema | None:
    fmpy = find_spec("fmpy")  # whose import takes long, and can wait until the file is being parsed
    name = "fmiModelDescription.xsd" if version == "1" else f"fmi{version}ModelDescription.xsd"
    if fmpy is None or fmpy.origin is None:
        return None
    path = Path(fmpy.origin).parent / "schema" / f"fmi{version}" / name
    return etree.XMLSchema(file=os.fspath(path)) if version and path.is_file() else None


def _complaints(description: ModelDescription) -> Iterator[str]:
    """Return which rules beyond the schema a description breaks."""
    from fmpy import validation

    try:
        yield from map(str, validation.validate_model_description(description, validate_model_structure=True))
    except Exception as error:  # FMPy raises exceptions of any kind
        yield f"the rest could not be validated: {type(error).__name__}: {error}"
    if description.variableNamingConvention == "structured":
        names = description.names_without_numbers
        legal = {name for name in set(names) if _STRUCTURED.fullmatch(name)}
        for variable, name in zip(description.modelVariables, names, strict=False):
            if name not in legal:
                yield (
                    f'"{variable.name}" (line {variable.sourceline}) is not a legal variable name for naming '
                    'convention "structured"'
                )
