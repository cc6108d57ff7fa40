"""No FMU runs with another FMU's code, nor with the memory of another run, in any order."""

import json
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
import xarray as xr

import cosim
from cosim.cli import main
from cosim.master.robot_plants import member
from cosim.master.simulation import Simulation
from cosim.results.files import load
from cosim.scenario.reader import read_scenario
from cosim.tests.driving import scenario

from .foreign import vehicles
from .stub.stub import VENDOR, make_fmu
from .test_foreign_log import BINDING

MODEL = """
from math import cos, sin, tan

from numbers_of_the_vendor import WHEELBASE
from plants import DRAG
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real
from queue import GAIN

built = [0.0]


class Vehicle(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        built[0] += 0.5  # what another instance would find
        self.number = built[0]
        self.wheelbase = 1000.0
        for causality, variability, names in (
            (Fmi2Causality.parameter, Fmi2Variability.fixed, "x0 y0 heading0 steer0 wheelbase"),
            (Fmi2Causality.input, Fmi2Variability.continuous, "drive_torque steer_torque"),
            (Fmi2Causality.output, Fmi2Variability.continuous, "pos_x pos_y heading steer speed steer_rate"),
        ):
            for name in names.split():
                setattr(self, name, getattr(self, name, 0.0))
                self.register_variable(Real(name, causality=causality, variability=variability))

    def exit_initialization_mode(self):
        import beside_the_harness

        assert beside_the_harness.THERE
        self.pos_x, self.pos_y, self.heading, self.steer = self.x0, self.y0, self.heading0, self.steer0

    def do_step(self, current_time, step_size):
        import late

        self.speed += late.ONE * GAIN * self.number * step_size * (self.drive_torque - DRAG * self.speed)
        self.pos_x += self.speed * step_size / WHEELBASE
        return True
"""

TWO = [("a", 1.0), ("b", 3.0)]


@pytest.fixture(scope="module")
def python_fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return two revisions of one vehicle, of which the modules have names that modules of ours have too."""
    vehicles.require("pythonfmu")
    made = {}
    for name, wheelbase in TWO:
        folder = tmp_path_factory.mktemp(name)
        modules = {
            "model": MODEL,
            "numbers_of_the_vendor": f"WHEELBASE = {wheelbase}",
            "plants": "DRAG = 0.1",
            "queue": "GAIN = 1.0",
            "late": "ONE = 1.0",
        }
        (folder / "sources").mkdir()
        for module, text in modules.items():
            (folder / "sources" / f"{module}.py").write_text(text)
        # Built elsewhere than where these modules would get in the way of the tool itself.
        program = (
            "import sys, queue, pathlib; del sys.modules['queue']; from pythonfmu.builder import FmuBuilder; "
            "files = [path for path in pathlib.Path('sources').iterdir() if path.stem != 'model']; "
            "FmuBuilder.build_FMU('sources/model.py', project_files=files)"
        )
        made[name] = vehicles.run(folder, "Vehicle.fmu", "-c", program)
    return made


@pytest.fixture(scope="module")
def linked_fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return two FMUs that each bring another library of one name."""
    return {name: make_fmu(tmp_path_factory.mktemp(name), vendor=10 * number) for name, number in TWO}


@pytest.fixture(autouse=True)
def beside_the_harness(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Offer a module that no FMU brings, as a script of the user's would have it beside it."""
    folder = tmp_path_factory.mktemp("beside")
    (folder / "beside_the_harness.py").write_text("THERE = True")
    monkeypatch.syspath_prepend(folder)


Scenario = Callable[..., Path]


@pytest.fixture(params=["python_fmus", "linked_fmus"])
def written(request: pytest.FixtureRequest, tmp_path: Path) -> Scenario:
    """Return a function that writes a scenario in which the robots, leader first, are of these FMUs."""
    fmus = request.getfixturevalue(request.param)
    if request.param == "linked_fmus" and sys.platform != "linux":
        pytest.skip("its library is ELF")
    (tmp_path / "binding.xml").write_text(BINDING, encoding="utf-8")
    binding = 'binding="binding.xml"' if request.param == "python_fmus" else ""

    def write(name: str, *robots: str, more: str = "") -> Path:
        plants = "".join(f'<plant id="{key}" fmu="{fmus[key]}" {binding}/>' for key in sorted({*robots}))
        leader, *followers = robots
        return scenario(tmp_path / f"{name}.xml", plants, leader=leader, followers=followers, more=more)

    return write


def same(one: xr.Dataset, other: xr.Dataset) -> bool:
    return bool(one.drop_attrs().identical(other.drop_attrs()))


def test_in_one_scenario_and_one_after_the_other(written: Scenario, tmp_path: Path) -> None:
    """Each robot moves as it does with its own kind alone, after any earlier run in this process."""
    runs = {name: written(name, *name) for name in ("aa", "bb", "ab", "ba")}
    assert main(["run", *map(str, runs.values()), "--out", str(tmp_path), "--no-figure"]) == 0
    once = {name: load(tmp_path / name / "result.nc") for name in runs}
    again = {name: cosim.run(path) for name, path in reversed(runs.items())}
    assert all(same(once[name], again[name]) for name in runs)
    for leader, follower in ("ab", "ba"):
        mixed, alone = once[leader + follower], once[leader * 2]
        assert (mixed.leader_pose == alone.leader_pose).all()
        assert not (mixed.pose == alone.pose).all(), "the follower is another vehicle"
    assert not (once["ab"].leader_pose == once["ba"].leader_pose).all()


def test_in_a_comparison(written: Scenario) -> None:
    """The scenario that another one is compared with runs as it does alone."""
    a, b = (cosim.run(written(name * 2, *name * 2)) for name in "ab")
    rms = [float((run.range_error**2).mean() ** 0.5) for run in (a, b)]
    compare = '<expect><compare measure="rms" signal="range_error" factor="1" scenario="aa.xml"/></expect>'
    expected = rms[1] <= rms[0]
    assert (main(["run", str(written("bb", "b", "b", more=compare)), "--no-figure"]) == 0) == expected
    assert rms[0] != rms[1]


def test_a_file_that_is_replaced(python_fmus: dict[str, Path], tmp_path: Path) -> None:
    (tmp_path / "binding.xml").write_text(BINDING, encoding="utf-8")
    plant = f'<plant id="car" fmu="{tmp_path}/Vehicle.fmu" binding="binding.xml"/>'
    results = []
    for name in "aba":
        shutil.copy(python_fmus[name], tmp_path / "Vehicle.fmu")
        results.append(cosim.run(scenario(tmp_path / "s.xml", plant)))
    assert not (results[0].pose == results[1].pose).all()
    assert same(results[0], results[2])


def test_it_is_said(written: Scenario, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]) -> None:
    path = written("said", "a", "a")
    assert main(["check", str(path)]) == 0
    what = f"a library of its own ({VENDOR})" if "linked" in request.node.name else "Python code (late.py)"
    assert f"its robots in a process of their own, as it brings {what}; " in capsys.readouterr().out
    assert json.loads(cosim.run(path).attrs["plants"])["a"]["process"] == "its own"


def test_an_fmu_that_is_one_binary_needs_no_process_of_its_own(tmp_path: Path) -> None:
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{make_fmu(tmp_path, interface="both")}"/>')
    where = "supervised" if sys.platform == "linux" else "the harness"
    assert json.loads(cosim.run(path).attrs["plants"])["car"]["process"] == where


@pytest.mark.parametrize(("stated", "limit"), [("", 60.0), ('time_limit="7 s"', 7.0)])
def test_it_may_take_as_long_as_in_a_supervised_process(tmp_path: Path, stated: str, limit: float) -> None:
    """Nobody has asked for a process, and so for no limit that others do not have."""
    fmu = make_fmu(tmp_path)
    with zipfile.ZipFile(fmu, "a") as archive:
        archive.writestr("resources/lib/model.jar", b"")
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}" {stated}/>')
    with Simulation(read_scenario(path)) as simulation:
        plant = member(simulation.setup.leader, 1.0)
    assert plant.isolated
    assert plant.spec.time_limit == limit


@pytest.mark.skipif(sys.platform != "linux", reason="the linker of Linux")
def test_variables_that_a_process_has_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each run of an FMU of C++ begins anew: this one drives by how many instances there were."""
    plant = f'<plant id="car" fmu="{make_fmu(tmp_path, macros=("UNIQUE",))}"/>'
    path = scenario(tmp_path / "s.xml", plant)
    assert same(cosim.run(path), cosim.run(path))
    assert main(["check", str(path)]) == 0
    assert "as it brings variables that a process has only once (unique_count)" in capsys.readouterr().out


def test_modules_that_make_room(tmp_path: Path) -> None:
    """Modules within the interpreter and compiled modules cannot be loaded anew."""
    for name in ("json", "numpy", "os", "time", "__main__", "unheard_of"):
        (tmp_path / f"{name}.py").write_text("")
    program = (
        "import sys, pathlib, json.decoder, numpy, os, time\n"
        "from cosim.plant.foreign_modules import make_room\n"
        "before = set(sys.modules)\n"
        f"make_room(pathlib.Path({str(tmp_path)!r}))\n"
        "print(*sorted(name.partition('.')[0] for name in before - set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=300)
    assert set(done.stdout.split()) == {"json"}
