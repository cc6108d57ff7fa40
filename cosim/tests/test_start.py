"""How plants start: what initial equations know of their inputs, and what is told of plants that cannot start."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import cosim
from cosim.compare import PlantFile, compare_plants
from cosim.errors import InputError
from plants.factory.compile import compile_library, find_compiler
from plants.factory.platforms import host
from tests.stub.stub import Options, binary_path, description, make_fmu, write

from .driving import fleet, scenario

Make = Callable[..., Path]
MODEL = {"interface": "model_exchange"}


@pytest.fixture(scope="module")
def make(tmp_path_factory: pytest.TempPathFactory) -> Make:
    """Return a function that makes stubs, each once."""

    @cache
    def made(**options: Any) -> Path:
        return make_fmu(tmp_path_factory.mktemp("fmu"), **options)

    return made


# Inputs at the start ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "run"),
    [
        *(({"fmi": fmi}, {"isolated": isolated}) for fmi in ("1.0", "2.0", "3.0") for isolated in (False, True)),
        *(({"fmi": fmi, **MODEL}, {"solver": solver}) for fmi in ("2.0", "3.0") for solver in ("euler", "cvode")),
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


@pytest.mark.parametrize("isolate", ["", 'isolate="process" time_limit="30 s"'])
def test_what_a_scenario_knows_at_the_start(make: Make, tmp_path: Path, isolate: str) -> None:
    """The leader's torque and disturbances; what a controller commands follows from measurements after the start."""
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
    assert refusal(fmu) == f"robot_1: it does not instantiate; {SILENT}"
    assert refusal(fmu, logging=True) == "robot_1: it does not instantiate"
    assert refusal(fmu, isolated=True) == f"robot_1: it does not instantiate; {SILENT}"


def test_an_fmu_that_does_not_initialise_and_gives_no_reason(make: Make) -> None:
    said = refusal(make(behaviour="silent", place="initialization"))
    assert said == f"robot_1: fmi2ExitInitializationMode failed with status 3 (error).; {SILENT}"


def test_a_second_instance_that_is_not_given(make: Make) -> None:
    """Processes are the way out, and an execution tool is not all that may be missing."""
    said = refusal(make(once=True, execution_tool=True), make(once=True, execution_tool=True))
    reason = "it can be instantiated only once per process, and there is an instance already"
    way_out = "robot_1 runs the same FMU in this process, which may allow one only: "
    way_out += 'isolate="process" in its <plant> gives each robot a process of its own'
    tool = "it also says that it needs an execution tool, which may be missing here"
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
