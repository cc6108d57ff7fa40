"""The interfaces that an FMU offers, and which of them is used."""

from __future__ import annotations

import math
import os
import re

from cosim.errors import InputError, Location
from cosim.fmu.model_description import Interface, ModelDescription, Variable
from cosim.fmu.package import Package
from cosim.plant.spec import CO_SIMULATION, MODEL_EXCHANGE

_LONGEST = 250
"""Bytes of a model identifier; file systems take 255 with the suffix of a library."""


def interfaces(description: ModelDescription) -> dict[str, Interface]:
    """Return the FMU's description of each interface that can be used here, by the interface's name."""
    known = {CO_SIMULATION: description.coSimulation, MODEL_EXCHANGE: description.modelExchange}
    return {name: about for name, about in known.items() if about is not None}


def experiment_number(description: ModelDescription, name: str) -> float | None:
    """Return a number of an FMU's default experiment, such as its ``tolerance``; None if it is not more than zero."""
    try:
        number = float(getattr(description.defaultExperiment, name, None) or 0.0)
    except ValueError:
        return None
    return number if 0.0 < number < math.inf else None


def choose_interface(package: Package, wanted: str, where: Location | None) -> str:
    """Return the interface that is used of an FMU: the wanted one, or the first that it offers.

    Raises
    ------
    InputError
        It does not offer it, or nothing that can be used here.
    """
    description = package.description
    version = description.fmiVersion
    offered = interfaces(description)
    if not version.startswith(("1.", "2.", "3.")) or not offered:
        kinds = [
            name
            for name, about in (
                ("Co-Simulation", description.coSimulation),
                ("Model Exchange", description.modelExchange),
                ("Scheduled Execution", description.scheduledExecution),
            )
            if about is not None
        ]
        raise InputError(
            f"the FMU {package.path} is FMI {version} {' and '.join(kinds) or 'of another kind'}; expected "
            "Co-Simulation or Model Exchange of FMI 1.0, 2.0 or 3.0",
            where,
        )
    if wanted and wanted not in offered:
        raise InputError(f"the FMU {package.path} does not offer {wanted}, only {', '.join(offered)}", where)
    chosen = wanted or next(iter(offered))
    identifier = offered[chosen].modelIdentifier
    if problem := _unusable(identifier or "", version):
        raise InputError(f"the FMU {package.path} has the model identifier {identifier!r}, {problem}", where)
    clocks = [v.name for v in description.modelVariables if v.type == "Clock" and _ticked_from_outside(v)]
    if clocks:
        raise InputError(
            f"the FMU {package.path} has the input clock{'s' * (len(clocks) > 1)} {', '.join(map(repr, clocks[:3]))}"
            f"{', ...' if len(clocks) > 3 else ''}, which the importer must tick: input clocks are not supported here",
            where,
        )
    return chosen


def _ticked_from_outside(clock: Variable) -> bool:
    """Return whether an importer must let a clock of FMI 3.0 tick; triggered ones may well never tick."""
    return bool(clock.causality == "input" and clock.intervalVariability != "triggered")


def _unusable(identifier: str, version: str) -> str:
    """Return why a model identifier cannot be used: it is a file's name, and part of C functions' names in FMI 1.0."""
    if len(os.fsencode(identifier)) > _LONGEST:
        return f"which is too long for the name of a file: at most {_LONGEST} bytes"
    if version == "1.0":
        return "" if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", identifier) else "which is no C identifier"
    outside = identifier in ("", ".", "..") or any(character in identifier for character in "/\\:\0")
    return "which is no name of a file" if outside else ""
