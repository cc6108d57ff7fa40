"""Plants that exchange Float32 or whole numbers move like plants that exchange doubles, up to rounding."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cosim
from cosim.errors import InputError, SimulationError
from cosim.fmu.model_description import ModelDescription
from cosim.fmu.package import open_package
from cosim.fmu.vehicle import open_fmu
from cosim.plant.exchange import _as_type
from cosim.plant.failures import PlantError
from cosim.scenario.reader import read_binding
from cosim.swap.proposal import proposals
from cosim.tests.driving import STEP, drive, fleet, scenario
from tests.stub.stub import make_fmu

POSE = (1.0, -2.0, 0.3, 0.1)
WHOLE = """<binding xmlns="urn:formation-cosim:scenario:1" vehicle="car_like">
  <role name="x" variable="x" unit="mm"/><role name="y" variable="y" unit="mm"/>
  <role name="psi" variable="psi" unit="mrad"/><role name="gamma" variable="gamma" unit="mrad"/>
  <role name="v" variable="v" unit="mm/s"/><role name="omega" variable="omega" unit="mrad/s"/>
  <role name="tau_drive" variable="tau_drive" unit="mN.m"/><role name="tau_steer" variable="tau_steer" unit="mN.m"/>
  <role name="a" variable="a" unit="mm"/>
</binding>"""
FMI = ("1.0", "2.0", "3.0")

Make = Callable[..., Path]


@pytest.fixture
def make(tmp_path: Path) -> Make:
    return lambda **options: make_fmu(tmp_path / str(abs(hash(str(options)))), **options)


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    path = tmp_path / "whole.binding.xml"
    path.write_text(WHOLE, encoding="utf-8")
    return path


def torques(n: int = 100) -> np.ndarray:
    """Return torques that whole mN.m can be."""
    t = STEP * np.arange(n)
    return np.round(np.column_stack([4 + 2 * np.sin(3 * t), 0.2 * np.cos(5 * t)]), 3)


@pytest.mark.parametrize(
    "options",
    [{}, {"interface": "model_exchange"}, {"interface": "model_exchange", "solvers": ("cvode",)}],
    ids=["co_simulation", "model_exchange", "cvode"],
)
def test_float32_moves_as_float64(make: Make, options: dict[str, Any]) -> None:
    interface = options.get("interface", "co_simulation")
    plain, single = (make(fmi="3.0", interface=interface, types=types) for types in ("", "single"))
    wanted = drive(plain, torques(), pose=POSE, **options)
    found = drive(single, torques(), pose=POSE, **options)
    assert not np.array_equal(found, wanted)
    assert found == pytest.approx(wanted, rel=1e-5, abs=1e-6)
    isolated = drive(single, torques(), pose=POSE, isolated=True, **options)
    assert np.array_equal(isolated, found)


ARRAYS = """<binding xmlns="urn:formation-cosim:scenario:1" vehicle="car_like">
  <role name="x" variable="pose[1]" unit="m"/><role name="y" variable="pose[2]" unit="m"/>
  <role name="psi" variable="pose[3]" unit="rad"/><role name="gamma" variable="pose[4]" unit="rad"/>
  <role name="tau_drive" variable="torque[1]"/><role name="tau_steer" variable="torque[2]"/>
</binding>"""


def test_arrays_of_float32(make: Make, tmp_path: Path) -> None:
    path = tmp_path / "arrays.binding.xml"
    path.write_text(ARRAYS, encoding="utf-8")
    found = drive(make(fmi="3.0", types="single", arrays=True), torques(), pose=POSE, binding=read_binding(path))
    assert np.array_equal(found, drive(make(fmi="3.0", types="single"), torques(), pose=POSE))


@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.parametrize("fmi", FMI)
def test_whole_numbers_move_within_their_resolution(make: Make, whole: Path, fmi: str, isolated: bool) -> None:
    wanted = drive(make(fmi=fmi), torques(), pose=POSE)
    found = drive(make(fmi=fmi, types="whole"), torques(), pose=POSE, binding=read_binding(whole), isolated=isolated)
    assert np.abs(found - wanted).max() <= 0.5e-3 + 1e-9
    assert np.array_equal(np.round(found / 1e-3) * 1e-3, found)


def test_doubles_and_others_in_one_fleet(make: Make) -> None:
    plain, single = make(fmi="3.0"), make(fmi="3.0", types="single")
    given = torques(20)
    alone = [drive(fmu, given, pose=POSE) for fmu in (plain, single)]
    with fleet(plain, single, plain, pose=POSE) as (started, _):
        out = np.empty((len(given), 3, 6))
        started.run(0, STEP, np.hstack([given] * 3), out)
    for row, which in enumerate((0, 1, 0)):
        assert np.array_equal(out[:, row], alone[which][1:])


def test_a_pose_between_whole_numbers_is_taken_as_well_as_can_be(make: Make, whole: Path) -> None:
    with fleet(make(types="whole"), pose=(1.0004, 0.0, 0.0, 0.0), binding=read_binding(whole)) as (_, state):
        assert state[0, 0] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("types", ["single", "whole"])
def test_a_torque_that_the_type_does_not_have(make: Make, whole: Path, types: str) -> None:
    binding = read_binding(whole) if types == "whole" else None
    fmu = make(fmi="3.0", types=types)
    with fleet(fmu, binding=binding) as (started, _), pytest.raises(SimulationError) as caught:
        started.step(0, STEP, np.array([1e39, 0.0]))
    kind, number = {"single": ("Float32", "1e+39"), "whole": ("Int32", "1e+42")}[types]
    assert f"the plant stub.fmu has 'tau_drive' as {kind}, which cannot be {number}" in str(caught.value)
    assert caught.value.robot == "robot_1"


@pytest.mark.parametrize(("kind", "number", "given"), [("UInt8", -0.4, 0), ("UInt8", 255.4, 255), ("Int8", -1.6, -2)])
def test_whole_numbers_are_rounded(kind: str, number: float, given: int) -> None:
    assert _as_type("u", kind, number) == given


@pytest.mark.parametrize(("kind", "number"), [("UInt8", -0.6), ("Int8", 127.6), ("Int64", float("nan"))])
def test_what_a_type_does_not_have(kind: str, number: float) -> None:
    with pytest.raises(PlantError, match=f"has 'u' as {kind}, which cannot be {number:g}"):
        _as_type("u", kind, number)


def test_a_whole_number_needs_a_unit(make: Make) -> None:
    with pytest.raises(InputError, match="has 'x' without a unit: a binding states it"):
        open_fmu(make(types="whole"))


@pytest.mark.parametrize("types", ["single", "whole"])
def test_they_are_proposed(make: Make, types: str) -> None:
    fmu = open_fmu_description(make(fmi="3.0", types=types))
    best = proposals(fmu)[0]
    assert best.kind.name == "car_like"
    assert not best.missing
    assert bool(best.open) == (types == "whole"), "the units of whole numbers are to be stated"


def open_fmu_description(path: Path) -> ModelDescription:
    package = open_package(path)
    package.close()
    return package.description


def test_outputs_after_the_first_step(make: Make) -> None:
    late = make(fmi="3.0", types="single", late="error")
    found = drive(late, torques(20), pose=POSE, late_outputs=True)
    assert found[0, :4] == pytest.approx(POSE, abs=1e-7)
    assert np.array_equal(found[1:], drive(make(fmi="3.0", types="single"), torques(20), pose=POSE)[1:])


# In a scenario ----------------------------------------------------------------------------------------------


def test_a_scenario_of_whole_numbers(make: Make, whole: Path, tmp_path: Path) -> None:
    """The controller gets the wheelbase that the scenario sets."""
    fmu = make(fmi="2.0", types="whole")
    about = f'<plant id="car" fmu="{fmu}" binding="{whole}"><parameter name="a" value="1.3 m"/></plant>'
    path = scenario(tmp_path / "s.xml", about)
    result = cosim.run(path)
    plain = scenario(tmp_path / "p.xml", f'<plant id="car" fmu="{make()}"><parameter name="a" value="1.3 m"/></plant>')
    wanted = cosim.run(plain)
    assert np.abs(result["leader_pose"].values - wanted["leader_pose"].values).max() < 2e-3
    path.write_text(path.read_text(encoding="utf-8").replace("1.3 m", "1.3004 m"), encoding="utf-8")
    with pytest.raises(InputError, match=r"1\.3004 m would set 'a' to 1300\.4, but it takes whole numbers only"):
        cosim.run(path)


@pytest.mark.parametrize("types", ["", "single"])
def test_an_input_of_its_own(make: Make, tmp_path: Path, types: str) -> None:
    fmu = make(fmi="3.0", discrete=True, types=types)
    path = scenario(
        tmp_path / "s.xml",
        f'<plant id="car" fmu="{fmu}"/>',
        more='<event at="0.5 s" robots="leader"><input name="push" value="30 N"/></event>',
    )
    speed = cosim.run(path)["leader_velocity"].values[:, 0]
    assert speed[25] == pytest.approx(25 * STEP * 0.2, rel=1e-6)
    assert speed[50] == pytest.approx(50 * STEP * 0.2 + 25 * STEP * 3, rel=1e-6)
