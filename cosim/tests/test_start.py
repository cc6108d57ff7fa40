"""The start of plants: inputs of initial equations, and messages about plants that cannot start."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cosim
from cosim.cli import main
from cosim.compare.comparison import PlantFile, compare_plants
from cosim.errors import InputError, SimulationError
from cosim.scenario.grammar import NAMESPACE
from cosim.scenario.reader import read_binding
from plants.factory.compile import compile_library, find_compiler
from plants.factory.platforms import host
from tests.stub.stub import Options, binary_path, description, write

from .driving import STEP, drive, fleet, scenario

Make = Callable[..., Path]
MODEL = {"interface": "model_exchange"}
ISOLATE = 'isolate="process" time_limit="30 s"'


# Inputs at the start ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "run"),
    [
        *(({"fmi": fmi}, {"isolated": isolated}) for fmi in ("1.0", "2.0", "3.0") for isolated in (False, True)),
        *(
            ({"fmi": fmi, **MODEL}, {"solver": solver})
            for fmi in ("1.0", "2.0", "3.0")
            for solver in ("euler", "cvode")
        ),
        ({"fmi": "2.0", **MODEL}, {"solver": "cvode", "isolated": True}),
    ],
)
def test_initial_equations_know_the_inputs(make: Make, options: dict[str, Any], run: dict[str, Any]) -> None:
    with fleet(make(start_torque=True, **options), given=(5.0, 1.0), **run) as (_, state):
        assert state[0].tolist() == [0.0, 0.0, 0.0, 0.0, 0.5, 0.0]


def test_initial_equations_know_inputs_in_other_units(make: Make, tmp_path: Path) -> None:
    """The number that the FMU is given is the one of its first step."""
    roles = '<role name="tau_drive" variable="tau_drive" factor="2" offset="1 N.m"/>'
    plants = f'<plant id="car" fmu="{make(start_torque=True)}"><binding vehicle="car_like">{roles}</binding></plant>'
    result = cosim.run(scenario(tmp_path / "s.xml", plants))
    assert result.leader_velocity.values[0].tolist() == [(2.0 - 1.0) / 2.0 / 10.0, 0.0]


@pytest.mark.parametrize("isolate", ["", ISOLATE])
def test_what_a_scenario_knows_at_the_start(make: Make, tmp_path: Path, isolate: str) -> None:
    """The leader's torque and disturbances; a controller's command follows from measurements after the start."""
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{make(start_torque=True)}" {isolate}/>')
    result = cosim.run(path)
    assert result.leader_velocity.values[0].tolist() == [0.2, 0.0]
    assert result.velocity.values[0].tolist() == [[0.0, 0.0]]
    disturbed = '<input name="tau_drive"><constant value="3 N.m"/></input>'
    path.write_text(path.read_text("utf-8").replace("  <leader", f"  {disturbed}\n  <leader"), "utf-8")
    assert cosim.run(path).velocity.values[0].tolist() == [[0.3, 0.0]]


def test_plants_that_are_compared_know_their_first_torque(make: Make) -> None:
    compared = compare_plants(PlantFile(make()), make(start_torque=True), duration=1.0, isolated=False)
    first, second = (states[0, 4] for states in compared.states)
    assert (first, second) == (0.0, compared.torque[0, 0] / 10.0)


@pytest.mark.parametrize("isolated", [False, True])
def test_inputs_that_are_refused_at_the_start(make: Make, isolated: bool) -> None:
    fmu = make(behaviour="error", place="set", when=0.0)
    said = r"it did not accept its inputs \(status Error\): set returns error at t = 0 s"
    with (
        pytest.raises(InputError, match=f"stub.fmu cannot be started as robot_1: {said}"),
        fleet(fmu, isolated=isolated),
    ):
        pass


# What is told of plants that cannot start -------------------------------------------------------------------


def refusal(*fmus: Path, **options: Any) -> str:
    with pytest.raises(InputError) as caught, fleet(*fmus, **options):
        pass
    return str(caught.value).partition("cannot be started as ")[2]


SILENT = 'the FMU gives no reason; log="on" in its <plant> may show one'


@pytest.mark.parametrize("fmi", ["1.0", "2.0", "3.0"])
def test_an_fmu_that_gives_no_instance_and_no_reason(make: Make, fmi: str) -> None:
    fmu = make(fmi=fmi, behaviour="silent", place="instantiate")
    assert refusal(fmu) == f"robot_1: its instantiation failed; {SILENT}"
    assert refusal(fmu, logging=True) == "robot_1: its instantiation failed"
    assert refusal(fmu, isolated=True) == f"robot_1: its instantiation failed; {SILENT}"


def test_an_fmu_that_does_not_initialise_and_gives_no_reason(make: Make) -> None:
    said = refusal(make(behaviour="silent", place="initialization"))
    assert said == f"robot_1: fmi2ExitInitializationMode failed with status 3 (error).; {SILENT}"


def test_a_value_that_is_refused_without_a_reason(make: Make, tmp_path: Path) -> None:
    fmu = make(behaviour="silent", place="set", when=0.0)
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}"/>')
    with pytest.raises(InputError, match=r"it did not accept its inputs \(status Error\): " + re.escape(SILENT)):
        cosim.Simulation(cosim.read_scenario(path))


def test_a_second_instance_that_is_not_given(make: Make) -> None:
    """Processes are the way out, and an execution tool is not all that may be missing."""
    said = refusal(make(once=True, execution_tool=True), make(once=True, execution_tool=True))
    reason = "it can be instantiated only once per process, and there is an instance already"
    way_out = "robot_1 runs the same FMU in this process, which may allow one only: "
    way_out += 'isolate="process" in its <plant> gives each robot a process of its own'
    tool = "it also needs the tool that made it, which may be missing here"
    assert said == f"robot_2: {reason}; {way_out}; {tool}"


@pytest.mark.parametrize("brought", [False, True])
def test_a_library_that_is_missing(tmp_path: Path, brought: bool) -> None:
    """Whoever reads it knows whether to install something or to ask the FMU's vendor."""
    platform, compiler = host(), find_compiler()
    name = f"libvendor{platform.suffix}"
    (tmp_path / "vendor.c").write_text('__attribute__((visibility("default"))) int vendor(void) { return 1; }\n')
    (tmp_path / "model.c").write_text("int vendor(void);\nint model(void) { return vendor(); }\n")
    vendor = compile_library(compiler, platform, tmp_path, ["vendor.c"], "libvendor", [f"-Wl,-soname,{name}"])
    (tmp_path / name).write_bytes(vendor)
    flags = ["-Wl,--no-as-needed", f"-L{tmp_path}", "-lvendor"]
    place = binary_path(Options())
    content = {"modelDescription.xml": description(Options()).encode()}
    content[place] = compile_library(compiler, platform, tmp_path, ["model.c"], "stub", flags)
    if brought:
        content[str(Path(place).with_name(name))] = vendor
    said = refusal(write(tmp_path / "stub.fmu", content))
    expected = f"which the FMU brings as {Path(place).with_name(name)}, but does not look for it there: its vendor must"
    if not brought:
        expected = "which neither the FMU brings nor this machine has: install it"
    assert said.startswith(f"robot_1: its binary cannot be loaded: it needs the library {name}, {expected}")


# Outputs that show only after the first step ----------------------------------------------------------------

POSE = (1.0, -2.0, 0.3, 0.2)
TORQUES = np.tile([5.0, 1.0], (20, 1))
OUT = np.empty((20, 1, 6))
LATE = {"late_outputs": True, "pose": POSE}


@pytest.mark.parametrize("late", ["zero", "nan", "error"])
@pytest.mark.parametrize("isolated", [False, True])
def test_outputs_that_show_after_the_first_step(make: Make, late: str, isolated: bool) -> None:
    """Until then the plant stands at its pose, for any outputs; from then on it moves like any other."""
    moved = drive(make(late=late), TORQUES, isolated=isolated, **LATE)
    np.testing.assert_array_equal(moved, drive(make(), TORQUES, pose=POSE))


def test_in_other_units_it_stands_at_its_pose_to_rounding(make: Make) -> None:
    moved = drive(make(late="nan", units="deg"), TORQUES, **LATE)
    np.testing.assert_allclose(moved, drive(make(units="deg"), TORQUES, pose=POSE), rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize("solver", ["euler", "cvode"])
def test_what_shows_its_pose_at_once_may_be_late_too(make: Make, fmi: str, solver: str) -> None:
    fmu = make(fmi=fmi, **MODEL)
    late, at_once = (drive(fmu, TORQUES, pose=POSE, solver=solver, late_outputs=said) for said in (True, False))
    np.testing.assert_array_equal(late, at_once)


@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.parametrize("by_step", [False, True])
def test_a_plant_that_was_elsewhere(make: Make, tmp_path: Path, isolated: bool, by_step: bool) -> None:
    """A pose that is presumed at the start is checked as soon as it shows: here x and y are mixed up."""
    initial = {"x": "y0", "y": "x0", "psi": "psi0", "gamma": "gamma0"}
    roles = "".join(f'<role name="{name}" variable="{name}" initial="{by}"/>' for name, by in initial.items())
    (tmp_path / "b.xml").write_text(f'<binding xmlns="{NAMESPACE}" vehicle="car_like">{roles}</binding>', "utf-8")
    far = {"late_outputs": True, "pose": (3.0, 0.0, 0.0, 0.0), "binding": read_binding(tmp_path / "b.xml")}
    with fleet(make(late="zero", initial="parameters"), **far, isolated=isolated) as (started, state):
        assert state[0, 0] == 3.0
        with pytest.raises(SimulationError) as caught:
            (started.step if by_step else started.run)(0, STEP, *([TORQUES[0]] if by_step else [TORQUES, OUT]))
    said = "the plant stub.fmu does not take the initial pose: x is 0 m after the first step, too far from 3 m at the"
    assert str(caught.value).startswith(f"robot_1 at t = 0.02 s: {said} start")


def test_outputs_that_do_not_show_the_pose_name_the_way_out(make: Make, tmp_path: Path) -> None:
    fmu = make(late="zero")
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}"/>')
    with pytest.raises(InputError, match=r'not -2 m; if its outputs show .*: start="first_step" in its <plant>$'):
        cosim.run(path)
    with pytest.raises(SimulationError, match=r'has diverged: x = nan m; .* start="first_step" in its <plant>$'):
        cosim.run(scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{make(late="nan")}"/>'))


def test_the_first_step_in_a_scenario(make: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    late = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{make(late="zero")}" start="first_step"/>')
    result = cosim.run(late)
    assert main(["check", str(late)]) == 0
    assert "supervised, outputs read from the first step on;" in capsys.readouterr().out
    at_once = cosim.run(scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{make()}"/>'))
    file = "plant_sha256"  # in which the two differ, and in attributes
    assert result.drop_vars(file).identical(at_once.drop_vars(file).assign_attrs(result.attrs))
    with pytest.raises(InputError, match=r'start="later" of <plant> .*first_step'):
        cosim.read_scenario(scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{make()}" start="later"/>'))


def test_the_first_step_in_a_comparison(make: Make, tmp_path: Path) -> None:
    fmu = make(late="zero")
    other = ["compare-plants", str(make()), str(fmu), "--duration", "1 s", "--within", "1e-12 m", "--no-figure"]
    assert main([*other, "--out", str(tmp_path), "--start-b", "first_step"]) == 0
    assert main([*other, "--out", str(tmp_path)]) == 2


# The tolerance of an FMU's own solver -----------------------------------------------------------------------


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize(
    ("stated", "default", "told"),
    [
        ("", "", None),
        ("", "1e-5", 1e-5),
        ('tolerance="1e-8"', "", 1e-8),
        ('tolerance="1e-8"', "1e-5", 1e-8),
        ("", "0", None),
        ("", "NaN", None),
    ],
)
def test_an_fmu_is_told_a_tolerance(
    make: Make, tmp_path: Path, fmi: str, stated: str, default: str, told: float | None
) -> None:
    """As in FMPy: the scenario's tolerance, or the default experiment's; the result has it."""
    fmu = make(fmi=fmi, tolerance=default, says_tolerance=True)
    result = cosim.run(scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}" {stated}/>'))
    said = "no tolerance" if told is None else f"a tolerance of {told:g}"
    assert json.loads(result.attrs["plant_messages"])[0] == f"leader, t = 0 s: it is told {said}"
    assert json.loads(result.attrs["plants"])["car"]["tolerance"] == told


def test_the_tolerance_is_told_by_check(make: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{make()}" tolerance="1e-8" {ISOLATE}/>')
    assert main(["check", str(path)]) == 0
    said = "FMI 2.0 Co-Simulation, with a tolerance of 1e-08, its robots in a process of their own"
    assert said in capsys.readouterr().out


def test_cvode_has_its_tolerance_in_the_result(make: Make, tmp_path: Path) -> None:
    fmu = make(tolerance="1e-3", says_tolerance=True, **MODEL)
    for said, tolerance in (("", None), ('solver="cvode"', 1e-6), ('solver="cvode" tolerance="1e-9"', 1e-9)):
        result = cosim.run(scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}" {said}/>', horizon="0.1 s"))
        assert json.loads(result.attrs["plants"])["car"]["tolerance"] == tolerance
        assert "it is told no tolerance" in result.attrs["plant_messages"]


def test_a_tolerance_that_cannot_be_told_is_refused(make: Make, tmp_path: Path) -> None:
    one = scenario(tmp_path / "one.xml", f'<plant id="car" fmu="{make(fmi="1.0")}" tolerance="1e-6"/>')
    with pytest.raises(InputError, match=r"one.xml:4:\d+: .* FMI 1.0 .* no tolerance"):
        cosim.Simulation(cosim.read_scenario(one))
    ours = scenario(tmp_path / "ours.xml", '<plant id="car" model="car_like" tolerance="1e-6"/>')
    with pytest.raises(InputError, match='takes its tolerance as <parameter name="tolerance" value="1e-06"/>'):
        cosim.Simulation(cosim.read_scenario(ours))
