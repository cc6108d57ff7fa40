"""Vehicles made by foreign tools: their descriptions, and that they move as ours does.

The tools come with the extra ``foreign``. Where one is missing its tests are skipped, unless FORMATION_REQUIRE_FOREIGN
is set.
"""

import json
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

import plants
from plants import units

from .foreign.open_loop import OURS, STEP, Robot
from .foreign.vehicles import METHODS, UNITS, VEHICLES, Vehicle, require, to_variables

START = {"x": 1.0, "y": -2.0, "psi": 0.5, "gamma": 0.3}
LONGER = {"a": 1.5}
TIME = STEP * np.arange(250)
TORQUES = np.column_stack([20.0 + 30.0 * np.sin(1.9 * TIME), 12.0 * np.sign(np.sin(1.7 * TIME)) - 2.0])
ROUNDING = 1e-12
"""Some thousand times the rounding of the numbers here: what two ways to write down the same method may differ by."""


@pytest.fixture(scope="module", params=VEHICLES)
def vehicle(request: pytest.FixtureRequest) -> Vehicle:
    require(VEHICLES[request.param].tool)
    return VEHICLES[request.param]


@pytest.fixture(scope="module")
def fmu(vehicle: Vehicle, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return vehicle.build(tmp_path_factory.mktemp("foreign"))


@pytest.fixture(scope="module")
def description(fmu: Path) -> Any:
    return fmpy.read_model_description(str(fmu), validate=False)


@pytest.fixture
def robots(tmp_path: Path) -> Iterator[Callable[..., Robot]]:
    """Return a function that makes robots, which are freed in the end."""
    made: list[Robot] = []
    path = sys.path.copy()

    def make(fmu: Path, *more: Any) -> Robot:
        made.append(Robot(fmu, tmp_path / str(len(made)), *more))
        return made[-1]

    yield make
    for robot in made:
        robot.close()
    sys.path[:] = path  # PythonFMU leaves its folders there


def reference(robots: Callable[..., Robot], method: str, **start: float) -> np.ndarray:
    """Drive our own plant with a method: the outputs (n + 1, 6) in the order of `UNITS`."""
    robot = robots(plants.build("car_like"), "CoSimulation", OURS)
    robot.model.setInteger([robot.variables["solver"].valueReference], [1 + METHODS.index(method)])
    return robot.start(**start).drive(TORQUES)


# What they say ----------------------------------------------------------------------------------------------


def test_it_is_of_the_kind_and_the_tool_stated(vehicle: Vehicle, description: Any) -> None:
    assert description.fmiVersion == vehicle.fmi
    assert description.generationTool.startswith(vehicle.signature)
    interfaces = {"CoSimulation": description.coSimulation, "ModelExchange": description.modelExchange}
    offered = {name for name, interface in interfaces.items() if interface is not None}
    assert offered == ({vehicle.interface} if vehicle.signature != "Formation" else set(interfaces))
    assert all(not interfaces[name].canBeInstantiatedOnlyOncePerProcess for name in offered)


def test_fmpy_finds_the_known_problems_and_no_others(vehicle: Vehicle, fmu: Path) -> None:
    found = validate_fmu(str(fmu))
    assert len(found) == len(vehicle.problems), found
    for problem, known in zip(sorted(found), sorted(vehicle.problems), strict=True):
        assert problem.startswith(known)


def test_variables_have_the_causality_and_the_start_values_of_their_roles(vehicle: Vehicle, description: Any) -> None:
    variables = {variable.name: variable for variable in description.modelVariables}
    for name, role in vehicle.roles.items():
        variable = variables[role.name]
        assert variable.causality == ("parameter" if name == "a" else "input" if name.startswith("tau") else "output")
        assert (role.element is None) == (not variable.dimensions)
        if role.start is not None:
            assert variables[role.start].causality == "parameter"
            assert variable.initial == "calculated"
        elif name in START:
            assert variable.initial == "exact"


def test_the_table_tells_the_units_that_the_fmu_states(vehicle: Vehicle, description: Any) -> None:
    variables = {variable.name: variable for variable in description.modelVariables}
    defined = {unit.name: unit.baseUnit for unit in description.unitDefinitions}
    for role in vehicle.roles.values():
        for name in filter(None, (role.name, role.start)):
            unit = variables[name].unit
            assert role.declared == ("defined" if unit in defined else "named" if unit else "missing")
            if role.declared == "named":
                assert unit == role.unit
            elif role.declared == "defined":
                base = defined[unit]
                stated = units.Unit(tuple(getattr(base, symbol) for symbol in units.BASE_UNITS), base.factor)
                assert stated == units.parse(role.unit)
    if vehicle.tool == "fmu_manipulation_toolbox":
        names = {variables[role.name].unit for role in vehicle.roles.values()}
        assert names == {"metre", "radian", "newtonmetre", "mps", "radps"}, "no names that could be guessed"


# How they move ----------------------------------------------------------------------------------------------


def test_with_the_same_method_they_move_as_ours_does(vehicle: Vehicle, fmu: Path, robots: Callable[..., Robot]) -> None:
    offered = [i for i, role in enumerate(list(UNITS)[:6]) if role in vehicle.roles]
    for method in vehicle.methods:
        moved = robots(fmu, vehicle.interface, vehicle.roles, method).start(**START, **LONGER).drive(TORQUES)
        expected = reference(robots, method, **START, **LONGER)
        np.testing.assert_allclose(moved, expected[:, offered], rtol=0.0, atol=ROUNDING)


def test_the_experiment_tells_methods_and_wheelbases_apart(robots: Callable[..., Robot]) -> None:
    euler, runge_kutta = (reference(robots, method, **START, **LONGER) for method in METHODS)
    shorter = reference(robots, METHODS[0], **START)
    for other in (runge_kutta, shorter):
        assert (np.abs(other - euler).max(axis=0) > 1e-3).all()
    assert np.abs(euler[:, 3]).max() > 0.5, "it is steered far enough for the equations to be nonlinear"


def test_two_at_once_do_not_disturb_each_other(vehicle: Vehicle, fmu: Path, robots: Callable[..., Robot]) -> None:
    def make() -> Robot:
        return robots(fmu, vehicle.interface, vehicle.roles, vehicle.methods[0])

    alone = make().start(**START).drive(TORQUES[:20])
    one, other = make(), make()
    one.start(**START)
    other.start(**{role: -value for role, value in START.items()})
    for k, (drive, steer) in enumerate(TORQUES[:20].tolist()):
        one.set({"tau_drive": drive, "tau_steer": steer})
        other.set({"tau_drive": -steer, "tau_steer": drive})
        other.step(k * STEP)
        one.step(k * STEP)
    assert one.get("x", "y", "psi", "gamma") == alone[-1, :4].tolist()
    assert other.get("x") != one.get("x")


PROGRAM = """
import faulthandler, json, os, sys
import fmpy
faulthandler.enable()
fmu, interface, start, outputs = json.loads(sys.argv[1])
result = fmpy.simulate_fmu(fmu, validate=False, fmi_type=interface, start_values=start, output=outputs, stop_time=1.0,
                           output_interval=0.02, relative_tolerance=1e-10)
print(json.dumps([result[name][-1].tolist() for name in outputs]), flush=True)
os._exit(0)
"""


def simulate_alone(folder: Path, *argument: Any) -> Any:
    """Return the values at the end that FMPy finds in a process of its own.

    A process that a signal ends is started a second time, with a warning: PythonFMU3's FMU has been seen to abort,
    once in some thousand processes, with no code of ours in it.
    """
    command = [sys.executable, "-c", PROGRAM, json.dumps(argument)]
    for attempt in (1, 2):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode >= 0 or attempt == 2:
            break
        warnings.warn(f"FMPy alone died of signal {-done.returncode}: {done.stderr}", stacklevel=2)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.filterwarnings("default:FMPy alone died")
def test_fmpy_simulates_it_alone_in_a_process(
    vehicle: Vehicle, fmu: Path, robots: Callable[..., Robot], tmp_path: Path
) -> None:
    torques = {"tau_drive": 20.0, "tau_steer": 5.0}
    start: dict[str, Any] = to_variables(vehicle.roles, START | torques, start=True)
    start = {name: values if len(values) > 1 else values[0] for name, values in start.items()}
    outputs = [vehicle.roles[role].name for role in ("psi", "gamma")]
    values = simulate_alone(tmp_path, str(fmu), vehicle.interface, start, outputs)
    ends = [vehicle.roles[role].from_fmu(role, value) for role, value in zip(("psi", "gamma"), values, strict=True)]
    robot = robots(fmu, vehicle.interface, vehicle.roles, "runge_kutta_4").start(**START)
    expected = robot.drive(np.full((50, 2), list(torques.values())))[-1, 2:4]
    # FMPy integrates Model Exchange with CVODE.
    np.testing.assert_allclose(ends, expected, rtol=0.0, atol=1e-7 if vehicle.interface == "ModelExchange" else 1e-14)
