"""Scenarios that the command line names, with the edits of its options."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from lxml import etree

import plants
from cosim.cli.console import warn
from cosim.control.environment import environment_at
from cosim.control.hosts import Host
from cosim.control.installed_laws import installed
from cosim.errors import InputError
from cosim.missing_file import absent
from cosim.results.expectations import understood
from cosim.scenario.edits import (
    Change,
    Edit,
    as_changes,
    set_binding,
    set_controller,
    set_environment,
    set_fmu,
    set_seed,
    split_setting,
)
from cosim.scenario.reader import read_scenario
from cosim.scenario.scenario import Scenario


def read(path: Path, options: argparse.Namespace) -> Scenario:
    """Read a scenario, apply the options that edit it, and isolate untrusted plants."""
    for folder in options.untrusted:
        if not os.path.isdir(folder):
            raise InputError(f"--untrusted {folder}: there is no such folder")
    once("--set", [(setting, *split_setting(setting)) for setting in options.set])
    scenario = read_scenario(path, [*options.set, *_changes(options)], options.untrusted)
    fmus = [Path(os.path.realpath(plant.fmu)) for plant in scenario.plants.values() if plant.fmu is not None]
    if not any(understood(expectation).others for expectation in scenario.expectations):  # whose plants might be meant
        for folder in options.untrusted:
            if not any(fmu.is_relative_to(os.path.realpath(folder)) for fmu in fmus):
                warn(f"--untrusted {folder}: no FMU of {path} is in this folder")
    return scenario


def take_name(names: dict[str, Path], scenario: Scenario, path: Path) -> None:
    """Add a scenario to the names of one command, each with its file.

    Raises
    ------
    InputError
        Another file has the name.
    """
    if scenario.name in names:
        raise InputError(
            f"this scenario and {names[scenario.name]} are both named {scenario.name!r}, and their results would share "
            "a folder: give one of them another name",
            scenario.where,
        )
    names[scenario.name] = path


def _changes(options: argparse.Namespace) -> Iterator[Change]:
    if options.seed is not None:
        yield set_seed(options.seed)
    for plant, fmu in pairs("--plant", options.plant, "ID=FMU"):
        yield _of_file(f"--plant {plant}=", fmu, set_fmu(plant, Path(fmu)))
    for plant, file in pairs("--binding", options.binding, "ID=FILE.xml"):
        yield _of_file(f"--binding {plant}=", file, set_binding(plant, Path(file)))
    for controller, name in pairs("--controller", options.controller, "ID=NAME"):
        found = installed(name)
        yield set_controller(controller, name, found.package, found.version)
    for controller, folder in pairs("--environment", options.environment, "ID=DIR"):
        yield set_environment(controller, Path(folder), _laws_in(Path(folder)))
    yield from as_changes((), options.horizon, options.expectations)


def _laws_in(folder: Path) -> dict[str, tuple[str, str]]:
    """Return package and version of each law in an environment."""
    host = Host(environment_at(folder))
    try:
        return host.installed()
    finally:
        host.stop()


def _of_file(option: str, file: str, edit: Edit) -> Edit:
    """Return the edit, or refuse a missing file; `option` is the text before the name of the file."""
    return Edit(edit.words, _with_file, (option, file, edit))


def _with_file(root: etree._Element, option: str, file: str, edit: Edit) -> None:
    edit(root)
    path = Path(file)
    if not os.path.exists(path):
        hint = f': "formation build {file}" makes the FMU of the built-in model' if file in plants.models() else ""
        raise InputError(f"{option}{file}: {absent(path)}{hint}")


def pairs(option: str, values: list[str], form: str) -> Iterator[tuple[str, str]]:
    """Return the two sides of each value of an option that is an equation.

    Raises
    ------
    InputError
        One has no two sides, or the left side of one before it.
    """
    sides = [(value, *_sides(option, value, form)) for value in values]
    once(option, sides)
    for _, left, right in sides:
        yield left, right


def _sides(option: str, value: str, form: str) -> tuple[str, str]:
    left, equals, right = value.partition("=")
    if not (left and equals and right):
        raise InputError(f"{option} {value}: expected {form}")
    return left, right


def once(option: str, settings: Iterable[tuple[str, str, str]]) -> None:
    """Refuse an option that gives one thing two values.

    Parameters
    ----------
    option
        Its name.
    settings
        Each of its values as written, its subject, and the value given to that.

    Raises
    ------
    InputError
        One is about the same as one before it.
    """
    seen: dict[str, str] = {}
    for written, about, given in settings:
        if about in seen:
            raise InputError(f"{option} {written}: {about} is given twice, first as {seen[about]}: give it once")
        seen[about] = given
