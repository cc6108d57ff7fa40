"""A result describes its robots: a stranger draws the robots to scale from the file alone."""

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import cosim
from cosim.cli import main
from cosim.master.who_is_who import is_taken
from cosim.results.files import load, save

WHEELBASE, HITCH, HALF_TRACK = 1.5, 0.9, 0.4
CHANGES = [
    "follower[@id='car_2']/parameter[@name='a']/@value=1.5 m",
    "follower[@id='truck_1']/parameter[@name='d']/@value=90 cm",
    "follower[@id='truck_1']/parameter[@name='b']/@value=0.4 m",
]


@pytest.fixture(scope="module")
def file(scenarios: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the result of a team of two kinds in which two robots have lengths of their own."""
    path = tmp_path_factory.mktemp("who") / "result.nc"
    save(cosim.run(scenarios / "mixed_team.xml", CHANGES, horizon=1.0, expectations=False), path)
    return path


# What a stranger writes: nothing of ours, with xarray and then with h5py ---------------------------------------


def lines(kind: str, pose: dict[str, float], length: Callable[[str], float]) -> list[np.ndarray]:
    """Return the lines (2, 2) of a robot's drawing: car: its body; tractor with trailer: the trailer and both wheels.

    The last point of the first line is the robot's front, from which its range is measured.
    """
    place = np.array([pose["x"], pose["y"]])
    if kind == "car_like":
        return [np.array([place, place + length("wheelbase") * along(pose["psi"])])]
    assert kind == "tractor_trailer"
    hitch = place + length("hitch_length") * along(pose["theta_1"])
    side = length("half_track") * along(pose["theta_0"] + math.pi / 2)
    return [np.array([place, hitch]), np.array([hitch - side, hitch + side])]


def along(angle: float) -> np.ndarray:
    return np.array([math.cos(angle), math.sin(angle)])


def by_xarray(file: Path, at: int) -> dict[str, list[np.ndarray]]:
    """Return the drawing of each robot at a sample."""
    drawing = {}
    with xr.open_dataset(file, engine="h5netcdf") as result:
        assert set(result.pose_component_units.values[:2]) == {"m"}
        assert set(result.pose_component_units.values[2:]) == {"rad"}
        for robot in result.vehicle.values:
            about = result.sel(vehicle=robot)
            course = result.leader_pose if robot == "leader" else result.pose.sel(robot=robot)
            pose = dict(zip(about.pose_name.values, course.isel(time=at).values, strict=True))

            def length(name: str, about: xr.Dataset = about) -> float:
                assert about[f"vehicle_{name}"].attrs["units"] == "m"
                return float(about[f"vehicle_{name}"])

            drawing[str(robot)] = lines(str(about.vehicle_kind.values), pose, length)
    return drawing


def by_h5py(file: Path, at: int) -> dict[str, list[np.ndarray]]:
    """Return the same with a library that knows arrays and attributes only."""
    drawing = {}
    with h5py.File(file) as result:

        def texts(name: str) -> Any:
            return result[name].asstr()[:]

        followers = list(texts("robot"))
        for row, robot in enumerate(texts("vehicle")):
            course = result["leader_pose"][at] if row == 0 else result["pose"][at, followers.index(robot)]
            pose = dict(zip(texts("pose_name")[row], course, strict=True))

            def length(name: str, row: int = row) -> float:
                assert result[f"vehicle_{name}"].attrs["units"] == "m"
                return float(result[f"vehicle_{name}"][row])

            drawing[robot] = lines(texts("vehicle_kind")[row], pose, length)
    return drawing


@pytest.mark.parametrize("read", [by_xarray, by_h5py])
@pytest.mark.parametrize("at", [0, -1])
def test_a_stranger_draws_the_robots_to_scale(file: Path, read: Callable[[Path, int], Any], at: int) -> None:
    """The range, which the controllers' package computes, is from a robot's front to the leader: so is the drawing."""
    drawing = read(file, at)
    assert list(drawing) == ["leader", "car_1", "truck_1", "car_2", "truck_2"]
    leader = drawing["leader"][0][0]
    ranges = load(file)["range"].isel(time=at)
    for robot, (body, *_) in drawing.items():
        if robot != "leader":
            assert np.hypot(*(body[1] - leader)) == pytest.approx(float(ranges.sel(robot=robot)), abs=1e-12)
    sizes = {robot: [float(np.hypot(*(line[1] - line[0]))) for line in bodies] for robot, bodies in drawing.items()}
    assert sizes["car_2"] == pytest.approx([WHEELBASE])
    assert sizes["truck_1"] == pytest.approx([HITCH, 2 * HALF_TRACK])
    assert sizes["leader"] == pytest.approx([1.2])
    assert sizes["car_1"] == pytest.approx([1.2])


def test_the_drawing_is_one(file: Path, tmp_path: Path) -> None:
    axes = (figure := Figure()).add_subplot(aspect="equal")
    for robot, bodies in by_xarray(file, -1).items():
        for line in bodies:
            axes.plot(*line.T, label=robot)
    figure.savefig(tmp_path / "drawn.png")
    assert (tmp_path / "drawn.png").read_bytes().startswith(b"\x89PNG")


def outlines(file: Path, robot: str) -> dict[str, np.ndarray]:
    """Return the corners of the parts of a follower at the end, as the code on the page draws them."""
    page = (Path(__file__).parents[1] / "docs" / "results.md").read_text(encoding="utf-8")
    code = "".join(re.findall(r"^```python\n(.*?)^```$", page.partition("### Who is who")[2], re.M | re.S)[:2])
    drawn: list[np.ndarray] = []
    plot = SimpleNamespace(fill=lambda x, y: drawn.append(x + 1j * y))
    known: dict[str, Any] = {"result": xr.load_dataset(file, engine="h5netcdf"), "np": np, "plt": plot}
    exec(code.replace("truck_1", robot).replace("hitch_x", "# hitch_x"), known)
    return dict(zip([name for name in known["truck"].outline_name.values if name], drawn, strict=True))


@pytest.mark.parametrize("robot", ["car_1", "car_2", "truck_1", "truck_2"])
def test_a_stranger_draws_the_outlines_as_the_page_says(file: Path, robot: str) -> None:
    parts = outlines(file, robot)
    front_of, *axle = by_xarray(file, -1)[robot]
    reference, front = (complex(*point) for point in front_of)
    if robot.startswith("car"):
        body = parts["body"]
        assert body[:4].mean() == pytest.approx((reference + front) / 2, abs=1e-12), "the wheelbase is in its middle"
        assert np.ptp((body / (front - reference)).real) == pytest.approx(1.4)
        wheels = [parts[f"front {side} wheel"][:4].mean() for side in ("left", "right")]
        assert sum(wheels) / 2 == pytest.approx(front, abs=1e-12)
    else:
        assert list(parts)[:2] == ["trailer", "tractor"]
        assert np.abs(parts["trailer"] - front).min() == pytest.approx(0, abs=1e-12), "it ends at the hitch"
        wheels = [parts[f"tractor's {side} wheel"][:4].mean() for side in ("right", "left")]
        assert wheels == pytest.approx([complex(*point) for point in axle[0]], abs=1e-12)


# The facts ----------------------------------------------------------------------------------------------------


def test_kinds_and_their_components(file: Path) -> None:
    result = xr.load_dataset(file, engine="h5netcdf")
    assert result.vehicle_kind.values.tolist() == ["car_like", *["car_like", "tractor_trailer"] * 2]
    assert result.pose_component.values.tolist() == ["x", "y", "psi/theta_1", "gamma/theta_0"]
    assert result.pose_name.sel(vehicle="truck_1").values.tolist() == ["x", "y", "theta_1", "theta_0"]
    assert result.torque_name.sel(vehicle="car_1").values.tolist() == ["tau_drive", "tau_steer"]
    assert result.pose_meaning.sel(vehicle="car_1").values[3] == "the steering angle, counter-clockwise from the body"
    for vector, units in {
        "pose": ["m", "m", "rad", "rad"],
        "velocity": ["m/s", "rad/s"],
        "torque": ["N.m"] * 2,
    }.items():
        assert result[f"{vector}_component_units"].values.tolist() == units
        assert result[vector].attrs["units"] == ", ".join(units), "the attribute is what it was"
    assert result.vehicle_drive.values.tolist() == ["rear_wheel", *["rear_wheel", ""] * 2]
    assert np.isnan(result.vehicle_wheelbase.sel(vehicle="truck_1"))


def test_plants(file: Path, scenarios: Path) -> None:
    result = xr.load_dataset(file, engine="h5netcdf")
    assert dict(zip(result.vehicle.values, result.vehicle_plant.values, strict=True)) == {
        "leader": "car",
        "car_1": "car",
        "truck_1": "truck",
        "car_2": "car",
        "truck_2": "truck",
    }
    told = json.loads(result.attrs["plants"])
    for plant, model in (("car", "car_like"), ("truck", "tractor_trailer")):
        about = result.sel(plant=plant)
        assert str(about.plant_model.values) == model
        for name, key in (
            ("plant_file", "file"),
            ("plant_sha256", "sha256"),
            ("plant_fmi_version", "fmi_version"),
            ("plant_interface", "interface"),
            ("plant_tool", "generation_tool"),
        ):
            assert str(about[name].values) == told[plant][key]


def test_every_coordinate_explains_itself(file: Path) -> None:
    result = xr.load_dataset(file, engine="h5netcdf")
    for name, variable in result.variables.items():
        if not str(name).endswith("_component"):
            assert variable.attrs.get("long_name"), name
        if variable.dtype.kind == "f":
            assert variable.attrs.get("units"), name


def test_no_signal_of_a_controller_can_take_these_names(file: Path) -> None:
    result = load(file)
    for name in result.coords:
        if set(result[name].dims) & {"vehicle", "plant", "message", "outline_axis"}:
            assert is_taken(str(name))
    assert not any(map(is_taken, map(str, result.data_vars)))


def test_a_result_of_an_earlier_version_still_loads(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = load(file)
    own = {name for name in result.coords if set(result[name].dims) & {"vehicle", "plant", "message", "outline_axis"}}
    older = result.drop_vars([*own, *(name for name in result.coords if str(name).endswith("_units"))])
    assert set(older.dims) == {"time", "robot"} | {dim for dim in result.dims if str(dim).endswith("_component")}
    assert set(older.data_vars) == set(result.data_vars)
    save(older, path := file.with_name("older.nc"))
    assert main(["show", str(file)]) == main(["show", str(path)])
    shown = capsys.readouterr().out.splitlines()
    (at,) = (at for at, line in enumerate(shown) if ", bodies " in line)
    shown[at] = shown[at].partition(", bodies ")[0]  # an older file does not tell them
    assert shown[: len(shown) // 2] == shown[len(shown) // 2 :]
    assert cosim.summary_of(load(path)).followers == cosim.summary_of(result).followers
