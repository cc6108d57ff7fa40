"""Vehicles made by foreign tools in the closed loop of the paper's first simulation, like our own plant.

With the same method of integration it differs by rounding alone, which the loop amplifies; whether the FMUs run in the
harness or in processes of their own makes no difference at all.
"""

import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import fmpy
import numpy as np
import pytest
from numpy.typing import NDArray

import cosim
from cosim.scenario.grammar import NAMESPACE

from .foreign.vehicles import METHODS, VEHICLES, Vehicle, require

HORIZON = 10.0
TICKS = 500
AMPLIFIED = 1e-11
"""What rounding may grow to in the loop [m, rad], some hundred times what it does; the methods differ by 1e-2."""

OURS = '<plant id="{id}" model="car_like"><parameter name="solver" value="{method}"/></plant>'

Poses = NDArray[np.float64]


def binding(path: Path, vehicle: Vehicle, fmu: Path) -> Path:
    """Write the binding that the table of roles amounts to."""
    lines = []
    for role, variable in vehicle.roles.items():
        name = variable.name if variable.element is None else f"{variable.name}[{variable.element + 1}]"
        attributes = {"variable": name, "initial": variable.start or ""}
        if variable.declared == "missing":
            attributes["unit"] = variable.unit
        if variable.sign != 1.0:  # the table has: variable = sign * role + offset
            attributes["factor"] = f"{variable.sign:g}"
        if variable.offset:
            attributes["offset"] = f"{-variable.sign * variable.offset} {variable.unit}"
        written = " ".join(f'{key}="{text}"' for key, text in attributes.items() if text)
        lines.append(f'<role name="{role}" {written}/>')
    if "drive" not in [v.name for v in fmpy.read_model_description(str(fmu), validate=False).modelVariables]:
        lines.append('<role name="drive" value="as_printed"/>')
    path.write_text(f'<binding xmlns="{NAMESPACE}" vehicle="car_like">{"".join(lines)}</binding>', encoding="utf-8")
    return path


@pytest.fixture
def search_path() -> Iterator[None]:
    """Undo the changes of PythonFMU's FMUs to Python."""
    path, modules = sys.path.copy(), set(sys.modules)
    yield
    sys.path[:] = path
    for name in set(sys.modules) - modules:
        if name in ("rover", "ugv"):
            del sys.modules[name]


@pytest.fixture(scope="module")
def loop(scenarios: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Poses]:
    """Return a function that runs the loop with some plants: the poses of leader and followers."""
    folder = tmp_path_factory.mktemp("loop")

    @cache
    def run(plants: str, *rules: str) -> Poses:
        path = folder / "varied.xml"
        path.write_text(
            f"""<variant xmlns="{NAMESPACE}" name="varied" of="{scenarios / "clmr_line.xml"}">
  <title>Varied</title>
  <set select="simulation/@horizon" value="{HORIZON} s"/>
  <remove select="expect"/>
  <replace select="plant">{plants}</replace>
  {"".join(rules)}
</variant>""",
            encoding="utf-8",
        )
        result = cosim.run(path)
        assert result.sizes["time"] == TICKS + 1
        return np.concatenate([result.leader_pose.values[:, np.newaxis], result.pose.values], axis=1)

    return run


@pytest.fixture(scope="module")
def reference(loop: Callable[..., Poses]) -> dict[str, Poses]:
    """Return the loop's result with our own plant, by method."""
    return {method: loop(OURS.format(id="clmr", method=method)) for method in METHODS}


@pytest.fixture(scope="module", params=VEHICLES)
def vehicle(request: pytest.FixtureRequest) -> Vehicle:
    require(VEHICLES[request.param].tool)
    return VEHICLES[request.param]


@pytest.fixture(scope="module")
def plant(vehicle: Vehicle, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., tuple[str, ...]]:
    """Return a function that writes the plants of a scenario with this vehicle, and rules for the rest."""
    folder = tmp_path_factory.mktemp("foreign")
    fmu = vehicle.build(folder)
    bound = binding(folder / "binding.xml", vehicle, fmu)

    def made(method: str, attributes: str = "", name: str = "clmr") -> tuple[str, ...]:
        kind = {"CoSimulation": "co_simulation", "ModelExchange": "model_exchange"}[vehicle.interface]
        solver = f'solver="{method}"' if kind == "model_exchange" else ""
        # Repackaged FMUs have our parameters, and by default the method that is wanted.
        own = f'<plant id="{name}" fmu="{fmu}" binding="{bound}" interface="{kind}" {solver} {attributes}/>'
        if "v" in vehicle.roles:
            return (own,)
        return own + OURS.format(id="ours", method=method), '<set select="leader/@plant" value="ours"/>'

    return made


def test_the_methods_differ(reference: dict[str, Poses]) -> None:
    apart = np.abs(reference["euler"] - reference["runge_kutta_4"]).max(axis=(0, 1))
    assert (apart > 1e-3).all()


@pytest.mark.usefixtures("search_path")
def test_in_the_harness_and_in_processes_of_their_own(
    vehicle: Vehicle,
    plant: Callable[..., tuple[str, ...]],
    loop: Callable[..., Poses],
    reference: dict[str, Poses],
) -> None:
    for method in vehicle.methods:
        within, apart = (loop(*plant(method, isolate)) for isolate in ("", 'isolate="process" time_limit="60 s"'))
        np.testing.assert_allclose(within, reference[method], rtol=0.0, atol=AMPLIFIED)
        np.testing.assert_array_equal(apart, within)


def test_several_in_one_run(loop: Callable[..., Poses], reference: dict[str, Poses], tmp_path: Path) -> None:
    """Two FMUs of PythonFMU and the like, which change Python itself, get processes of their own."""
    plants, rules = "", []
    for number, name in enumerate(("pythonfmu3", "casadi", "repackaged_3"), 2):
        vehicle = VEHICLES[name]
        require(vehicle.tool)
        folder = tmp_path / name
        folder.mkdir()
        fmu = vehicle.build(folder)
        bound = binding(folder / "binding.xml", vehicle, fmu)
        solver = 'interface="model_exchange" solver="runge_kutta_4"' if vehicle.interface == "ModelExchange" else ""
        isolate = 'isolate="process" time_limit="60 s"' if name != "casadi" else ""
        plants += f'<plant id="{name}" fmu="{fmu}" binding="{bound}" {solver} {isolate}/>'
        rules.append(f'<set select="follower[{number}]/@plant" value="{name}"/>')
    poses = loop(OURS.format(id="clmr", method="runge_kutta_4") + plants, *rules)
    np.testing.assert_allclose(poses, reference["runge_kutta_4"], rtol=0.0, atol=AMPLIFIED)
