"""From the records of a run to its result: its signals, who is who, and provenance."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib.metadata import version
from typing import TypeAlias

from cosim.control.team import Team
from cosim.errors import Failure
from cosim.fmu.vehicle import Fmu
from cosim.master.fleets import AnyFleet
from cosim.master.recorded_signals import recorded_signals
from cosim.master.recorder import Recorder
from cosim.master.robot_plants import in_own_process, tolerance_of
from cosim.master.setup import Setup
from cosim.master.who_is_who import who_is_who
from cosim.results import provenance
from cosim.results.result import Result
from cosim.scenario.scenario import Scenario
from cosim.storage import Storage

MakeResult: TypeAlias = Callable[[Scenario, Setup, Recorder, Sequence[Team], AnyFleet, Failure | None], Result]
"""Makes the result of a run's records, as `recorded_result` does."""

LIBRARIES = ("formation-cosim", "formation-controllers", "fmpy", "numpy", "numba", "xarray")


def recorded_result(
    scenario: Scenario,
    setup: Setup,
    recorder: Recorder,
    teams: Sequence[Team],
    fleet: AnyFleet,
    failure: Failure | None = None,
) -> Result:
    """Return the records of a run that are wanted, with the variables that are computed from them.

    See `cosim.master.recorded_signals` for these. Coordinates say who is who; see `cosim.master.who_is_who`.

    Attributes carry the provenance: the scenario's text and seed, checksum and tool of every FMU, package and version
    of every controller, versions of the libraries, what was changed in the scenario's file, what the plants logged,
    ``status`` (``completed`` or ``incomplete``) and why the run did not reach its end.
    """
    signals = recorded_signals(scenario, setup, recorder, teams)
    robots = (setup.leader, *setup.followers)
    described = who_is_who(scenario, robots, setup.fmus, fleet.logged)
    attributes = _provenance(scenario, recorder.recorded, teams, setup.fmus, fleet)
    return Result(
        signals.data_vars,
        {**signals.coords, **described},
        attributes | provenance.attributes(scenario.path, scenario.changes, failure),
    )


def _provenance(
    scenario: Scenario, samples: int, teams: Sequence[Team], fmus: Mapping[str, Fmu], fleet: AnyFleet
) -> dict[str, str | int | float]:
    return {
        "title": scenario.title,
        "scenario_name": scenario.name,
        "scenario": scenario.text,
        "status": "completed" if samples == scenario.ticks + 1 else "incomplete",
        "seed": str(scenario.seed),  # text, as a seed may exceed the integers of NetCDF
        "step": scenario.step,
        "horizon": scenario.horizon,
        "plants": json.dumps(
            {
                name: {
                    "file": fmu.path.name,
                    "sha256": fmu.sha256,
                    "fmi_version": fmu.description.fmiVersion,
                    "interface": fmu.interface,
                    "process": "its own" if in_own_process(fmu, scenario.plants[name]) else fleet.process,
                    "tolerance": tolerance_of(fmu, scenario.plants[name]),
                    "generation_tool": fmu.description.generationTool,
                    "binding": fmu.binding.described(),
                }
                for name, fmu in fmus.items()
            }
        ),
        "controllers": json.dumps(
            [
                {
                    "name": team.law.source.name,
                    "package": team.law.package,
                    "version": team.law.version,
                    "files": team.law.content,
                    "robots": team.robots,
                    **({"environment": dict(team.law.environment)} if team.law.environment else {}),
                }
                for team in teams
            ]
        ),
        "plant_messages": json.dumps(fleet.messages),
        "versions": versions(),
    }


@cache
def versions() -> str:
    """Return the versions of Python and of the libraries, as a result keeps them."""
    return json.dumps({"python": platform.python_version(), **{library: version(library) for library in LIBRARIES}})


def part_of_result(
    scenario: Scenario,
    setup: Setup,
    recorder: Recorder,
    teams: Sequence[Team],
    fleet: AnyFleet,
    ticks: slice,
    before: Result | None = None,
    *,
    described: bool = False,
) -> Result:
    """Return some of the recorded ticks of a run, which may go on; see `cosim.master.records.Part`."""
    setup = replace(setup, storage=Storage())  # that of the run is not for another thread
    part = recorder.part(ticks)
    if described:
        return recorded_result(scenario, setup, part, teams, fleet)
    bearings = None if before is None else before["bearing"].values[-1]
    return recorded_signals(scenario, setup, part, teams, bearings)


def only_signals(
    scenario: Scenario,
    setup: Setup,
    recorder: Recorder,
    teams: Sequence[Team],
    fleet: AnyFleet,
    failure: Failure | None = None,
) -> Result:
    """Return what is wanted of a run that nobody keeps: without who is who and provenance."""
    return recorded_signals(scenario, setup, recorder, teams)
