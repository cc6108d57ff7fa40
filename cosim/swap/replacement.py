"""From a scenario to a variant of it in which plants are other FMUs, with bindings to start from."""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from cosim.errors import InputError, Location, nearest, printable
from cosim.fmu.package import Package, open_package
from cosim.fmu.parameters import check_constant, needs_a_role, value_of
from cosim.master.robot_inputs import INPUT_TYPES
from cosim.quantity import quantity
from cosim.scenario.document import read_document
from cosim.scenario.grammar import NAMESPACE
from cosim.scenario.reader import read_binding, read_scenario
from cosim.scenario.scenario import LEADER, OPEN, Follower, Leader, RoleSource, Scenario, Setting
from cosim.swap.probe import Probe, probed, with_doubts
from cosim.swap.proposal import Proposal, binding_xml, proposals, propose
from cosim.vehicle.kind import Kind, Role
from cosim.vehicle.kinds import kind_named, kinds
from plants import UnitError

BINDING_SUFFIX = ".binding.xml"
"""The end of the name of a file that holds a binding."""

_NS = "{" + NAMESPACE + "}"


@dataclass(frozen=True)
class Replacement:
    """An FMU in the place of a plant.

    Attributes
    ----------
    plant : str
        The id of the plant.
    package : Package
        The FMU.
    kind : Kind
        The kind of vehicle.
    proposal : Proposal or None
        The proposal of a binding; None if a binding is given.
    roles : tuple of RoleSource
        The roles of the binding.
    binding : Path or None
        The binding's file; None if none is needed.
    probe : Probe or None
        Movements in a short drive; None if none was made.
    """

    plant: str
    package: Package
    kind: Kind
    proposal: Proposal | None
    roles: tuple[RoleSource, ...]
    binding: Path | None
    probe: Probe | None = None


@dataclass(frozen=True)
class Swap:
    """The files to write.

    Attributes
    ----------
    variant : Path
        The variant's file.
    texts : dict
        The text of each file, by its path; the variant's is the last.
    replacements : tuple of Replacement
        The FMUs.
    notes : tuple of str
        Parts of the scenario that do not carry over, each a sentence.
    """

    variant: Path
    texts: Mapping[Path, str]
    replacements: tuple[Replacement, ...]
    notes: tuple[str, ...]


def swap(
    path: Path,
    fmus: Mapping[str, Path],
    bindings: Mapping[str, Path],
    variant: Path | None,
    cleanup: ExitStack,
    *,
    drive: bool = True,
) -> Swap:
    """Return a variant of a scenario in which plants are FMUs, and the bindings that these need.

    Parameters
    ----------
    path
        The scenario.
    fmus
        By the id of the plant, the FMU that takes its place.
    bindings
        By the id of the plant, the file of the binding. For a plant without one, a binding is proposed.
    variant
        The file to be written; default: beside the scenario, named after scenario and FMU. Bindings go beside it.
    cleanup
        Receives the clean-up callbacks.
    drive
        Whether FMUs with open questions are driven for a second, to see which outputs move.

    Raises
    ------
    InputError
        The scenario or an FMU is wrong, or there is no such plant.
    """
    scenario = read_scenario(path)
    for plant in (*fmus, *bindings):
        if plant not in scenario.plants:
            raise InputError(f"{path} has no plant {plant!r}: {nearest(plant, list(scenario.plants))}")
    for plant in bindings:
        if plant not in fmus:
            raise InputError(f"there is a binding for the plant {plant!r}, but no FMU")
    if variant is None:
        variant = path.with_name("_".join([path.stem, *dict.fromkeys(fmu.stem for fmu in fmus.values())]) + ".xml")
    if os.path.realpath(variant) == os.path.realpath(path):
        raise InputError(f"{variant} is the scenario itself: name another file for the variant")
    replacements = tuple(
        _replacement(scenario, plant, fmu, bindings.get(plant), variant.parent, cleanup, drive)
        for plant, fmu in fmus.items()
    )
    texts: dict[Path, str] = {}
    for replacement in replacements:
        if replacement.proposal is not None and replacement.binding is not None:
            text = binding_xml(replacement.proposal, replacement.package.path.name)
            if texts.setdefault(replacement.binding, text) != text:
                raise InputError(f"two FMUs would have the binding {replacement.binding}: swap one after the other")
    writer = _Writer(scenario, read_document(path).root, replacements, variant)
    texts[variant] = writer.text()
    return Swap(variant, texts, replacements, writer.notes)


def _replacement(
    scenario: Scenario, plant: str, fmu: Path, binding: Path | None, folder: Path, cleanup: ExitStack, drive: bool
) -> Replacement:
    package = open_package(fmu)
    cleanup.callback(package.close)
    if binding is not None:
        source = read_binding(binding)
        kind = kind_named(source.vehicle)
        return Replacement(plant, package, kind, None, source.roles, binding)
    known = _kind_of_plant(scenario, plant)
    proposal = propose(package.description, known) if known else proposals(package.description)[0]
    if proposal.refusal:
        raise InputError(
            f"the FMU {fmu} cannot be the plant {plant!r}: as a {proposal.kind.name} vehicle, "
            f"{proposal.refusal}. If that is wrong, assign its variables to roles with --binding {plant}=FILE.xml"
        )
    probe = probed(package, proposal) if drive and (proposal.open or proposal.doubts) else None
    if probe is not None:
        proposal = with_doubts(proposal, probe)
    needed = None if proposal.needs_no_binding else folder / f"{fmu.stem}{BINDING_SUFFIX}"
    return Replacement(plant, package, proposal.kind, proposal, proposal.binding.roles, needed, probe)


def _kind_of_plant(scenario: Scenario, plant: str) -> Kind | None:
    """Return the kind of vehicle of a plant by the initial poses of its robots; None if they fit several kinds."""
    for robot in _robots(scenario).values():
        for kind in kinds():
            if robot.plant == plant and set(robot.pose.values) == {role.name for role in kind.pose}:
                return kind
    return next((kind for kind in kinds() if kind.name == scenario.plants[plant].model), None)


def _robots(scenario: Scenario) -> dict[str, Leader | Follower]:
    return {LEADER: scenario.leader, **{follower.id: follower for follower in scenario.followers}}


class _Writer:
    """Writes the variant; `notes` then lists the parts that do not carry over."""

    def __init__(
        self, scenario: Scenario, root: etree._Element, replacements: Sequence[Replacement], variant: Path
    ) -> None:
        self.scenario = scenario
        self.root = root
        self.variant = variant
        self._left_out: dict[str, dict[str, list[str]]] = {}
        self._of_plant = {replacement.plant: replacement for replacement in replacements}
        self._of_robot = {name: self._of_plant.get(robot.plant) for name, robot in _robots(scenario).items()}

    def text(self) -> str:
        names = ", ".join(f"{plant}: {r.package.path.name}" for plant, r in self._of_plant.items())
        stem = re.sub(r"[^A-Za-z0-9_.\-]", "_", self.variant.stem).lstrip("_.-")[:100] or "swapped"
        attributes = {"name": stem, "of": self._relative(self.scenario.path)}
        root = etree.Element(_NS + "variant", attributes, {None: NAMESPACE})
        etree.SubElement(root, _NS + "title").text = printable(f"{self.scenario.title}; {names}")
        rules = [
            *(self._plant(replacement) for replacement in self._of_plant.values()),
            *self._robots(),
            *self._inputs(),
            *self._events(),
        ]
        if self.notes:
            lines = [textwrap.fill(printable(f"{note}."), 112, break_long_words=False) for note in self.notes]
            text = textwrap.indent("\n".join(lines), " " * 4)
            etree.SubElement(root, _NS + "description").text = f"\n{text}\n  "
        root.extend(rules)
        etree.indent(root)
        return f'<?xml version="1.0" encoding="UTF-8"?>\n{etree.tostring(root, encoding="unicode")}\n'

    # The parts of the scenario

    def _plant(self, replacement: Replacement) -> etree._Element:
        """Return the rule that puts the FMU in the place of the plant, with the parameters that it has too."""
        plant = replacement.plant
        attributes = {"id": plant, "fmu": self._relative(replacement.package.path)}
        if replacement.binding is not None:
            attributes["binding"] = self._relative(replacement.binding)
        old = self.root.find(f"{_NS}plant[@id='{plant}']")
        attributes |= {name: old.get(name) for name in ("isolate", "time_limit") if name in old.attrib}
        element = etree.Element(_NS + "plant", attributes)
        for setting in self.scenario.plants[plant].parameters:
            if name := self._carried(replacement, setting, f"plant {plant}"):
                etree.SubElement(element, _NS + "parameter", {"name": name, "value": setting.value})
        return _rule("replace", f"plant[@id='{plant}']", element)

    def _robots(self) -> Iterator[etree._Element]:
        """Return the rules about the parameters and inputs of robots that do not carry over."""
        for name, robot in _robots(self.scenario).items():
            if (replacement := self._of_robot[name]) is None:
                continue
            place = LEADER if name == LEADER else f"follower[@id='{name}']"
            element = self.root.find("/".join(_NS + part for part in place.split("/")))
            for index, setting in reversed(list(enumerate(robot.parameters, 1))):
                carried = self._carried(replacement, setting, name)
                if not carried:
                    yield _rule("remove", f"{place}/parameter[{index}]")
                elif carried != setting.name:
                    yield _rule("set", f"{place}/parameter[{index}]/@name", value=carried)
            for index, source in reversed(list(enumerate(element.findall(_NS + "input"), 1))):
                if not self._has_input(replacement, source.get("name", ""), name):
                    yield _rule("remove", f"{place}/input[{index}]")

    def _inputs(self) -> Iterator[etree._Element]:
        """Return the rules about the inputs of all followers, where some of these do not have them any more."""
        followers = [follower.id for follower in self.scenario.followers]
        for index, source in reversed(list(enumerate(self.root.findall(_NS + "input"), 1))):
            having = [
                name
                for name in followers
                if (replacement := self._of_robot[name]) is None
                or self._has_input(replacement, source.get("name", ""), name)
            ]
            if having != followers:
                yield _rule("remove", f"input[{index}]")
                for name in having:
                    yield _rule("insert", f"follower[@id='{name}']", deepcopy(source))

    def _events(self) -> Iterator[etree._Element]:
        """Return the rules for events whose changes do not carry over to all robots."""
        for index, event in reversed(list(enumerate(self.root.findall(_NS + "event"), 1))):
            robots = event.get("robots", "").split()
            groups: dict[tuple[str, ...], list[str]] = {}  # robots by the names of their parameters and inputs
            was = tuple(child.get("name", "") for child in _changing(event))
            for robot in robots:
                groups.setdefault(self._changed(event, robot), []).append(robot)
            if list(groups) == [was]:
                continue
            events = []
            for names, group in groups.items():
                changed = deepcopy(event)
                changed.set("robots", " ".join(group))
                changed.tail = None
                for child, name in zip(_changing(changed), names, strict=True):
                    if name:
                        child.set("name", name)
                    else:
                        changed.remove(child)
                if changed.find("*") is not None:
                    events.append(changed)
            yield _rule("replace" if events else "remove", f"event[{index}]", *events)

    def _changed(self, event: etree._Element, robot: str) -> tuple[str, ...]:
        """Return the names that parameters and inputs of an event have for a robot; an empty one if it has no such."""
        replacement = self._of_robot[robot]
        names = []
        for child in _changing(event):
            setting = Setting(child.get("name", ""), child.get("value", ""), Location(str(self.scenario.path)))
            what = f"{robot} at {event.get('at')}"
            if replacement is None:
                names.append(setting.name)
            elif child.tag == _NS + "input":
                names.append(setting.name if self._has_input(replacement, setting.name, what) else "")
            else:
                names.append(self._carried(replacement, setting, what, tunable=True))
        return tuple(names)

    # Parts that carry over

    def _carried(self, replacement: Replacement, setting: Setting, whose: str, *, tunable: bool = False) -> str:
        """Return the name of a parameter in the FMU that takes a plant's place; an empty one if it has no such."""
        package = replacement.package
        roles = {role.name: role for role in replacement.kind.geometry.values()}
        driving = {s.variable for s in replacement.roles if s.name not in roles}
        parameters = {
            v.name: v
            for v in package.description.modelVariables
            if v.causality == "parameter" or (v.causality == "input" and v.name not in driving)
        }
        bound = {source.name: source for source in replacement.roles if source.name in roles}.get(setting.name)
        player = bound.variable if bound is not None and bound.variable else None
        # By the role that it plays, unless the FMU has a parameter of this name that is something else.
        name = setting.name if player is None or setting.name not in parameters else player
        variable = parameters.get(setting.name if player is None else player)
        if variable is None and bound is not None and bound.value:
            if (contradiction := _contradiction(roles[setting.name], bound.value, setting.value)) is None:
                return ""  # the binding says the same
            reason = contradiction
        elif variable is None:
            reason = f"{package.path.name} has no such parameter"
        elif tunable and variable.variability != "tunable" and variable.causality != "input":
            reason = f"{package.path.name} has it {variable.variability} for the whole run"
        else:
            try:
                plays = player == name == setting.name
                by_role = plays and needs_a_role(package.description, variable, setting.value)
                if (name == variable.name and not by_role) or not roles[setting.name].unit:
                    value_of(package.description, variable, setting.value)
                else:
                    quantity(setting.value, roles[setting.name].unit)
                return name
            except (ValueError, UnitError) as error:
                reason = f"it does not fit {package.path.name}: {error}"
        self._note(reason, whose, f"{setting.name} = {setting.value}")
        return ""

    def _has_input(self, replacement: Replacement, name: str, robot: str) -> bool:
        played = {role.name for role in replacement.roles}
        if name in played or any(
            v.name == name and v.causality == "input" and v.type in INPUT_TYPES and not v.dimensions
            for v in replacement.package.description.modelVariables
        ):
            return True
        self._note(f"{replacement.package.path.name} has no such input", robot, name)
        return False

    def _note(self, reason: str, whose: str, what: str) -> None:
        found = self._left_out.setdefault(reason, {}).setdefault(whose, [])
        if what not in found:
            found.append(what)

    @property
    def notes(self) -> tuple[str, ...]:
        """Parts that do not carry over, a sentence for each reason."""
        sentences = []
        for reason, found in self._left_out.items():
            together: dict[tuple[str, ...], list[str]] = {}
            for whose, what in found.items():
                together.setdefault(tuple(what), []).append(whose)
            parts = "; ".join(f"{' and '.join(whose)}: {', '.join(what)}" for what, whose in together.items())
            sentences.append(f"Left out, as {reason}: {parts}")
        return tuple(sentences)

    def _relative(self, path: Path) -> str:
        """Return a path as it is written in the variant: relative to its folder where that is possible."""
        target = os.path.join(os.path.realpath(path.parent), path.name)
        try:
            text = Path(os.path.relpath(target, os.path.realpath(self.variant.parent))).as_posix()
        except ValueError:  # another drive
            text = Path(target).as_posix()
        if text != text.strip() or any(character in text for character in "\t\r\n"):
            raise InputError(f"the path {text!r} cannot be written in a scenario: its white space would not be kept")
        return text


def _changing(event: etree._Element) -> list[etree._Element]:
    """Return the parameters and inputs that an event changes."""
    return [child for child in event if child.tag in (_NS + "parameter", _NS + "input")]


def _contradiction(role: Role, constant: str, value: str) -> str | None:
    """Return why a value of a role does not go with the constant that a binding has for it; None if it does."""
    if constant == OPEN:
        return f"the binding must state {role.name}"
    try:
        check_constant(role, quantity(constant, role.unit) if role.unit else constant, value)
    except (ValueError, UnitError) as error:
        return str(error)
    return None


def _rule(tag: str, select: str, *children: etree._Element, value: str | None = None) -> etree._Element:
    rule = etree.Element(_NS + tag, {"into" if tag == "insert" else "select": select})
    if value is not None:
        rule.set("value", value)
    for child in children:
        child.tail = None
        rule.append(child)
    return rule
