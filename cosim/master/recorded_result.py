"""From the records of a run to its result: arrays with units and provenance."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import version

import numpy as np
from formation_controllers.geometry import range_bearing, unwrapped_bearing
from formation_controllers.vehicles import formation_of
from numpy.typing import NDArray

from cosim.control.team import Team
from cosim.errors import Failure
from cosim.fmu.package import Fmu
from cosim.master.fleets import AnyFleet
from cosim.master.recorder import Recorder
from cosim.master.robot_plants import in_own_process, tolerance_of
from cosim.master.setup import Setup
from cosim.master.who_is_who import texts, who_is_who
from cosim.results import provenance
from cosim.results.expectations.recorded import DERIVED, units_by_component
from cosim.results.result import Result, Variable
from cosim.scenario.scenario import Scenario
from cosim.vehicle.columns import RunColumns

Floats = NDArray[np.float64]

_NEEDED = ("pose", "leader_pose", "desired_range", "desired_bearing")
"""The variables from which others are computed."""

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

    The dimensions are ``time`` [s], ``robot`` (the followers' ids) and one labelled dimension for the components of
    each vector. Range and bearing, (7), are those of the true poses; the bearing is unwrapped over time. Coordinates
    say who is who; see `cosim.master.who_is_who`.

    Attributes carry the provenance: the scenario's text and seed, checksum and tool of every FMU, package and version
    of every controller, versions of the libraries, what was changed in the scenario's file, what the plants logged,
    ``status`` (``completed`` or ``incomplete``) and why the run did not reach its end.
    """
    columns, wanted = setup.columns, recorder.wanted
    computed = [name for name in DERIVED if wanted is None or name in wanted]
    needed = None if wanted is None else {*wanted, *(_NEEDED if computed else ())}
    arrays = _in_columns(recorder.arrays(needed), setup)
    samples = recorder.recorded
    coordinates = {
        "time": Variable(("time",), np.arange(samples) * scenario.step, {"units": "s", "long_name": "time"}),
        "robot": texts("robot", [follower.id for follower in scenario.followers], "follower"),
        **{along: texts(along, labels) for along, labels in columns.labels.items()},
    }
    for team in teams:
        for signal in team.controller.signals:
            if signal.components:
                dim = f"{signal.name}_component"
                coordinates[dim] = texts(dim, signal.components)
                parts = list(units_by_component(signal.components, signal.unit).values())
                coordinates[f"{dim}_units"] = texts(dim, parts, f"unit of each component of {signal.name}")
    robots = (setup.leader, *setup.followers)
    coordinates |= who_is_who(scenario, robots, setup.fmus, fleet.logged)
    variables = {
        name: Variable(("time", *variable.dims), arrays[name], variable.attributes)
        for name, variable in recorder.variables.items()
        if wanted is None or name in wanted
    }
    values = _computed(arrays, samples, teams, columns) if computed else {}
    for name in computed:
        units, long_name = DERIVED[name]
        variables[name] = Variable(("time", "robot"), values[name], {"units": units, "long_name": long_name})
    attributes = _provenance(scenario, samples, teams, setup.fmus, fleet)
    return Result(variables, coordinates, attributes | provenance.attributes(scenario.path, scenario.changes, failure))


def _computed(
    arrays: Mapping[str, Floats], samples: int, teams: Sequence[Team], columns: RunColumns
) -> dict[str, Floats]:
    """Return the variables that are computed from recorded ones."""
    desired = np.stack([arrays["desired_range"], arrays["desired_bearing"]], axis=-1)
    formation = np.full_like(desired, np.nan)
    for team in teams:
        if formation_of(team.vehicle) is not None:
            pose = arrays["pose"][:, team.rows][..., columns.pose.of[team.vehicle.kind]]
            leader_pose = np.zeros((samples, 1, pose.shape[-1]))  # of which position and heading count
            leader_pose[..., :3] = arrays["leader_pose"][:, np.newaxis, :3]
            formation[:, team.rows] = range_bearing(pose, leader_pose, team.vehicle)
    if samples:
        formation[..., 1] = unwrapped_bearing(formation[..., 1], desired[..., 1])
    error = formation - desired
    return {
        "range": formation[..., 0],
        "bearing": formation[..., 1],
        "range_error": error[..., 0],
        "bearing_error": error[..., 1],
    }


def _in_columns(arrays: dict[str, Floats], setup: Setup) -> dict[str, Floats]:
    """Return what was recorded with the entries of every robot in the columns of the result."""
    columns, kinds = setup.columns, [robot.kind for robot in setup.followers]
    called = columns.commands
    for of, names in (
        (columns.pose, ("pose", "measured_pose", "leader_pose", "measured_leader_pose")),
        (columns.velocity, ("velocity", "leader_velocity")),
        (columns.command, (called, f"leader_{called}")),
    ):
        for name in names:
            if name not in arrays:
                continue
            if "leader" in name:
                arrays[name] = of.spread(arrays[name][:, np.newaxis], [setup.leader.kind])[:, 0]
            else:
                arrays[name] = of.spread(arrays[name], kinds)
    return arrays


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
                    "robots": team.robots,
                }
                for team in teams
            ]
        ),
        "plant_messages": json.dumps(fleet.messages),
        "versions": _versions(),
    }


@cache
def _versions() -> str:
    return json.dumps({"python": platform.python_version(), **{library: version(library) for library in LIBRARIES}})
