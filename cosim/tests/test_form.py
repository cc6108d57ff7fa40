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
from cosim.export.courses import courses_of
from cosim.export.formats import export_result
from cosim.report.content import content_of
from cosim.report.page import save_report
from cosim.results.figure import save_figure
from cosim.results.files import load_result, load_run, save
from cosim.results.form import in_form
from cosim.results.result import Result
from cosim.scenario.scenario import Scenario


@pytest.fixture(scope="module")
def run(short_line: Scenario) -> xr.Dataset:
    return cosim.run(short_line)


def test_a_run_has_it_in_memory_and_in_its_file(run: xr.Dataset, tmp_path: Path) -> None:
    assert in_form(Result.of(run)).robots == Result.of(run).robots
    save(run, tmp_path / "result.nc")
    assert load_run(tmp_path).robots == Result.of(run).robots


@pytest.mark.parametrize("scenario", ["mixed_team.xml", "differential_drive.xml"])
def test_a_mixed_team_has_it(scenarios: Path, scenario: str) -> None:
    result = Result.of(cosim.run(scenarios / scenario, horizon=0.1, expectations=False))
    assert in_form(result).data_vars.keys() == result.data_vars.keys()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda run: run.drop_vars("pose"), "'pose' is missing in it"),
        (lambda run: run.drop_attrs(deep=False), "'scenario_name' is missing in it"),
        (lambda run: run.assign_attrs(scenario=1), "'scenario' is 1, no text"),
        (lambda run: run.assign_attrs(scenario_file=1), "'scenario_file' is 1, no text"),
        (lambda run: run.assign_attrs(controllers="no"), "JSONDecodeError: .*"),
        (lambda run: run.assign_attrs(seed=[1, 2]), "TypeError: .*"),
        (
            lambda run: run.assign_coords(vehicle_wheelbase=("own", [1.2])),
            r"'vehicle_wheelbase' has the dimensions \(own\), not \(vehicle\)",
        ),
        (lambda run: run.assign_attrs(step=0.0), "its step is 0.0, no time above zero"),
        (lambda run: run.assign_attrs(horizon=np.inf), "its horizon is inf, no time above zero"),
        (
            lambda run: run.assign(pose=run.pose[:, 0]),
            r"'pose' has the dimensions \(time, pose_component\), not \(time, robot, pose_component\)",
        ),
        (lambda run: run.assign(torque=run.torque.astype(str)), "'torque' holds no numbers"),
        (lambda run: run.assign_coords(robot=[1.0, 2.0, 3.0, 4.0]), "'robot' holds numbers"),
        (lambda run: run.drop_vars("outline_turned_by"), "'outline_turned_by' is missing in it"),
        (lambda run: run.drop_vars("pose_name"), "'pose_name' is missing in it"),
        (lambda run: run.isel(outline_axis=[0]), "'outline_axis' names no two axes"),
        (lambda run: run.isel(time=slice(None, None, -1)), "its times do not increase"),
        (lambda run: run.isel(robot=slice(0)), "'robot' has 0 of at least 1 entries"),
        (lambda run: run.isel(pose_component=[0]), "'pose_component' has 1 of at least 2 entries"),
        (lambda run: run.isel(pose_component=[0, 1, 2]), "'pose_name' lacks 'gamma', which turns a part"),
        (lambda run: run.isel(robot=[0, 0]), "it has a robot twice"),
        (lambda run: run.assign_coords(robot=list("abcd")), "'vehicle' does not name 'a'"),
    ],
)
def test_what_has_it_not_is_refused(
    run: xr.Dataset, tmp_path: Path, change: Callable[[xr.Dataset], Any], said: str
) -> None:
    changed = change(run)
    with pytest.raises(InputError, match=f"^this is not the result of a run: {said}$"):
        in_form(Result.of(changed))


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
    assert "own" not in in_form(Result.of(own))


@pytest.mark.parametrize(
    "change",
    [
        lambda run: run.assign(near=abs(run.range_error) < 0.1),
        lambda run: run.assign(own=run.torque[..., 0].astype(str)),
        lambda run: run.assign_coords(moment=("time", (run.time.values * 1e9).astype("datetime64[ns]"))),
        lambda run: run.assign(moment=("time", (run.time.values * 1e9).astype("timedelta64[ns]"))),
        lambda run: run.assign_coords(phase=("time", np.where(run.time < 0.1, "start", "end"))),
        lambda run: run.assign(own=(("robot", "k"), np.full((4, 2), "a"))),
        lambda run: run.assign(own=(("time", "k", "robot"), np.zeros((run.sizes["time"], 2, 4)))),
        lambda run: run.assign(own=(("time", "k"), np.zeros((run.sizes["time"], 2)))).assign_coords(k=["a", "a"]),
        lambda run: run.transpose(),
        lambda run: run.isel(robot=[2]),
        lambda run: run.isel(robot=[2, 0]),
    ],
)
def test_a_result_that_somebody_has_edited_is_read_by_all(
    run: xr.Dataset, tmp_path: Path, change: Callable[[xr.Dataset], xr.Dataset]
) -> None:
    change(run).to_netcdf(tmp_path / "result.nc", engine="h5netcdf")
    result = load_run(tmp_path)
    for robot in result.robots:
        assert np.array_equal(result.of_robot("pose", robot), run.pose.sel(robot=robot))
    save_figure(result, tmp_path / "figure.png")
    export_result(result, tmp_path / "all.csv")
    parts = {one["id"]: one["parts"] for one in content_of(result)["vehicles"]}
    assert list(parts) == ["leader", *result.robots]
    assert all(parts.values())


def test_vehicles_are_found_by_their_names(scenarios: Path) -> None:
    run = cosim.run(scenarios / "mixed_team.xml", horizon=0.1, expectations=False)
    names, last = run.pose_name.values, run.sizes["robot"] - 1
    found = in_form(Result.of(run.isel(robot=[last, 1])))
    assert found["vehicle"].values.tolist() == ["leader", *found.robots]
    assert found["pose_name"].values.tolist() == names[[0, last + 1, 2]].tolist()
    poses = [course for course in courses_of(found) if course.signal == "pose" and course.robot == found.robots[0]]
    assert [course.component for course in poses] == [name for name in names[last + 1] if name]


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
        ("import os\nos.kill(os.getpid(), 9)", ""),
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
