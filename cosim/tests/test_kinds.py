"""Kinds of vehicle of other packages: they are found, and a message names a faulty one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import formation_controllers as fc
import numpy as np
import pytest
from formation_controllers.vehicles import Entry

from cosim.errors import InputError
from cosim.master.simulation import Simulation
from cosim.scenario.reader import read_scenario
from cosim.tests.driving import scenario
from cosim.vehicle import kinds
from cosim.vehicle.car_like import CAR_LIKE
from cosim.vehicle.differential_drive import DIFFERENTIAL_DRIVE
from cosim.vehicle.kind import Kind

ROVER = replace(DIFFERENTIAL_DRIVE, name="rover")

Bring = Callable[..., None]


@pytest.fixture
def bring(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bring]:
    """Return a function that installs entry points: a name, and the object or error of its loading."""

    def brought(*points: tuple[str, object], package: str = "rovers") -> None:
        dist = SimpleNamespace(metadata={"Name": package, "Version": "2.0"})
        monkeypatch.setattr(kinds, "entry_points", lambda group: [_point(*point, dist) for point in points])
        kinds._others.cache_clear()

    yield brought
    monkeypatch.undo()
    kinds._others.cache_clear()


def _point(name: str, loaded: object, dist: object) -> Any:
    def load() -> object:
        if isinstance(loaded, Exception):
            raise loaded
        return loaded

    return SimpleNamespace(name=name, dist=dist, load=load, module="rovers")


def test_a_kind_of_another_package_is_one_like_ours(bring: Bring) -> None:
    bring(("rover", ROVER))
    assert kinds.kind_named("rover") is ROVER
    assert [kind.name for kind in kinds.kinds()] == ["car_like", "tractor_trailer", "differential_drive", "rover"]
    assert [(found.name, found.package) for found in kinds.installed()][-1] == ("rover", "rovers")


@pytest.mark.parametrize(
    ("loaded", "fault"),
    [
        (ImportError("no module named wheels"), "cannot be imported: ImportError: no module named wheels"),
        ("rover", "is 'rover': expected a cosim.vehicle.kind.Kind"),
        (DIFFERENTIAL_DRIVE, "names itself 'differential_drive': expected the name of its entry point"),
        (replace(ROVER, command=()), "has no command: expected a tuple of Role"),
        (replace(ROVER, pose=ROVER.pose[:2]), "has another pose than expected: x [m], y [m] and a heading [rad]"),
        (replace(ROVER, command=ROVER.pose), "has 'x' in its command as output: expected input"),
        (replace(ROVER, probe=(1.0,)), "has a probe of 1 entries: expected 3, as many as the pose has"),
        (
            replace(ROVER, command=(replace(ROVER.command[0], unit="N"), ROVER.command[1])),
            "gives 'tau_right' in N, but 'tractor_trailer' gives it in N.m",
        ),
    ],
)
def test_a_faulty_kind_is_left_out_and_told(bring: Bring, loaded: Kind | str | Exception, fault: str) -> None:
    bring(("rover", loaded))
    assert "rover" not in [kind.name for kind in kinds.kinds()]
    with pytest.raises(InputError) as caught:
        kinds.kind_named("rover")
    assert f"the kind of vehicle 'rover' of rovers 2.0 {fault}" in str(caught.value)


@pytest.mark.parametrize("points", [[("car_like", ROVER)], [("rover", ROVER), ("rover", ROVER)]])
def test_two_kinds_of_one_name_are_refused(bring: Bring, points: list[tuple[str, Kind]]) -> None:
    bring(*points)
    with pytest.raises(InputError, match=r"bring a kind of vehicle named '\w+': uninstall one of them"):
        kinds.kind_named("boat")


LENGTH = {"length": CAR_LIKE.geometry["wheelbase"], "drive": CAR_LIKE.geometry["drive"]}
"""A car's geometry by another name than its vehicle has."""


class MirroredCar(fc.CarLike):
    """A car that gives its commands in another order than the kind `CAR_LIKE` does."""

    command: ClassVar[tuple[Entry, ...]] = fc.CarLike.command[::-1]


def run(folder: Path, car: Path, vehicle: str) -> Any:
    plant = f'<plant id="car" fmu="{car.as_posix()}"><binding vehicle="{vehicle}"/></plant>'
    with Simulation(read_scenario(scenario(folder / f"{vehicle}.xml", plant, horizon="0.1 s"))) as simulation:
        return simulation.run()


def test_a_kind_of_ones_own_may_reuse_a_built_in_vehicle(
    bring: Bring, make: Callable[..., Path], tmp_path: Path
) -> None:
    bring(("my_car", replace(CAR_LIKE, name="my_car", outline=None)))
    mine, built_in = (run(tmp_path, make(), vehicle) for vehicle in ("my_car", "car_like"))
    assert mine.vehicle_kind.values.tolist() == ["my_car"] * 2
    for name in ("pose", "torque", "range", "bearing"):
        assert np.array_equal(mine[name], built_in[name]), name


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        (
            {"vehicle": MirroredCar},
            "the kind of vehicle 'my_car' has the command tau_drive [N.m], tau_steer [N.m], its vehicle "
            "tau_steer [N.m], tau_drive [N.m]: expected the same",
        ),
        (
            {"pose": (*CAR_LIKE.pose[:2], CAR_LIKE.pose[3], CAR_LIKE.pose[2])},
            "has the pose x [m], y [m], gamma [rad], psi [rad], its vehicle x [m], y [m], psi [rad], gamma [rad]",
        ),
        ({"velocity": CAR_LIKE.velocity[:1]}, "has the velocity v [m/s], its vehicle v [m/s], omega [rad/s]"),
        (
            {"vehicle": lambda drive, length: fc.CarLike(length, drive), "geometry": LENGTH},
            "makes a vehicle whose length is None: expected an attribute for each entry of its geometry",
        ),
        ({"vehicle": fc.DifferentialDrive}, "'my_car' cannot make its vehicle: TypeError: "),
        ({"vehicle": lambda **_: "a car"}, "makes the vehicle 'a car': expected one whose pose is a tuple of Entry"),
    ],
)
def test_a_kind_and_its_vehicle_cannot_contradict_each_other(
    bring: Bring, make: Callable[..., Path], tmp_path: Path, changed: dict[str, Any], sentence: str
) -> None:
    bring(("my_car", replace(CAR_LIKE, name="my_car", **changed)))
    with pytest.raises(InputError) as caught:
        run(tmp_path, make(), "my_car")
    assert sentence in str(caught.value)
