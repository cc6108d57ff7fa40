"""Kinds of vehicle of other packages: they are found, and a message names a faulty one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from cosim.errors import InputError
from cosim.vehicle import kinds
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
