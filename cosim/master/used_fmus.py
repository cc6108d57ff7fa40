"""The FMUs of a scenario's plants: built or found, opened and checked, and the values of their parameters."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import plants
from cosim.errors import InputError
from cosim.fmu.parameters import ParameterValue, understand
from cosim.fmu.solver import check_solver, check_step
from cosim.fmu.vehicle import Fmu, as_vehicle, open_fmu
from cosim.known import Known
from cosim.master.timing import timed
from cosim.scenario.scenario import PlantSource, Scenario, Setting


def open_fmus(
    scenario: Scenario, cleanup: ExitStack, timing: dict[str, float], opened: Mapping[str, Fmu], known: Known
) -> dict[str, Fmu]:
    """Return the FMU of every plant by the plant's id, also of unused plants, so that the whole file is checked.

    Parameters
    ----------
    scenario
        The scenario.
    cleanup
        Receives the clean-up callbacks.
    timing
        Receives the seconds that were spent, by part.
    opened
        FMUs that are open already, by the plant's id.
    known
        What is known of parameters.

    Raises
    ------
    InputError
        A model cannot be built, a file is no FMU that can be used, or parameters or solver do not fit the FMU.
    """
    fmus = {}
    used = {scenario.leader.plant, *(follower.plant for follower in scenario.followers)}
    checked: dict[Path, dict[str | None, Fmu]] = {}
    """FMUs of unused plants by their file, which is opened once as it is never run; of an interface those unbound."""
    built: dict[str | None, Path] = {}
    sharing = Counter(fmu.directory for fmu in opened.values())
    for source in scenario.plants.values():
        fmu = opened.get(source.id)
        if fmu is None or (source.id in used and sharing[fmu.directory] > 1):
            with timed(timing, "build"):
                path = built[source.model] if source.model in built else _fmu_path(source)
                built |= {source.model: path} if source.model else {}
            with timed(timing, "load"):
                unused = checked.get(path, {}) if source.id not in used else {}
                if source.binding is None and source.interface in unused:
                    fmu = unused[source.interface]
                elif unused:
                    fmu = as_vehicle(next(iter(unused.values())), source.where, source.binding, source.interface)
                else:
                    fmu = open_fmu(path, source.where, source.binding, source.interface)
                    cleanup.callback(fmu.close)
            if source.id not in used:
                checked.setdefault(path, {}).setdefault(source.interface if source.binding is None else None, fmu)
        fmus[source.id] = fmu
        understood(fmu, source, source.parameters, known)
        check_solver(fmu, source)
        check_step(fmu, source, scenario.step)
    return fmus


def understood(
    fmu: Fmu, source: PlantSource, settings: Sequence[Setting], known: Known | None = None
) -> tuple[ParameterValue, ...]:
    """Return the values of parameters; if the FMU replaces another one, an error names the remedy."""
    way_out = '"formation swap" writes a variant without the parts that an FMU lacks' if source.fmu else ""
    return understand(fmu, settings, way_out, known)


def _fmu_path(source: PlantSource) -> Path:
    if source.fmu is not None:
        if (name := source.fmu.name) in plants.models() and not os.path.exists(source.fmu):
            raise InputError(
                f'{name} is a built-in model, not a file: write model="{name}" instead of fmu=...', source.where
            )
        return source.fmu
    assert source.model is not None
    try:
        return plants.build(source.model)
    except plants.UnknownModel as error:
        hint = f'; a file is named by fmu="{source.model}"' if source.model.endswith(".fmu") else ""
        raise InputError(f"{error}{hint}", source.where) from None
    except plants.PlantError as error:
        raise InputError(str(error), source.where) from None
