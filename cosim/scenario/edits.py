"""Changes to a scenario before it is checked, as options of the command line ask for them.

A change is made in the document itself, so that a result keeps the text that was run. It sees
elements without their namespace. Each change here is a value: two of the same are equal, and it can be pickled.
"""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from lxml import etree

from cosim.clock import ROUNDING
from cosim.errors import InputError, nearest, shown
from cosim.quantity import quantity
from cosim.scenario.tree_edits import take_out
from cosim.scenario.xml_tree import NOT_XML
from cosim.scenario.xpath_advice import unclosed
from cosim.scenario.xpath_selection import assign, evaluated, selected_or_added

Change = Callable[[etree._Element], None]

_TOKENS = re.compile(r"""'[^']*(?:'|\Z)|"[^"]*(?:"|\Z)|[][()=]""")
"""What tells where an XPath ends: quoted texts, of which the last may not be closed, brackets and equals signs."""


@dataclass(frozen=True)
class Edit:
    """A change that an option of the command line asks for.

    Attributes
    ----------
    words : str
        That option, as a shell would take it.
    make : callable
        Makes the change, given the root and `about`; a function of a module, so that it can be pickled.
    about : tuple
        Its subject.
    """

    words: str
    make: Callable[..., None]
    about: tuple[object, ...]

    def __call__(self, root: etree._Element) -> None:
        """Make the change."""
        self.make(root, *self.about)


def in_words(change: Change) -> str:
    """Return the name of a change: its words, or the name of its function."""
    while isinstance(change, partial):
        change = change.func
    return change.words if isinstance(change, Edit) else getattr(change, "__name__", type(change).__name__)


def as_setting(change: Change) -> str:
    """Return a change as ``XPATH=VALUE``.

    Raises
    ------
    InputError
        It is another change.
    """
    if isinstance(change, Edit) and change.make is _set_value:
        return str(change.about[0])
    raise InputError(f"the change {in_words(change)!r} sets no value, so a scenario file cannot state it")


def set_value(setting: str) -> Edit:
    """Return the change of ``XPATH=VALUE``: the node that the XPath selects gets the value.

    A gain or parameter that the XPath names and its element lacks is added; see `selected_or_added`.

    Raises
    ------
    InputError
        The setting has no two sides.
    """
    split_setting(setting)
    return Edit(f"--set {_quoted(setting)}", _set_value, (setting,))


def set_seed(seed: int) -> Edit:
    """Return the change to another seed of the noise."""
    return Edit(f"--seed {seed}", _set_value, (f"simulation/@seed={seed}",))


def set_horizon(horizon: float | str) -> Edit:
    """Return the change to another horizon, in seconds or as a scenario writes it; later elements are removed.

    That is every event, signal, effect of a sensor or an actuator, and change of a place. Expectations stay.
    """
    text = horizon if isinstance(horizon, str) else f"{horizon} s"
    return Edit(f"--horizon {_quoted(text)}", _set_horizon, (text,))


def without_expectations() -> Edit:
    """Return the change that removes all expectations."""
    return Edit("--no-expectations", _remove_expectations, ())


def as_changes(
    changes: Iterable[str | Change], horizon: float | str | None = None, expectations: bool = True
) -> list[Change]:
    """Return a list of changes: the given ones, also as ``XPATH=VALUE``, and the changes of two options."""
    made = [set_value(change) if isinstance(change, str) else change for change in changes]
    if horizon is not None:
        made.append(set_horizon(horizon))
    if not expectations:
        made.append(without_expectations())
    return made


def set_fmu(plant: str, fmu: Path) -> Edit:
    """Return the change of one plant to another FMU; its parameters are kept."""
    return Edit(f"--plant {_quoted(f'{plant}={fmu}')}", _set_fmu, (plant, fmu))


def set_binding(plant: str, file: Path) -> Edit:
    """Return the change of one plant to the binding in a file."""
    return Edit(f"--binding {_quoted(f'{plant}={file}')}", _set_binding, (plant, file))


def set_controller(controller: str, name: str, package: str, version: str) -> Edit:
    """Return the change of one controller to another law, at that law's default gains: gains belong to a law.

    The gains that followers have of their own go, too. If the controller has that law already, nothing changes.
    """
    words = f"--controller {_quoted(f'{controller}={name}')}"
    return Edit(words, _set_controller, (controller, name, package, version))


def set_environment(controller: str, folder: Path, laws: Mapping[str, tuple[str, str]]) -> Edit:
    """Return the change of one controller to its law in another environment; its gains are kept.

    Parameters
    ----------
    controller
        Its id.
    folder
        The environment.
    laws
        Package and version of each law that is installed there, by name.
    """
    words = f"--environment {_quoted(f'{controller}={folder}')}"
    there = tuple((name, *about) for name, about in laws.items())
    return Edit(words, _set_environment, (controller, folder, there))


def split_setting(setting: str) -> tuple[str, str]:
    """Return the two sides of ``XPATH=VALUE``, split at the first '=' that is not in the XPath's brackets or quotes.

    Raises
    ------
    InputError
        There is no such '='.
    """
    depth = 0
    for token in _TOKENS.finditer(setting):
        if token[0] in "[(":
            depth += 1
        elif token[0] in "])":
            depth -= 1
        elif token[0] == "=" and depth == 0:
            return setting[: token.start()], setting[token.end() :]
    problem = unclosed(setting)
    raise InputError(
        f"--set {shown(setting)}: expected XPATH=VALUE, such as '//simulation/@seed=2'"
        + (f"; {problem}" if problem else "")
    )


def attributes_given(root: etree._Element, change: Change) -> list[tuple[etree._Element, str, str]] | None:
    """Return the attributes to which a change gives values, by element and name; None if it does anything else.

    Raises
    ------
    ValueError
        It is no XPath, or may take too long.
    """
    if not isinstance(change, Edit) or change.make is not _set_value:
        return None
    xpath, value = split_setting(str(change.about[0]))
    given = []
    for node in evaluated(root, xpath):
        if not isinstance(node, etree._ElementUnicodeResult) or not node.is_attribute:
            return None
        element, name = node.getparent(), node.attrname
        assert element is not None
        assert name is not None
        given.append((element, name, value))
    return given or None


def _quoted(text: str) -> str:
    """Return a text as a shell takes it, in double quotes where it has single ones, as XPaths often do."""
    return f'"{text}"' if "'" in text and not set('"$`\\!') & set(text) else shlex.quote(text)


def _set_value(root: etree._Element, setting: str) -> None:
    xpath, value = split_setting(setting)
    try:
        for node in selected_or_added(root, xpath):
            assign(node, value)
    except ValueError as error:
        raise InputError(f"--set {shown(setting)}: {error}") from None


def _set_horizon(root: etree._Element, horizon: str) -> None:
    _set_value(root, f"simulation/@horizon={horizon}")
    end = _seconds(horizon)
    begin = "//*[@at or @from][not(self::waypoint or ancestor::expect)]"
    begins = ((element, _seconds(element.get("at", element.get("from")))) for element in root.xpath(begin))
    later = dict.fromkeys(element for element, time in begins if time > end + ROUNDING)  # in the order of the text
    for given in root.iter("input"):
        signals = given.findall("*")
        if signals and all(signal in later for signal in signals):  # without any, an FMU would keep its start value
            given.set("later", "yes")
            for signal in signals:
                del later[signal]
    _keep_streams(root, later)
    for element in later:
        take_out(element)


def _keep_streams(root: etree._Element, gone: Collection[etree._Element]) -> None:
    """Let signals and dropouts state their streams of random numbers that their places no longer tell."""
    for sensor in root.iter("sensor"):
        _number(sensor.findall("dropout"), gone)
    shared = _signals(root)
    for waves in shared.values():
        _number(waves, gone)
    for robot in root.iterchildren("leader", "follower"):
        for name, waves in _signals(robot).items():
            _number([*(shared.get(name, ()) if robot.tag == "follower" else ()), *waves], gone)


def _signals(parent: etree._Element) -> dict[str, list[etree._Element]]:
    """Return the signals of each input of the scenario or of a robot, by the input's name; a value is one."""
    found: dict[str, list[etree._Element]] = {}
    for given in parent.findall("input"):
        found.setdefault(given.get("name", ""), []).extend(given.findall("*") or [given])
    return found


def _number(elements: Sequence[etree._Element], gone: Collection[etree._Element]) -> None:
    moved = False
    for place, element in enumerate(elements):
        if moved and element.tag in ("random", "dropout") and "stream" not in element.attrib:
            element.set("stream", str(place))
        moved = moved or element in gone


def _seconds(time: str) -> float:
    """Return a time [s]; NaN for any other text, which the reader refuses."""
    try:
        return quantity(time, "s")
    except ValueError:
        return math.nan


def _remove_expectations(root: etree._Element) -> None:
    for element in root.findall("expect"):
        take_out(element)


def _set_fmu(root: etree._Element, plant: str, fmu: Path) -> None:
    element = _by_id(root, "plant", plant)
    element.attrib.pop("model", None)
    element.set("fmu", _absolute(fmu))


def _set_binding(root: etree._Element, plant: str, file: Path) -> None:
    element = _by_id(root, "plant", plant)
    for binding in element.findall("binding"):
        element.remove(binding)
    element.set("binding", _absolute(file))


def _set_controller(root: etree._Element, controller: str, name: str, package: str, version: str) -> None:
    element = _by_id(root, "controller", controller)
    if element.get("name") == name:
        return
    for attribute, value in (("name", name), ("package", package), ("version", f"=={version}")):
        element.set(attribute, value)
    for attribute in ("environment", "time_limit"):
        element.attrib.pop(attribute, None)
    using = [follower for follower in root.findall("follower") if follower.get("controller") == controller]
    for robot in (element, *using):
        for gain in robot.findall("gain"):
            robot.remove(gain)


def _set_environment(
    root: etree._Element, controller: str, folder: Path, laws: tuple[tuple[str, str, str], ...]
) -> None:
    element = _by_id(root, "controller", controller)
    there = {name: (package, version) for name, package, version in laws}
    name = str(element.get("name"))
    if name not in there:
        raise InputError(
            f"--environment {controller}={folder}: no package there offers a controller {name!r}: "
            f"{nearest(name, list(there))}"
        )
    package, version = there[name]
    for attribute, value in (
        ("package", package),
        ("version", f"=={version}"),
        ("environment", _absolute(folder)),
    ):
        element.set(attribute, value)


def _absolute(path: Path) -> str:
    absolute = str(path.absolute())
    if NOT_XML.search(absolute):
        raise InputError(f"no scenario can name {absolute!r}: XML has no such characters; rename the file or folder")
    return absolute


def _by_id(root: etree._Element, tag: str, key: str) -> etree._Element:
    elements = {str(element.get("id")): element for element in root.findall(tag)}
    if key not in elements:
        raise InputError(f"the scenario has no {tag} {key!r}: {nearest(key, list(elements))}")
    return elements[key]
