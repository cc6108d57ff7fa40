"""Vehicles as one meets them, on the road of their user: inspected, swapped in, checked, run, compared.

The table below has the text that a user must write; the messages ask for it.
"""

import re
import shutil
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cosim
from cosim.scenario.scenario import OPEN

from .commands import command
from .stub.stub import make_fmu
from .two_followers import two_followers

SCENARIO = two_followers(
    horizon="2.1 s",
    team='<actuator><saturation limit="20 N.m"/></actuator>',
    torque="2 N.m",
    poses=(
        'x="1 m" y="0 m" psi="10 deg" gamma="0 deg"',
        'x="-2 m" y="-2 m" psi="20 deg" gamma="3 deg"',
        'x="-2 m" y="2 m" psi="0 deg" gamma="-3 deg"',
    ),
    end='<expect><rms signal="range_error" below="1 m" from="1.4 s"/><regular/></expect>',
)

GERMAN = {
    "x": "Lage.x",
    "y": "Lage.y",
    "psi": "Gierwinkel",
    "gamma": "Lenkwinkel",
    "v": "Geschwindigkeit",
    "omega": "Lenkrate",
    "tau_drive": "Antriebsmoment",
    "tau_steer": "Lenkmoment",
    "a": "Radstand",
}
STRUCTURED = {
    "x": "vehicle.chassis.x",
    "y": "vehicle.chassis.y",
    "psi": "vehicle.chassis.yaw",
    "gamma": "vehicle.steering.angle",
    "v": "vehicle.chassis.speed",
    "omega": "vehicle.steering.rate",
    "tau_drive": "vehicle.driveline.torque",
    "tau_steer": "vehicle.steering.torque",
    "a": "vehicle.wheelbase",
}
COMPASS = {"psi": "heading", "gamma": "steering.angle", "omega": "steering.rate", "tau_steer": "steering.torque"}
EULER = {"solver": "euler"}


@dataclass(frozen=True)
class Vehicle:
    """A vehicle, and the text that its user writes.

    Attributes
    ----------
    options : dict
        How the stub is made.
    roles : dict
        By role, the attributes in the binding.
    asks : tuple of str
        Parts of the questions and warnings of ``formation swap``.
    plant : dict
        Further attributes of the plant in the comparison.
    step : float
        Of the comparison [s].
    """

    options: Mapping[str, Any]
    roles: Mapping[str, str] = field(default_factory=dict)
    asks: tuple[str, ...] = ()
    plant: Mapping[str, str] = field(default_factory=dict)
    step: float = 0.02


LENGTH = 'unit="m" factor="201.168"'
VEHICLES = {
    **{
        f"Model Exchange {fmi}": Vehicle({"fmi": fmi, "interface": "model_exchange"}, plant=EULER)
        for fmi in ("1.0", "2.0", "3.0")
    },
    "arrays in degrees": Vehicle(
        {"fmi": "3.0", "arrays": True, "units": "deg", "drive": False},
        {
            "x": 'variable="pose[1]" unit="m"',
            "y": 'variable="pose[2]" unit="m"',
            "psi": 'variable="pose[3]" unit="deg"',
            "gamma": 'variable="pose[4]" unit="deg"',
            "tau_drive": 'variable="torque[1]"',
            "tau_steer": 'variable="torque[2]"',
            "drive": 'value="rear_wheel"',
        },
        ("psi: 'pose[3]' could be it by its place", "as_printed, front_wheel or rear_wheel"),
    ),
    "5 ms inside": Vehicle({"fixed_step": 0.005}, step=0.005),
    "5 ms inside, announced": Vehicle({"fmi": "3.0", "fixed_step": 0.005}, step=0.005),
    "once per process": Vehicle({"once": True}),
    "German names": Vehicle({"names": GERMAN}),
    "German names, Model Exchange": Vehicle(
        {"names": GERMAN, "fmi": "3.0", "interface": "model_exchange"}, plant=EULER
    ),
    "km/h, gon, furlong": Vehicle({"units": "odd"}),
    "km/h, gon, furlong by name alone": Vehicle(
        {"units": "odd", "fmi": "1.0"},
        {name: f'variable="{name}" {LENGTH}' for name in ("x", "y", "a")},
        ("the unit 'furlong' of 'x' is not known",),
    ),
    "clockwise from north": Vehicle(
        {"units": "deg", "compass": True, "names": COMPASS},
        {
            "psi": 'variable="heading" factor="-1" offset="90 deg"',
            "gamma": 'variable="steering.angle" factor="-1"',
            "omega": 'variable="steering.rate" factor="-1"',
            "tau_steer": 'variable="steering.torque" factor="-1"',
        },
        ("'heading' as 'Heading, clockwise from north'", "'steering.angle' as 'Steering angle, positive to the right'"),
    ),
    "clockwise from north, with our names": Vehicle(
        {"compass": True, "interface": "model_exchange"},
        {
            "psi": 'variable="psi" factor="-1" offset="90 deg"',
            "gamma": 'variable="gamma" factor="-1"',
            "omega": 'variable="omega" factor="-1"',
            "tau_steer": 'variable="tau_steer" factor="-1"',
        },
        (
            "to look at",
            "'psi' as 'Heading, clockwise from north'",
            "'gamma' as 'Steering angle, positive to the right'",
        ),
        plant=EULER,
    ),
    "2,000 structured names": Vehicle({"names": STRUCTURED, "fillers": 2000, "structured": True}),
    "resources": Vehicle({"mass": 10.0}),
    "resources, FMI 1.0": Vehicle({"mass": 10.0, "fmi": "1.0"}),
    "resources, FMI 3.0": Vehicle({"mass": 10.0, "fmi": "3.0"}),
}


class Road:
    """A user at the command line, in a folder with the scenario."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.folder = folder
        self.capsys = capsys

    def __call__(self, *arguments: object, status: int = 0) -> str:
        """Give a command and return its output, in one line."""
        return " ".join("".join(command(self.capsys, *arguments, status=status)).split())

    def swap(self, fmu: Path, status: int = 0) -> tuple[Path, Path, str]:
        """Swap a vehicle in; return the variant, the binding and what is said."""
        variant = self.folder / "mine.xml"
        said = self("swap", self.folder / "two.xml", "--plant", f"car={fmu}", "--out", variant, status=status)
        return variant, self.folder / f"{fmu.stem}.binding.xml", said

    def drives(self, scenario: Path, *options: str) -> None:
        """Check and run a scenario, of which both expectations hold."""
        self("check", scenario, *options)
        said = self("run", scenario, "--no-figure", "--out", self.folder / "runs", *options)
        assert said.count("holds ") == 2, said


@pytest.fixture
def road(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Road:
    (tmp_path / "two.xml").write_text(SCENARIO, encoding="utf-8")
    return Road(tmp_path, capsys)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the vehicle without anything unusual."""
    return make_fmu(tmp_path_factory.mktemp("plain"))


def filled(binding: Path, roles: Mapping[str, str]) -> None:
    """Write the variables of roles into a binding."""
    text = binding.read_text(encoding="utf-8")
    for name, attributes in roles.items():
        text, number = re.subn(rf'<role name="{name}" [^>]*/>', f'<role name="{name}" {attributes}/>', text)
        assert number == 1, name
    assert f'"{OPEN}"' not in re.sub("<!--.*?-->", "", text, flags=re.DOTALL), text
    binding.write_text(text, encoding="utf-8")


def moves_as(plain: Path, fmu: Path, binding: Path, step: float = 0.02, **plant: str) -> cosim.PlantComparison:
    """Return the comparison of a vehicle with the plain one, of which nothing must be apart."""
    theirs = cosim.PlantFile(fmu, binding if binding.exists() else None, **plant)
    within = [f"1e-9 {unit}" for unit in ("m", "rad", "m/s", "rad/s")]
    compared = cosim.compare_plants(plain, theirs, duration=50 * step, step=step, within=within, isolated=False)
    assert compared.within, compared.roles
    return compared


@pytest.mark.parametrize("name", VEHICLES)
def test_it_swaps_in(name: str, road: Road, plain: Path) -> None:
    vehicle = VEHICLES[name]
    fmu = make_fmu(road.folder / "fmus", name="vehicle", **vehicle.options)
    assert "As a car_like vehicle: it can be driven" in road("inspect", fmu)
    variant, binding, said = road.swap(fmu)
    for sentence in vehicle.asks:
        assert sentence in said
    if "once the binding is complete" in said:
        assert "which is to be filled in" in road("check", variant, status=2)
    if vehicle.roles:
        filled(binding, vehicle.roles)
    road.drives(variant)
    moves_as(plain, fmu, binding, vehicle.step, **vehicle.plant)


# Refused, with what to do --------------------------------------------------------------------------------------


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_7_ms_inside(fmi: str, road: Road, plain: Path) -> None:
    """FMI 3 states it, and the FMU is refused; in FMI 2 the default experiment hints at it: a warning."""
    fmu = make_fmu(road.folder, name="vehicle", fmi=fmi, fixed_step=0.007)
    announced = fmi == "3.0"
    remedy = "--set 'simulation/@step=0.007 s' of formation run, --step '0.007 s' of compare-plants"
    variant, binding, said = road.swap(fmu, status=2 if announced else 0)
    assert remedy in said
    assert remedy in road("check", variant, status=2 if announced else 0)
    said = road("run", variant, "--no-figure", "--out", road.folder / "runs", status=2 if announced else 3)
    assert said.count(remedy) == 1
    step = ("--set", "simulation/@step=0.007 s")
    road.drives(variant, *step)

    out = road.folder / "compared"
    said = road("compare-plants", plain, fmu, "--out", out, "--no-figure", status=2 if announced else 3)
    assert remedy in said
    assert "largest" not in said
    said = road("compare-plants", plain, fmu, "--duration", "1 s", "--step", "0.007 s", status=2)
    assert (
        "1 s are not a whole number of steps of 0.007 s, from 1 to 1000000 of them, such as 0.994 s or 1.001 s" in said
    )
    moves_as(plain, fmu, binding, step=0.007)


def test_a_horizon_that_does_not_fit_the_step(road: Road) -> None:
    said = road("check", road.folder / "two.xml", "--set", "simulation/@step=9 ms", status=2)
    assert (
        "the horizon 2.1 s is not a whole number of communication steps of 0.009 s, such as 2.097 s or 2.106 s" in said
    )


@pytest.mark.parametrize("fmi", ["1.0", "2.0", "3.0"])
def test_once_per_process_unsaid(fmi: str, road: Road) -> None:
    fmu = make_fmu(road.folder, name="vehicle", fmi=fmi, once=True, says_once=False)
    variant, _, _ = road.swap(fmu)
    said = road("run", variant, "--no-figure", status=2)
    assert 'isolate="process" in its <plant> gives each robot a process of its own' in said
    in_plant(variant, 'isolate="process"')
    road.drives(variant)


@pytest.mark.parametrize(
    ("late", "fmi", "status"), [("zero", "2.0", 2), ("nan", "3.0", 3), ("error", "1.0", 2), ("error", "3.0", 2)]
)
def test_outputs_after_the_first_step(late: str, fmi: str, status: int, road: Road, plain: Path) -> None:
    fmu = make_fmu(road.folder, name="vehicle", fmi=fmi, late=late)
    variant, binding, _ = road.swap(fmu)
    said = road("run", variant, "--no-figure", status=status)
    assert 'if its outputs show the pose only after the first step: start="first_step" in its <plant>' in said
    in_plant(variant, 'start="first_step"')
    road.drives(variant)
    moves_as(plain, fmu, binding, start="first_step")


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_one_step_late(fmi: str, road: Road, plain: Path) -> None:
    """It drives as with a delay of its sensor; the comparison reports the delay."""
    fmu = make_fmu(road.folder, name="vehicle", fmi=fmi, late="step")
    variant, _, _ = road.swap(fmu)
    road.drives(variant)
    compared = cosim.compare_plants(plain, fmu, duration=1.0, isolated=False)
    first, second = compared.states
    np.testing.assert_allclose(second[1:], first[:-1], rtol=0, atol=1e-12)
    assert compared.late == "B"
    assert cosim.compare_plants(fmu, plain, duration=1.0, isolated=False).late == "A"
    assert cosim.compare_plants(plain, plain, duration=1.0, isolated=False).late == ""
    if fmi == "3.0":  # once is enough
        return
    said = road("compare-plants", plain, fmu, "--duration", "0.2 s", "--no-figure", "--out", road.folder / "compared")
    assert "B is one step late: its outputs are those of A one communication step before" in said


def in_plant(scenario: Path, attributes: str) -> None:
    """Write attributes into the plant of a scenario."""
    text = scenario.read_text(encoding="utf-8")
    assert text.count('<plant id="car"') == 1
    scenario.write_text(text.replace('<plant id="car"', f'<plant id="car" {attributes}'), encoding="utf-8")


# Archives --------------------------------------------------------------------------------------------------------


def backslashes(fmu: Path) -> Path:
    return packed(fmu, lambda name: name.replace("/", "\\"))


def folders(fmu: Path) -> Path:
    return packed(fmu, lambda name: name, *("binaries/", "resources/", "documentation/"))


def unpacked(fmu: Path) -> Path:
    folder = fmu.with_suffix("")
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
    return folder


def named_oddly(fmu: Path) -> Path:
    return Path(shutil.copy(fmu, fmu.with_name("Mein  Fahrzeug #1 (ü).zip")))


def packed(fmu: Path, name: Callable[[str], str], *empty: str) -> Path:
    """Pack an FMU again, with other names in the archive and empty entries before."""
    target = fmu.with_name("packed.fmu")
    with zipfile.ZipFile(fmu) as archive, zipfile.ZipFile(target, "w") as other:
        for folder in empty:
            other.writestr(folder, b"")
        for entry in archive.namelist():
            other.writestr(zipfile.ZipInfo(name(entry)), archive.read(entry))
    return target


@pytest.mark.parametrize("pack", [backslashes, folders, unpacked, named_oddly])
def test_odd_archives(pack: Callable[[Path], Path], road: Road, plain: Path) -> None:
    fmu = pack(make_fmu(road.folder / "fmus", name="vehicle", mass=10.0))
    assert "As a car_like vehicle: it can be driven as it is" in road("inspect", fmu)
    variant, binding, _ = road.swap(fmu)
    road.drives(variant)
    moves_as(plain, fmu, binding)


def test_an_archive_of_the_folder_instead_of_its_content(road: Road) -> None:
    whole = make_fmu(road.folder / "fmus", name="vehicle")
    fmu = packed(whole, lambda name: f"vehicle/{name}")
    sentence = "it holds no modelDescription.xml, but vehicle/modelDescription.xml: an FMU has it at the top"
    assert sentence in road("inspect", fmu, status=2)
    assert sentence in road("swap", road.folder / "two.xml", "--plant", f"car={fmu}", status=2)
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(road.folder)
    variant, _, _ = road.swap(road.folder / "vehicle")
    road.drives(variant)


def test_resources_that_are_missing(road: Road) -> None:
    whole = make_fmu(road.folder / "fmus", name="vehicle", mass=10.0)
    fmu = road.folder / "vehicle.fmu"
    with zipfile.ZipFile(whole) as archive, zipfile.ZipFile(fmu, "w") as other:
        for entry in archive.namelist():
            if not entry.startswith("resources/"):
                other.writestr(entry, archive.read(entry))
    variant, _, _ = road.swap(fmu)
    said = road("run", variant, "--no-figure", status=2)
    assert "the FMU vehicle.fmu cannot be started as leader: it cannot read its mass from" in said
