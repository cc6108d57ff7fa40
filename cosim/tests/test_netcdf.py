"""The file of a result: netCDF-4 in which xarray reads the same dataset that it would have written itself."""

import io
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr

import cosim
from cosim.errors import OutputError, RunInterrupted, SimulationError
from cosim.results.files import annotate, load, save, write
from cosim.results.netcdf import attributes_of
from cosim.results.result import Result, Variable
from cosim.scenario.edits import set_value

EXAMPLE = Path(__file__).with_name("example.xml")
SHORT: dict[str, Any] = {"horizon": 0.2, "expectations": False}
LIGHT = set_value("//parameter[@name='m_c']/@value=0.01 kg")


def variable(dims: str, values: Any, **attributes: str | float) -> Variable:
    return Variable(tuple(dims.split()), np.asarray(values), attributes)


def made_up(samples: int, messages: int) -> Result:
    """Return a result of two robots with texts in other alphabets, whole numbers, and dimensions of any size."""
    numbers = np.arange(samples * 4.0).reshape(samples, 2, 2)
    numbers[: samples // 2] = np.nan
    numbers[samples // 2 : samples // 2 + 1] = np.inf
    return Result(
        {
            "pose": variable("time robot pose_component", numbers, units="m, m", long_name="größe, 位置"),
            "leader_pose": variable("time pose_component", numbers[:, 0]),
            "range_error": variable("time robot", numbers[..., 1], singular_below=0.1),
            "samples": variable("", 3.0),
        },
        {
            "time": variable("time", np.arange(samples) * 0.02, units="s"),
            "robot": variable("robot", ["erster", "zweiter Läufer"]),
            "pose_component": variable("pose_component", ["x", "y"]),
            "pose_component_units": variable("pose_component", ["m", ""]),
            "robot_kind": variable("robot", ["", "Anhänger"]),
            "message_text": variable("message", np.array(["über 90°"] * messages, dtype=np.str_)),
            "message_count": variable("message", np.arange(messages), long_name="how many times"),
            "message_time": variable("message", np.full(messages, np.nan)),
            "entry": variable("robot pose_component", [["a", "ß"], ["", "d"]]),
        },
        {"title": "Vier Läufer", "step": 0.02, "ticks": 3, "empty": "", "long": "ä" * 100_000, "status": "completed"},
    )


def with_messages() -> Result:
    return made_up(samples=5, messages=3)


def without_messages() -> Result:
    return made_up(samples=5, messages=0)


def without_samples() -> Result:
    return made_up(samples=0, messages=0)


def complete() -> Result:
    return Result.of(cosim.run(EXAMPLE, **SHORT))


def of_many_kinds() -> Result:
    return Result.of(cosim.run(Path(__file__).parents[2] / "scenarios" / "mixed_team.xml", **SHORT))


def diverged() -> Result:
    with pytest.raises(SimulationError) as failed:
        cosim.run(EXAMPLE, [LIGHT], expectations=False)
    assert isinstance(failed.value.recorded, Result)
    return failed.value.recorded


def interrupted() -> Result:
    def stop(tick: int) -> None:
        if tick > 3:
            raise KeyboardInterrupt

    scenario = cosim.read_scenario(EXAMPLE).edited(**SHORT)
    with cosim.Simulation(scenario) as simulation, pytest.raises(RunInterrupted) as stopped:
        simulation.run(stop)
    assert isinstance(stopped.value.recorded, Result)
    return stopped.value.recorded


@pytest.mark.parametrize(
    "result", [with_messages, without_messages, without_samples, complete, of_many_kinds, diverged, interrupted]
)
def test_a_file_holds_the_dataset_as_xarray_would_have_written_it(result: Callable[[], Result], tmp_path: Path) -> None:
    made = result()
    save(made, path := tmp_path / "result.nc")
    by_xarray = io.BytesIO()
    made.dataset.to_netcdf(by_xarray, engine="h5netcdf")
    with xr.open_dataset(path, engine="h5netcdf") as read, xr.open_dataset(by_xarray, engine="h5netcdf") as other:
        xr.testing.assert_identical(read, made.dataset)
        for name in other.variables:
            assert read[name].dtype == other[name].dtype, name
            assert read[name].encoding.get("coordinates") == other[name].encoding.get("coordinates"), name
        assert read.encoding.get("unlimited_dims") == other.encoding.get("unlimited_dims")
    xr.testing.assert_identical(load(path), made.dataset)
    assert_netcdf(path, made)


def assert_netcdf(path: Path, result: Result) -> None:
    """Check what the netCDF library asks of an HDF5 file: a scale with a number for each dimension, and who has it."""
    with h5py.File(path) as file:
        assert file.attrs["_NCProperties"].startswith(b"version=2,")
        scales = {dim: file[dim] for dim in result.sizes}
        assert sorted(int(scale.attrs["_Netcdf4Dimid"]) for scale in scales.values()) == list(range(len(scales)))
        for dim, scale in scales.items():
            assert scale.is_scale
            name = scale.attrs["NAME"].decode()
            assert name == dim if dim in result.coords else name.startswith("This is a netCDF dimension but not")
        for name, one in (result.data_vars | result.coords).items():
            numbers = [int(scales[dim].attrs["_Netcdf4Dimid"]) for dim in one.dims]
            assert list(file[name].attrs.get("_Netcdf4Coordinates", [])) == numbers
            if name not in scales:
                assert [file[name].dims[axis][0].name for axis in range(len(one.dims))] == [f"/{d}" for d in one.dims]


def test_a_dataset_is_written_as_well(tmp_path: Path) -> None:
    dataset = with_messages().dataset
    save(dataset, path := tmp_path / "result.nc")
    xr.testing.assert_identical(load(path), dataset)
    part = load(path).isel(time=slice(1, 3), robot=0)
    save(part, path)
    xr.testing.assert_identical(load(path), part)


def test_attributes_are_added_and_replaced(tmp_path: Path) -> None:
    result = with_messages()
    save(result, path := tmp_path / "result.nc")
    annotate(path, verdicts="[]", title="Fünf")
    annotate(path, verdicts="[1]")
    expected = result.dataset.assign_attrs(verdicts="[1]", title="Fünf")
    xr.testing.assert_identical(load(path), expected)
    assert attributes_of(path).items() >= {"verdicts": "[1]", "title": "Fünf"}.items()


def test_a_signal_names_any_number_of_robots(tmp_path: Path) -> None:
    """By an attribute that is longer than what the library keeps beside a variable (64 KiB)."""
    robots = [f"follower_{number}" for number in range(20_000)]
    course = variable("time robot", np.zeros((1, len(robots))), units="1", robots=" ".join(robots))
    names = {"time": variable("time", np.zeros(1)), "robot": variable("robot", robots)}
    result = Result({f"signal_{number}": course for number in range(2)}, names, {"status": "completed"})
    save(result, path := tmp_path / "result.nc")
    assert load(path)["signal_1"].attrs["robots"].split() == robots


def test_values_that_a_file_cannot_hold_are_refused(tmp_path: Path) -> None:
    result = Result({"odd": variable("time", np.array([1.0 + 2.0j]))}, {}, {})
    with pytest.raises(TypeError, match=r"'odd' .* complex128: .* numbers or texts"):
        save(result, tmp_path / "result.nc")
    assert not list(tmp_path.iterdir())


def test_a_result_and_its_dataset_are_two_views_of_the_same_arrays() -> None:
    result = with_messages()
    assert np.shares_memory(result["pose"].values, result.dataset["pose"].values)
    assert result.dataset is result.dataset
    again = Result.of(result.dataset)
    assert again.dataset.identical(result.dataset)
    assert Result.of(result) is result
    assert again.sizes == dict(result.dataset.sizes)


def test_samples_of_a_window_are_those_that_xarray_selects() -> None:
    result = with_messages()
    for start, stop in ((0.02, 0.06), (-1.0, 0.03), (0.05, 9.0), (0.03, 0.035), (9.0, 10.0)):
        window = result.between(start, stop)
        assert window.dataset.identical(result.dataset.sel(time=slice(start, stop)))


@pytest.mark.skipif(sys.platform == "win32", reason="devices and pipes of POSIX")
def test_what_is_no_file_is_written_to_and_not_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("deep/target")
    (tmp_path / "deep").mkdir()
    reading = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    writing = (tmp_path / "open").open("wb", buffering=0)
    try:
        names = ("pipe", "link", f"/dev/fd/{writing.fileno()}", "/dev/null")
        for name in names:
            write(tmp_path / name, b"text")
        assert os.read(reading, 9) == b"text"
    finally:
        os.close(reading)
        writing.close()
    assert (tmp_path / "open").read_bytes() == (tmp_path / "deep" / "target").read_bytes() == b"text"
    assert (tmp_path / "link").is_symlink()
    assert Path("/dev/null").is_char_device()
    assert sorted(os.listdir(tmp_path)) == ["deep", "link", "open", "pipe"]
    with pytest.raises(OutputError, match="/dev/full cannot be written: No space left on device"):
        write(Path("/dev/full"), b"text")
