"""The form of a result: every run has it, and what has it not is refused before anybody reads it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr

import cosim
from cosim.errors import InputError
from cosim.export.formats import export_result
from cosim.report.page import save_report
from cosim.results.figure import save_figure
from cosim.results.files import load_result, load_run, save
from cosim.results.form import check
from cosim.results.result import Result
from cosim.scenario.scenario import Scenario


@pytest.fixture(scope="module")
def run(short_line: Scenario) -> xr.Dataset:
    return cosim.run(short_line)


def test_a_run_has_it_in_memory_and_in_its_file(run: xr.Dataset, tmp_path: Path) -> None:
    check(Result.of(run))
    save(run, tmp_path / "result.nc")
    assert load_run(tmp_path).robots == Result.of(run).robots


@pytest.mark.parametrize("scenario", ["mixed_team.xml", "differential_drive.xml"])
def test_a_mixed_team_has_it(scenarios: Path, scenario: str) -> None:
    check(Result.of(cosim.run(scenarios / scenario, horizon=0.1, expectations=False)))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda run: run.drop_vars("pose"), "'pose' is missing in it"),
        (lambda run: run.drop_attrs(deep=False), "'scenario_name' is missing in it"),
        (lambda run: run.assign_attrs(scenario=1), "'scenario' is 1, no text"),
        (lambda run: run.assign_attrs(scenario_file=1), "'scenario_file' is 1, no text"),
        (lambda run: run.assign_attrs(controllers="no"), "JSONDecodeError: .*"),
        (lambda run: run.assign_attrs(seed=[1, 2]), "TypeError: .*"),
        (lambda run: run.assign_attrs(step=0.0), "its step is 0.0, no time above zero"),
        (lambda run: run.assign_attrs(horizon=np.inf), "its horizon is inf, no time above zero"),
        (
            lambda run: run.assign(pose=run.pose[:, 0]),
            r"'pose' has the dimensions \(time, pose_component\), not \(time, robot, pose_component\)",
        ),
        (lambda run: run.assign(torque=run.torque.astype(str)), "'torque' holds no numbers"),
        (lambda run: run.assign(own=run.torque[..., 0].astype(str)), "'own' holds no numbers"),
        (lambda run: run.assign_coords(robot=[1.0, 2.0, 3.0, 4.0]), "'robot' holds numbers"),
        (lambda run: run.drop_vars("outline_turned_by"), "'outline_turned_by' is missing in it"),
        (lambda run: run.drop_vars("pose_name"), "'pose_name' is missing in it"),
        (lambda run: run.isel(outline_axis=[0]), "'outline_axis' names no two axes"),
        (lambda run: run.isel(time=slice(None, None, -1)), "its times do not increase"),
    ],
)
def test_what_has_it_not_is_refused(
    run: xr.Dataset, tmp_path: Path, change: Callable[[xr.Dataset], Any], said: str
) -> None:
    changed = change(run)
    with pytest.raises(InputError, match=f"^this is not the result of a run: {said}$"):
        check(Result.of(changed))


def test_what_others_have_added_or_left_out_is_no_matter(run: xr.Dataset, tmp_path: Path) -> None:
    names = [name for name in run.variables if str(name).startswith(("outline", "message", "plant"))]
    own = run.drop_vars(names).assign(own=("robot", ["a", "b", "c", "d"]), note="a", first=run.pose[0])
    cosim.summary_of(own)
    save_report([own], tmp_path / "report.html")
    save_figure(own, tmp_path / "figure.png")
    for suffix in ("csv", "mcap", "mat"):
        export_result(own, tmp_path / f"run.{suffix}")
    assert min(path.stat().st_size for path in tmp_path.iterdir()) > 1000
    assert len(list(tmp_path.iterdir())) == 5


def test_a_damaged_file_is_refused_in_a_sentence_alone(
    run: xr.Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The library prints a traceback where it cannot close a file, and a warning where dimensions have no names."""
    path = tmp_path / "result.nc"
    save(run, path)
    data = bytearray(path.read_bytes())
    said = []
    for at in range(0, len(data), len(data) // 12):
        path.write_bytes(data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :])
        try:
            load_result(path)
        except InputError as error:
            said.append(str(error))
    assert said
    assert not any("\n" in sentence for sentence in said)
    with h5py.File(path, "w") as file:
        file["a"] = np.zeros((3, 4))
    with pytest.raises(InputError, match="'scenario_name' is missing in it"):
        load_run(path)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("library", "said"),
    [
        ("import os\nos.abort()", "it is damaged so that the library which reads it crashes"),
        ("while True: pass", "reading it takes more than 0.5 s"),
        ("1 / 0", ""),
    ],
)
def test_a_library_that_does_not_survive_a_file(
    run: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, library: str, said: str
) -> None:
    path = tmp_path / "result.nc"
    save(run, path)
    (tmp_path / "h5netcdf.py").write_text(library)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr("cosim.results.trial_reading.LIMIT", 0.5)
    if said:
        with pytest.raises(InputError, match=f"cannot be read as the result of a run: {said}"):
            load_result(path)
    else:
        assert load_result(path).identical(run)
