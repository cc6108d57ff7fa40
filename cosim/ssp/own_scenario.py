"""The scenario that an SSP of Formation carries, with the changes that were made to the SSP since."""

from __future__ import annotations

import hashlib
import math
import os
import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from lxml import etree

from cosim.errors import InputError, Location, listed
from cosim.fmu.binding import BoundVariable
from cosim.fmu.model_description import Variable
from cosim.master.robot import RobotSetup
from cosim.master.setup import set_up
from cosim.plant.spec import WHOLE
from cosim.quantity import quantity
from cosim.scenario.document import parse_document
from cosim.scenario.grammar import paths_in
from cosim.scenario.reader import read_scenario
from cosim.scenario.scenario import LEADER
from cosim.scenario.tree_edits import add_namespace, insert, serialised, strip_namespace
from cosim.ssp.document import ALL_PARAMETERS
from cosim.ssp.experiment import experiment
from cosim.ssp.found import Found
from cosim.ssp.reading import parameters_of
from cosim.ssp.structure import PURE_NUMBER, RESOURCES, Facts, Parameter, Structure, Units
from cosim.ssp.values import number_of, with_unit, written
from cosim.team_fmu.law_in_host import pairs
from cosim.vehicle.kind import Role
from plants import units

_Changes = dict[str, list[tuple[Parameter, Parameter | None]]]
"""Parameters that have another value than was written, by component, each with the one that was written."""
_Gains = dict[tuple[str, bool], list[float]]
"""The entries of a robot's gains by name, and whether an SSP counts them: ``K_p[1]``."""
_ENTRY = re.compile(r"(.*)\.([^.\[\]]+)(?:\[([0-9]{1,9})\])?")


def own_scenario(
    path: Path, structure: Structure, directory: Path, folder: str, name: str, cleanup: ExitStack
) -> Found:
    """Return the scenario that an SSP carries; values that were changed in the SSP since are those of the SSP.

    Parameters
    ----------
    path, structure, directory
        The SSP, its system, and where it is unpacked.
    folder
        The folder, relative to the scenario, of the files that it names.
    name
        The name of the scenario.
    cleanup
        Receives the clean-up callbacks.

    Raises
    ------
    InputError
        The scenario in it cannot be read, or a changed value does not fit.
    """
    facts = structure.facts
    assert facts is not None
    shown = Path(f"{path}/{facts.scenario}")
    changed = {file for file in facts.sha256 if _sha256(directory / file) != facts.sha256[file]}
    root = parse_document(_text(directory / facts.scenario, shown), shown).root
    found, known, more = _changes(path, structure, directory, changed)
    strip_namespace(root)
    notes = [*_notes(root, structure, facts, changed), *more]
    if root.get("name") != name:
        root.set("name", name)
    _experiment(root, structure)
    if found:
        scenario = read_scenario(directory / facts.scenario)
        setup = set_up(scenario, cleanup, {})
        robots = {robot.name: robot for robot in (setup.leader, *setup.followers)}
        gains = {
            follower.id: {(name, np.ndim(value) > 0): np.atleast_1d(value).tolist() for name, value in pairs(own)}
            for follower, own in zip(scenario.followers, setup.gains, strict=True)
        }
        connected = {connection.end for connection in structure.connections}
        notes += list(_apply(root, found, robots, gains, known, connected))
    files: dict[str, bytes] = {}
    for element, attribute in paths_in(root):
        place = directory / RESOURCES / element.get(attribute, "")
        if not place.resolve().is_relative_to(directory.resolve()):
            raise InputError(f"{shown} names the file {element.get(attribute)!r}, which is not in the SSP")
        if os.path.isfile(place):
            files[f"{folder}/{place.name}"] = place.read_bytes()
            element.set(attribute, f"{folder}/{place.name}")
    add_namespace(root)
    text = serialised(root).encode()
    parse_document(text.decode(), Path(f"{name}.xml"))  # a changed value may break the schema
    return Found(text, files, tuple(notes))


def _sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest() if os.path.isfile(file) else ""


def _text(file: Path, shown: Path) -> str:
    try:
        return file.read_text("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"is no text in UTF-8: byte {error.start} is none of it", Location(str(shown))) from None


def _notes(root: etree._Element, structure: Structure, facts: Facts, changed: set[str]) -> Iterator[str]:
    """Yield what was changed in the SSP and cannot be taken over."""
    if facts.scenario in changed:
        yield f"{facts.scenario} was changed since the export, and is taken as it is now"
    if structure.connected != facts.connections:
        yield "the connections were changed since the export, which a scenario cannot state: it has those of the export"
    sources = {component.source: component.name for component in structure.components}
    for file in sorted(changed):
        if file.endswith(".fmu") and file in sources:
            yield (
                f"the FMU {file} of {sources[file]} was changed since the export: the scenario keeps its own plant or "
                "controller"
            )
    for component in structure.components:
        own = {f"{RESOURCES}/{component.name}.{ending}" for ending in ("ssv", "fmu")}  # its FMU may be others', too
        if not own & facts.sha256.keys():
            yield f"the component {component.name} with {component.source} was added since the export, and is left out"
            continue
        before = _fmu_before(root, facts, component.name)
        if component.source not in facts.sha256 or before not in ("", facts.sha256[component.source]):
            yield (
                f"the component {component.name} has another FMU since the export, {component.source}: the scenario "
                "keeps its own plant or controller"
            )
        if component.implementation == "ModelExchange":
            yield (
                f"the component {component.name} was changed to Model Exchange since the export: the scenario keeps "
                "its own interface"
            )


def _fmu_before(root: etree._Element, facts: Facts, component: str) -> str:
    """Return the checksum of the FMU that a component was exported with; empty if it is not known any more.

    Others than an FMU of its own are copies of files that the scenario names.
    """
    if own := facts.sha256.get(f"{RESOURCES}/{component}.fmu", ""):
        return own
    robot = root.find("leader") if component == LEADER else _one(root, "follower", "id", component)
    plant = None if robot is None else _one(root, "plant", "id", robot.get("plant", ""))
    return "" if plant is None else facts.sha256.get(f"{RESOURCES}/{plant.get('fmu')}", "")


def _changes(path: Path, structure: Structure, directory: Path, changed: set[str]) -> tuple[_Changes, Units, list[str]]:
    """Return the parameters that were changed, by component, the units of the SSP, and notes."""
    if ALL_PARAMETERS in changed or not (directory / ALL_PARAMETERS).is_file():
        what = "was changed since the export" if (directory / ALL_PARAMETERS).is_file() else "is missing"
        note = (
            f"{ALL_PARAMETERS} {what}, so that no changed value is recognised: restore it, and change the sets of the "
            "components only"
        )
        return {}, {}, [note]
    exported, units_then = parameters_of(path, directory, ALL_PARAMETERS)
    before = {parameter.name: parameter for parameter in exported}
    known = {**units_then, **structure.units}
    found: _Changes = {}
    gone = dict.fromkeys(before)
    for component in structure.components:
        for parameter in component.parameters:
            gone.pop(f"{component.name}.{parameter.name}", None)
            old = before.get(f"{component.name}.{parameter.name}")
            if old is None or (old.value, old.unit) != (parameter.value, parameter.unit):
                found.setdefault(component.name, []).append((parameter, old))
    own = listed([*gone])
    removed = f"values were removed from the SSP, which the scenario cannot state: it keeps its own of {own}"
    return found, known, [removed] if gone else []


def _experiment(root: etree._Element, structure: Structure) -> None:
    simulation = root.find("simulation")
    assert simulation is not None
    scenario_step, scenario_stop = simulation.get("step", ""), simulation.get("horizon", "")
    own_step, own_horizon = quantity(scenario_step, "s"), quantity(scenario_stop, "s")
    if own_step <= 0.0 or own_horizon <= 0.0:  # the text was changed, and is read later
        return
    step, horizon = experiment(structure, own_step, own_horizon)
    if not math.isclose(own_horizon, horizon):
        simulation.set("horizon", f"{horizon!r} s")
    if not math.isclose(own_step, step):
        simulation.set("step", f"{step!r} s")


def _apply(
    root: etree._Element,
    found: _Changes,
    robots: Mapping[str, RobotSetup],
    gains: Mapping[str, _Gains],
    known: Units,
    connected: Collection[tuple[str, str]],
) -> Iterator[str]:
    """Put changed values into the scenario; yield what does not fit there."""
    for name, parameters in found.items():
        element = root.find("leader") if name == LEADER else _one(root, "follower", "id", name)
        for parameter, old in parameters:
            if element is None or name not in robots:
                stated = old is not None and _is_gain(root, gains, parameter, old, known)
            elif (name, parameter.name) in connected:  # another component gives its value, from the start
                stated = False
            else:
                stated = _of_robot(element, robots[name], parameter, known)
            if not stated:
                yield f"{name}.{parameter.name} was changed, which the scenario cannot state: it keeps its own value"


def _is_gain(
    root: etree._Element, gains: Mapping[str, _Gains], parameter: Parameter, old: Parameter, known: Units
) -> bool:
    """Put a changed entry of a gain into the scenario, with the others of this gain; return whether it is one."""
    match = _ENTRY.fullmatch(parameter.name)
    robot, name, index = match.groups() if match else ("", "", None)
    entries, follower = gains.get(robot, {}).get((name, index is not None), []), _one(root, "follower", "id", robot)
    at = int(index or 1) - 1
    if follower is None or not 0 <= at < len(entries):
        return False
    exponents, factor = known[old.unit] if old.unit else PURE_NUMBER
    # in SI units, which a scenario leaves out
    entries[at] = parameter.in_unit(old.unit or "1", exponents, factor, known)
    if not all(map(math.isfinite, entries)):  # a scenario can state none that is not
        return False
    _named(follower, "gain", name, " ".join(map(repr, entries)))
    return True


def _of_robot(element: etree._Element, robot: RobotSetup, parameter: Parameter, known: Units) -> bool:
    """Put a changed value of a robot into the scenario; return whether that can state it."""
    variable = robot.fmu.description.by_name.get(parameter.name)
    if variable is None or variable.dimensions:
        return False
    for bound in robot.fmu.binding.of(robot.kind.pose):
        assert bound is not None
        assert bound.initial is not None
        if bound.initial.variable.name == parameter.name:
            _child(element, "pose").set(bound.role.name, _in_role(robot, parameter, bound.role, bound.initial, known))
            return True
    for column, bound in enumerate(robot.fmu.binding.of(robot.kind.command)):
        if bound is not None and bound.played_by is not None and bound.played_by.variable.name == parameter.name:
            values = robot.torque[:, column]
            if robot.name != LEADER or np.any(values != values[0]):  # its controller gives it, or a course over time
                return False
            child = _child(element, robot.kind.command_word)
            text = child.get(bound.role.name)
            stated = 0.0 if text is None else quantity(text, bound.role.unit)
            signals = float(values[0]) - stated  # which add to it
            child.set(bound.role.name, _in_role(robot, parameter, bound.role, bound.played_by, known, signals))
            return True
    if parameter.name in robot.fmu.inputs and parameter.name not in {one.variable.name for one in robot.parameters}:
        found = _input(robot, parameter, variable, known)
        if found is None:
            return False
        insert(element, [found])
    elif variable.causality in ("input", "parameter"):
        text = written(parameter, variable, robot.fmu.description, known, _bound_unit(robot, variable))
        _named(element, "parameter", parameter.name, text)
    else:
        return False
    return True


def _input(robot: RobotSetup, parameter: Parameter, variable: Variable, known: Units) -> etree._Element | None:
    """Return a constant by which an input has a changed value; it adds to the signals that the scenario has of it.

    None if these change over time.
    """
    description, roles = robot.fmu.description, robot.fmu.binding.bound
    disturbances = [bound for bound in robot.fmu.binding.of(robot.kind.disturbance) if bound is not None]
    before = [*zip(robot.inputs, robot.samples.T, strict=True), *((bound, np.zeros(1)) for bound in disturbances)]
    name, text = parameter.name, ""
    for bound, values in before:
        if bound.played_by is not None and bound.played_by.variable.name == parameter.name:
            if np.any(values != values[0]):
                return None
            less = float(values[0])
            if roles.get(bound.role.name) == bound:
                name, text = bound.role.name, _in_role(robot, parameter, bound.role, bound.played_by, known, less)
            else:  # the samples are in the FMU's unit
                text = with_unit(number_of(parameter, variable, description, known, None) - less, variable, description)
            break
    for held in robot.held:
        if held.variable.name == name and held.variable.type in WHOLE:  # signals of these are added up
            text = str(int(parameter.number) - int(held.value))
    found = etree.Element("input", name=name)
    etree.SubElement(found, "constant", value=text or written(parameter, variable, description, known))
    return found


def _bound_unit(robot: RobotSetup, variable: Variable) -> units.Unit | None:
    """Return the unit that a variable has by the role that it plays; None if it plays none."""
    for bound in robot.fmu.binding.bound.values():
        if bound.played_by is not None and bound.played_by.variable.identity == variable.identity:
            return bound.played_by.unit
    return None


def _in_role(
    robot: RobotSetup, parameter: Parameter, role: Role, number: BoundVariable, known: Units, less: float = 0.0
) -> str:
    """Return the value of a parameter, less another one, as that of the role which it plays."""
    own = number_of(parameter, number.variable, robot.fmu.description, known, number.unit)
    value = own * number.scale + number.offset - less
    return f"{value!r} {role.unit}" if role.unit != "1" else repr(value)


def _one(parent: etree._Element, tag: str, attribute: str, value: str) -> etree._Element | None:
    """Return the child with an attribute; its value may have any quotation marks, which a path may not."""
    return next((element for element in parent.iterfind(tag) if element.get(attribute) == value), None)


def _child(parent: etree._Element, tag: str) -> etree._Element:
    found = parent.find(tag)
    if found is None:
        found = etree.Element(tag)
        insert(parent, [found])
    return found


def _named(parent: etree._Element, tag: str, name: str, value: str) -> None:
    found = _one(parent, tag, "name", name)
    if found is None:
        found = etree.Element(tag, name=name)
        insert(parent, [found])
    found.set("value", value)
