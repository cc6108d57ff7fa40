"""SSPs of scenarios in masters that are not ours, beside the run of ours with the same delay."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import xarray as xr
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import read_ssv
from numpy.typing import NDArray

import cosim
from cosim.scenario.scenario import Scenario
from cosim.ssp.exported import export_ssp
from cosim.ssp.imported import Imported
from plants.tests.other_masters import need

Floats = NDArray[np.float64]


def apart(one: Floats, other: Floats) -> float:
    """Return the largest difference of two arrays; two NaN at one place are equal, one is infinitely apart."""
    if one.shape != other.shape:
        return np.inf
    missing = np.isnan(one) & np.isnan(other)
    differences = np.abs(np.where(missing, 0.0, one) - np.where(missing, 0.0, other))
    return float(np.nan_to_num(differences, nan=np.inf, posinf=np.inf).max(initial=0.0))


class Exported:
    """A scenario, its SSP, and the trajectories of the run to compare with."""

    def __init__(self, scenario: Scenario, folder: Path) -> None:
        self.scenario = scenario
        self.path = folder / f"{scenario.name}.ssp"
        self.notes = export_ssp(self.scenario, self.path)
        self.expected = _poses(cosim.run(_delayed(self.scenario, folder)))
        self.names = list(self.expected)

    @property
    def ticks(self) -> int:
        return self.scenario.ticks

    def apart(self, found: Mapping[str, Floats]) -> float:
        """Return the largest distance of trajectories after each step from those of the run."""
        return max(apart(found[name], values[1:]) for name, values in self.expected.items())


def _delayed(scenario: Scenario, folder: Path) -> Path:
    """Return a scenario whose actuators are one sample late, in a file."""
    text = re.sub("(<actuator>)", rf'\1<delay time="{scenario.step!r} s"/>', scenario.text)
    if "<actuator>" not in text:
        text = text.replace("<leader", f'<actuator><delay time="{scenario.step!r} s"/></actuator><leader', 1)
    path = folder / "delayed.xml"
    path.write_text(text)
    return path


def _poses(result: xr.Dataset) -> dict[str, Floats]:
    """Return the poses of all robots by robot and entry."""
    found: dict[str, Floats] = {}
    for robot in result.vehicle.values.tolist():
        poses = result.leader_pose if robot == "leader" else result.pose.sel(robot=robot)
        for entry, values in zip(result.pose_name.sel(vehicle=robot).values.tolist(), poses.values.T, strict=True):
            if entry:
                found[f"{robot}.{entry}"] = values
    return found


def in_fmpy(exported: Exported) -> dict[str, Floats]:
    """Return the poses after each step, by robot and entry."""
    step = exported.scenario.step
    result = simulate_ssp(
        str(exported.path),
        stop_time=(exported.ticks - 0.5) * step,
        step_size=step,
        parameter_set=read_ssv(str(exported.path), "resources/parameters.ssv"),
    )
    assert len(result) == exported.ticks
    return {name: result[name] for name in exported.names}


def in_libcosim(exported: Exported) -> dict[str, Floats]:
    """Return the poses after each step, by robot and entry."""
    need("libcosimpy")
    from libcosimpy.CosimEnums import CosimVariableType
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

    log_output_level(CosimLogLevel.ERROR)
    execution = CosimExecution.from_ssp_file(str(exported.path))
    observer = CosimObserver.create_time_series(exported.ticks + 1)
    assert execution.add_observer(observer)
    places = {
        f"{info.name.decode()}.{variable.name.decode()}": (info.index, variable.reference)
        for info in execution.slave_infos()
        for variable in execution.slave_variables(info.index)
    }
    for name in exported.names:
        assert observer.start_time_series(*places[name], CosimVariableType.REAL)
    assert execution.step(exported.ticks)
    return {
        name: np.array(observer.time_series_real_samples(*places[name], 1, exported.ticks)[2])
        for name in exported.names
    }


def in_ecos(exported: Exported) -> dict[str, Floats]:
    """Return the poses after each step, by robot and entry."""
    need("ecospy")
    from ecospy import EcosSimulation

    rows = []
    with EcosSimulation(ssp_path=str(exported.path), step_size=exported.scenario.step) as simulation:
        simulation.init(parameter_set="scenario")
        for _ in range(exported.ticks):
            simulation.step()
            rows.append([simulation.get_real(name.replace(".", "::")) for name in exported.names])
    return dict(zip(exported.names, np.array(rows).T, strict=True))


MASTERS: Mapping[str, Callable[[Exported], dict[str, Floats]]] = {
    "libcosim": in_libcosim,
    "ecos": in_ecos,
    "FMPy": in_fmpy,
}


def written(imported: Imported) -> Path:
    """Write what an SSP was imported to; return the scenario."""
    for path, content in imported.files.items():
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
    return imported.scenario
