"""Controllers of scenarios as FMUs: the loop that another master closes with them is our own, bit for bit."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
import xarray as xr
from fmpy.validation import validate_fmu

import cosim
from cosim.cli import main
from cosim.errors import InputError
from cosim.master.setup import Setup
from cosim.scenario.reader import read_scenario
from cosim.scenario.scenario import Scenario
from cosim.team_fmu import build_team_fmu

from .commands import failed
from .environments import CONTROLLERS, FAULTY, distribution, environment
from .team_loop import Made, Slave, closed_loop, courses, make_fmus, slaves

ROOT = Path(__file__).resolve().parent.parent
TICKS = 120


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return FMUs of a scenario, built once."""
    known: dict[tuple[str, str, tuple[str, ...]], Made] = {}
    with ExitStack() as cleanup:

        def make(name: str, fmi: str = "2.0", changes: tuple[str, ...] = ()) -> Made:
            key = name, fmi, changes
            if key not in known:
                scenario = read_scenario(ROOT / "scenarios" / f"{name}.xml", changes)
                known[key] = make_fmus(scenario, cleanup, tmp_path_factory.mktemp(name), fmi)
            return known[key]

        yield make


def reference(scenario: Scenario, ticks: int = TICKS) -> xr.Dataset:
    return cosim.run(scenario.edited(horizon=ticks * scenario.step, expectations=False))


def compare(result: dict[str, np.ndarray], dataset: xr.Dataset, setup: Setup) -> int:
    """Check that all that the FMUs give is what a run of ours has recorded; return how many courses there are."""
    count = 0
    for name, theirs, ours in courses(result, dataset, setup):
        np.testing.assert_array_equal(theirs, ours, name)
        np.testing.assert_array_equal(np.signbit(theirs), np.signbit(ours), f"signs of {name}")
        count += 1
    return count


@pytest.mark.parametrize(
    ("name", "fmi"),
    [
        ("mixed_team", "2.0"),  # two laws, three vehicles, a leader of another kind
        ("formation_change", "3.0"),  # places over time
        ("sensor_dropout", "2.0"),
        ("one_sample_delay", "2.0"),
        ("side_wind", "3.0"),
        ("tractor_trailer_circle", "2.0"),
        ("figure_eight", "2.0"),  # a leader whose motion is given
        ("compare_high_gain", "2.0"),
    ],
)
def test_the_loop_has_the_bits_of_our_own(made: Callable[..., Made], tmp_path: Path, name: str, fmi: str) -> None:
    own = made(name, fmi)
    result = closed_loop(own, slaves(own, tmp_path), tmp_path, TICKS)
    assert compare(result, reference(own.scenario), own.setup) > 5 * len(own.setup.followers)


def test_one_function_may_do_several_things(tmp_path: Path) -> None:
    """Noise and bias are added by the same one, and so are the torques of two followers of one law and two sizes."""
    text = (ROOT / "scenarios" / "convoy.xml").read_text(encoding="utf-8")
    for old, new in (
        ("<noise ", '<bias x="5 cm" from="0.5 s" to="1 s"/><noise '),
        (
            '<plant id="car" model="car_like">',
            '<plant id="long" model="car_like"><parameter name="a" value="1.5 m"/></plant>{}',
        ),
        ('<follower id="follower_2" plant="car"', '<follower id="follower_2" plant="long"'),
    ):
        assert text.count(old) == 1, old
        text = text.replace(old, new.format(old))
    path = tmp_path / "several.xml"
    path.write_text(text, encoding="utf-8")
    with ExitStack() as cleanup:
        own = make_fmus(read_scenario(path), cleanup, tmp_path)
        result = closed_loop(own, slaves(own, tmp_path), tmp_path, TICKS)
        assert compare(result, reference(own.scenario), own.setup) > 5 * len(own.setup.followers)


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_fmpy_finds_no_fault(made: Callable[..., Made], fmi: str) -> None:
    for fmu in made("mixed_team", "2.0").fmus + made("formation_change", "3.0").fmus:
        assert validate_fmu(str(fmu)) == []


def test_variables_have_units_bounds_and_dependencies(made: Callable[..., Made]) -> None:
    description = fmpy.read_model_description(made("mixed_team").fmus[0])
    by_name = {variable.name: variable for variable in description.modelVariables}
    assert {"leader.x", "leader.v", "car_1.gamma", "truck_1.theta_0"} <= {
        name for name, v in by_name.items() if v.causality == "input"
    }
    assert by_name["car_1.x"].unit == "m"
    assert float(by_name["car_1.x"].start) == -4.5
    assert by_name["truck_1.tau_left"].causality == "output"
    gain = by_name["car_1.K_p[1]"]
    assert (gain.causality, gain.variability, float(gain.start), float(gain.min)) == ("parameter", "tunable", 40.0, 0.0)
    assert by_name["seed"].type == "Integer"
    of = {u.variable.name: {v.name for v in u.dependencies} for u in description.outputs}
    assert "car_1.x" in of["car_1.tau_drive"]
    assert "leader.v" in of["car_1.tau_drive"]
    assert "truck_1.x" not in of["car_1.tau_drive"]
    assert float(description.defaultExperiment.stepSize) == 0.02
    assert description.coSimulation.canSerializeFMUstate


def test_gains_and_seed_by_parameter_are_those_of_a_scenario(made: Callable[..., Made], tmp_path: Path) -> None:
    own = made("formation_change", "3.0")
    (team,) = slaves(own, tmp_path)
    followers = [robot.name for robot in own.setup.followers]
    team.set({f"{name}.K_p[{k}]": 25.0 for name in followers for k in (1, 2)} | {"seed": 77})
    result = closed_loop(own, [team], tmp_path, TICKS)
    changed = read_scenario(ROOT / "scenarios/formation_change.xml", ["//gain[@name='K_p']/@value=25", "//@seed=77"])
    compare(result, reference(changed), own.setup)
    with pytest.raises(AssertionError):
        compare(result, reference(own.scenario), own.setup)


def test_a_large_seed_is_built_in(made: Callable[..., Made], tmp_path: Path) -> None:
    own = made("convoy", "2.0", (f"//@seed={2**40 + 5}", "//noise/@x=3 mm"))
    assert "seed" not in {v.name for v in fmpy.read_model_description(own.fmus[0]).modelVariables}
    result = closed_loop(own, slaves(own, tmp_path), tmp_path, 40)
    compare(result, reference(own.scenario, 40), own.setup)


def test_a_saved_state_goes_on_in_another_instance_with_the_same_bits(
    made: Callable[..., Made], tmp_path: Path
) -> None:
    own = made("sensor_dropout")
    first, second = (Slave(own.fmus[0], tmp_path / name, name) for name in ("first", "second"))
    inputs = [v.name for v in first.variables.values() if v.causality == "input"]
    outputs = [v.name for v in first.variables.values() if v.causality == "output"]
    starts = np.array([float(first.variables[name].start) for name in inputs])

    def drive(slave: Slave, ticks: range) -> list[list[float]]:
        got = []
        for tick in ticks:
            slave.set(dict(zip(inputs, starts + 0.01 * tick * np.cos(np.arange(len(inputs))), strict=True)))
            got.append(slave.get(outputs))
            slave.step(0.02 * tick, 0.02)
        return got

    for slave in (first, second):
        slave.start()
    drive(first, range(60))
    state = first.fmu.getFMUstate()
    data = first.fmu.serializeFMUstate(state)
    unbroken = drive(first, range(60, 120))
    drive(second, range(7))
    second.fmu.setFMUstate(second.fmu.deSerializeFMUstate(data))
    assert drive(second, range(60, 120)) == unbroken
    first.fmu.setFMUstate(state)
    assert drive(first, range(60, 120)) == unbroken
    for slave in (first, second):
        slave.close()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"follower_1.K_p[1]": 0.0}, "parameter follower_1.K_p[1] is 0 .*: must be greater than 0"),
        ({"follower_2.gamma_w": -1.0}, "parameter follower_2.gamma_w is -1"),
        ({"follower_1.x": float("nan")}, "input follower_1.x is set to nan at time 0 s: must be a finite number"),
        ({"seed": -1}, "parameter seed is -1"),
    ],
)
def test_bad_values_are_refused(
    made: Callable[..., Made], tmp_path: Path, capfd: pytest.CaptureFixture[str], values: dict[str, float], message: str
) -> None:
    slave = Slave(made("sensor_dropout").fmus[0], tmp_path, "one")

    def begin() -> None:
        slave.set(values)
        slave.start()

    with pytest.raises(fmpy.fmi1.FMICallException):
        begin()
    slave.fmu.freeInstance()
    assert re.search(re.escape(message).replace(r"\.\*", ".*"), capfd.readouterr().out)


@pytest.mark.skipif(sys.platform != "linux", reason="asks ldd")
def test_nothing_of_python_is_inside(made: Callable[..., Made], tmp_path: Path) -> None:
    fmpy.extract(made("mixed_team").fmus[0], tmp_path / "fmu")
    (library,) = (tmp_path / "fmu/binaries").glob("*/*.so")
    needs = subprocess.run(["ldd", library], capture_output=True, text=True, check=True).stdout
    assert {line.split()[0].split("/")[-1].split(".")[0] for line in needs.splitlines()} <= {
        "linux-vdso",
        "libm",
        "libc",
        "ld-linux-x86-64",
        "ld-linux-aarch64",
    }
    guid = fmpy.read_model_description(tmp_path / "fmu").guid
    driver = tmp_path / "driver.c"
    driver.write_text(
        f"""
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
typedef struct {{
    void *log, *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void *finished, *environment;
}} Callbacks;
#define GET(name) dlsym(library, name)
int main(int n, char **arguments)
{{
    void *library = dlopen(arguments[n - 1], RTLD_NOW);
    if (library == NULL) return 1;
    Callbacks callbacks = {{NULL, calloc, free, NULL, NULL}};
    void *(*make)(const char *, int, const char *, const char *, Callbacks *, int, int) = GET("fmi2Instantiate");
    int (*setup)(void *, int, double, double, int, double) = GET("fmi2SetupExperiment");
    int (*enter)(void *) = GET("fmi2EnterInitializationMode"), (*leave)(void *) = GET("fmi2ExitInitializationMode");
    int (*step)(void *, double, double, int) = GET("fmi2DoStep");
    void *one = make("one", 1, "{guid}", NULL, &callbacks, 0, 0);
    if (one == NULL || setup(one, 0, 0.0, 0.0, 0, 0.0) || enter(one) || leave(one)) return 2;
    int worst = 0;
    for (int k = 0; k < 50; k++) worst = step(one, k * 0.02, 0.02, 1) > 1 ? 3 : worst;
    puts("stepped");
    return worst;
}}
"""
    )
    compiler = shutil.which("cc") or shutil.which("gcc") or "clang"
    bare = tmp_path / "bare"
    bare.mkdir()
    subprocess.run([compiler, driver, "-o", bare / "driver", "-ldl"], check=True)
    shutil.copy(library, bare / "team.so")
    run = subprocess.run(
        ["./driver", "./team.so"], cwd=bare, env={"PATH": ""}, capture_output=True, text=True, check=False
    )
    assert (run.returncode, run.stdout) == (0, "stepped\n")


def test_the_c_is_readable_and_compiles_without_warnings(made: Callable[..., Made], tmp_path: Path) -> None:
    from plants.factory.compile import compile_library, find_compiler
    from plants.factory.platforms import host

    fmpy.extract(made("mixed_team").fmus[0], tmp_path)
    sources = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.glob("sources/*.c"))
    assert compile_library(find_compiler(), host(), tmp_path, sources, "team", ("-Werror", "-Wshadow", "-O1"))
    text = (tmp_path / "sources/model.c").read_text()
    assert "/* car_1.tau_drive [N.m] */" in text
    assert "/* Sense */" in text


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = str(ROOT / "scenarios/mixed_team.xml")
    assert main(["export-controller", scenario, "--only", "reference", "--out", str(tmp_path)]) == 0
    assert capsys.readouterr().out.split() == [str(tmp_path / "mixed_team_reference.fmu")]
    assert (tmp_path / "mixed_team_reference.fmu").is_file()
    said = failed(capsys, 2, "export-controller", scenario, "--only", "nobody", "--out", str(tmp_path))
    assert "no follower has the controller 'nobody'; there are pid, reference" in said


@pytest.mark.skipif(os.environ.get("CI") is None and shutil.which("zig") is None, reason="takes long")
def test_binaries_of_other_platforms(made: Callable[..., Made], tmp_path: Path) -> None:
    pytest.importorskip("ziglang")
    own = made("convoy")
    fmu = build_team_fmu(own.scenario, own.setup, "pid", tmp_path, fmi="3.0", platforms="all")
    import zipfile

    names = zipfile.ZipFile(fmu).namelist()
    assert sum(name.startswith("binaries/") for name in names) >= 4


# Laws in Python ------------------------------------------------------------------------------------------------------

posix = pytest.mark.skipif(sys.platform == "win32", reason="such an FMU starts its law on Linux and macOS only")
PID = re.compile("<controller.*</controller>", re.DOTALL)


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an environment with laws in free Python: the example of the documentation, and one that can fail."""
    laws = tmp_path_factory.mktemp("laws")
    distribution(laws, "look-ahead-controller", "0.1.0", ["look-ahead = look_ahead:LookAhead"])
    distribution(laws, "faulty-laws", "1.2", ["faulty = faulty_laws:Faulty"], FAULTY)
    folder = tmp_path_factory.mktemp("environments") / "own"
    return environment(folder, CONTROLLERS, laws, ROOT / "examples/own_controller")


def with_law(made_of: str, folder: Path, change: Callable[[str], str], fmi: str = "2.0", cleanup: Any = None) -> Made:
    """Build the FMUs of a scenario with another controller."""
    file = folder / f"{made_of}.xml"
    file.write_text(change((ROOT / f"scenarios/{made_of}.xml").read_text(encoding="utf-8")), encoding="utf-8")
    return make_fmus(read_scenario(file).edited(expectations=False), cleanup, folder, fmi)


def look_ahead(folder: Path, gains: str = "") -> Callable[[str], str]:
    law = (
        '<controller id="pid" name="look-ahead" package="look-ahead-controller" version="~=0.1.0" '
        f'environment="{folder}">{gains}</controller>'
    )
    return lambda text: PID.sub(law, text)


@pytest.fixture(scope="module")
def faults(elsewhere: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return a scenario whose law does what its gain says."""
    law = (
        f'<controller id="pid" name="faulty" package="faulty-laws" version="==1.2" environment="{elsewhere}" '
        'time_limit="0.3 s"/>'
    )
    with ExitStack() as cleanup:
        folder = tmp_path_factory.mktemp("faults")
        yield with_law("clmr_line", folder, lambda text: PID.sub(law, text), cleanup=cleanup)


@posix
def test_a_torque_besides_the_laws_takes_the_sign_from_a_zero_of_every_follower(tmp_path: Path) -> None:
    text = FAULTY.replace("-0.1 * pose[:, 3]", "np.full(len(pose), -0.0)")
    distribution(tmp_path / "laws", "faulty-laws", "1.2", ["faulty = faulty_laws:Faulty"], text)
    where = environment(tmp_path / "own", CONTROLLERS, tmp_path / "laws")
    law = f'<controller id="pid" name="faulty" package="faulty-laws" version="==1.2" environment="{where}"/>'
    place = '<desired range="3 m" bearing="45 deg"/>'
    push = f'{place}<input name="tau_drive"><constant value="1 N.m"/></input>'
    for inputs in (place, push):
        with ExitStack() as cleanup:
            folder = tmp_path / str(inputs == push)
            folder.mkdir()
            own = with_law(
                "clmr_line", folder, lambda text, new=inputs: PID.sub(law, text).replace(place, new, 1), cleanup=cleanup
            )
            result = closed_loop(own, slaves(own, folder), folder, 3)
            assert compare(result, reference(own.scenario, 3), own.setup)
            assert np.all(np.signbit(result["follower_4.tau_steer"]) == (inputs == place))


def hosts_in(folder: Path) -> list[str]:
    """Return the processes that run the host of an FMU in a folder; those that are about to end get a moment."""
    for _ in range(100):
        found = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True).stdout
        mine = [line for line in found.splitlines() if f"{folder}/" in line and "/law.json" in line]
        if not mine:
            break
        time.sleep(0.02)
    return mine


@posix
def test_laws_in_python_have_the_bits_of_our_own_run(elsewhere: Path, tmp_path: Path) -> None:
    def inside(text: str) -> str:  # compiled laws, one of them of two teams
        return text.replace("<controller ", f'<controller environment="{elsewhere}" ')

    changes = {"mixed_team": ("2.0", inside), "formation_change": ("3.0", look_ahead(elsewhere))}
    for name, (fmi, change) in changes.items():
        with ExitStack() as cleanup:
            own = with_law(name, tmp_path, change, fmi, cleanup)
            assert [validate_fmu(str(fmu)) for fmu in own.fmus] == [[]] * len(own.fmus)
            description = fmpy.read_model_description(own.fmus[0]).coSimulation
            assert description.needsExecutionTool
            assert not description.canGetAndSetFMUstate
            result = closed_loop(own, slaves(own, tmp_path / name), tmp_path / name, TICKS)
            assert compare(result, reference(own.scenario), own.setup) > 5 * len(own.setup.followers)
            assert hosts_in(tmp_path) == []


@posix
def test_a_law_of_this_environment_that_is_not_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from formation_controllers.neural_adaptive_pid import NeuralAdaptivePid

    monkeypatch.setattr(NeuralAdaptivePid, "compiled_tick", lambda self: None)
    with ExitStack() as cleanup:
        own = with_law("convoy", tmp_path, str, "3.0", cleanup)
        assert fmpy.read_model_description(own.fmus[0]).coSimulation.needsExecutionTool
        result = closed_loop(own, slaves(own, tmp_path), tmp_path, 40)
        compare(result, reference(own.scenario, 40), own.setup)


@posix
def test_gains_of_a_law_in_python_and_inputs_that_change_within_a_tick(
    elsewhere: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with ExitStack() as cleanup:
        own = with_law("formation_change", tmp_path, look_ahead(elsewhere), cleanup=cleanup)
        (tmp_path / "stiff").mkdir()
        stiff = with_law(
            "formation_change",
            tmp_path / "stiff",
            look_ahead(elsewhere, '<gain name="K" value="25 30"/>'),
            cleanup=cleanup,
        )
        followers = [robot.name for robot in own.setup.followers]
        by_parameter, by_scenario = Slave(own.fmus[0], tmp_path / "a", "a"), Slave(stiff.fmus[0], tmp_path / "b", "b")
        by_parameter.set({f"{name}.K[{k}]": gain for name in followers for k, gain in ((1, 25.0), (2, 30.0))})
        inputs = [v.name for v in by_parameter.variables.values() if v.causality == "input"]
        outputs = [v.name for v in by_parameter.variables.values() if v.causality == "output"]
        starts = np.array([float(by_parameter.variables[name].start) for name in inputs])
        for slave in (by_parameter, by_scenario):
            slave.begin()
        by_parameter.get(outputs)  # a tick that another one takes the place of
        for slave in (by_parameter, by_scenario):
            slave.fmu.exitInitializationMode()
        for tick in range(30):
            values = starts + 0.01 * tick * np.cos(np.arange(len(inputs)))
            for _ in range(tick % 3):
                by_parameter.set(dict(zip(inputs, values + 0.3, strict=True)))
                by_parameter.get(outputs)
            for slave in (by_parameter, by_scenario):
                slave.set(dict(zip(inputs, values, strict=True)))
            assert by_parameter.get(outputs) == by_scenario.get(outputs)
            for slave in (by_parameter, by_scenario):
                slave.step(0.02 * tick, 0.02)
        with pytest.raises(fmpy.fmi1.FMICallException):
            by_parameter.fmu.getFMUstate()
        assert "states of this FMU cannot be saved: the description says so" in capfd.readouterr().out
        by_parameter.fmu.reset()
        by_scenario.fmu.freeInstance()
        by_parameter.start()  # once more, from the start
        assert by_parameter.get(outputs)
        by_parameter.close()
        assert hosts_in(tmp_path) == []


@posix
@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (1, " did not complete the tick within 0.3 s; its process was ended at time 0.2 s"),
        (2, " did not complete the tick: its process crashed (signal 11) at time 0.2 s"),
        (3, " did not complete the tick: its process exited with status 7 at time 0.2 s"),
        (4, " failed: SystemExit: enough, at "),
        (6, " failed: follower_2, too near at time 0.2 s"),
        (8, " failed: follower_1, the torque is not finite, at count = 10.0 1"),
        (13, " did not complete the tick: it closed its connection; its process was ended at time 0.2 s"),
        (20, " did not complete the tick: its process exited with status 4 at time 0 s"),
    ],
)
def test_a_law_in_python_that_fails_is_named(
    faults: Made, tmp_path: Path, capfd: pytest.CaptureFixture[str], fault: int, message: str
) -> None:
    (team,) = slaves(faults, tmp_path / "a place %41")
    team.set({f"{robot.name}.fault": fault for robot in faults.setup.followers})
    team.start()

    def run() -> None:
        for tick in range(20):
            team.step(0.02 * tick, 0.02)

    with pytest.raises(fmpy.fmi1.FMICallException):
        run()
    team.fmu.freeInstance()
    assert f"the controller 'faulty' of faulty-laws 1.2{message}" in capfd.readouterr().out
    assert hosts_in(tmp_path) == []


PROGRAM = """
import sys
from pathlib import Path
from tests.team_loop import Slave

log = open(sys.executable, "rb")  # it has the descriptor of standard error if there is none
team = Slave(Path(sys.argv[1]), Path(sys.argv[2]), "team")
team.set({name: float(sys.argv[3]) for name in team.variables if name.endswith(".fault")})
team.start()
for tick in range(3):
    team.step(0.02 * tick, 0.02)
print(*team.get([name for name, of in team.variables.items() if of.causality == "output"]))
team.close()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the system ends the process with the master's main thread")
def test_a_law_at_work_ends_with_a_master_that_is_killed(faults: Made, tmp_path: Path) -> None:
    command = [sys.executable, "-c", PROGRAM, str(faults.fmus[0]), str(tmp_path), "21"]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as master:
        assert master.stderr is not None
        assert master.stderr.readline() == "at work\n"
        master.kill()
    assert hosts_in(tmp_path) == []


@posix
def test_a_master_without_standard_streams(faults: Made, tmp_path: Path) -> None:
    """Such as one that a service manager has started."""
    found = []
    for streams in ("", "2>&-", "<&- 2>&-"):
        folder = tmp_path / f"run_{len(found)}"
        command = ["sh", "-c", f'exec "$@" {streams}', "sh", sys.executable, "-c", PROGRAM, str(faults.fmus[0])]
        found.append(
            subprocess.run([*command, str(folder), "0"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
        )
    assert found[0]
    assert found == [found[0]] * 3


@posix
def test_a_python_that_will_not_do(
    faults: Made, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tmp_path / "other"
    distribution(tmp_path / "laws", "faulty-laws", "1.3", ["faulty = faulty_laws:Faulty"], FAULTY)
    environment(other, CONTROLLERS, tmp_path / "laws")
    without = environment(tmp_path / "without", CONTROLLERS)
    sentences = {
        tmp_path
        / "nowhere/python": "nowhere/python cannot be started (No such file or directory); FORMATION_LAW_PYTHON",
        Path("/bin/true"): "did not start: its process exited with status 0",
        other / "bin/python": "other/bin/python has that of faulty-laws 1.3",
        without / "bin/python": "is not installed in the environment of",
    }
    for number, (python, sentence) in enumerate(sentences.items()):
        monkeypatch.setenv("FORMATION_LAW_PYTHON", str(python))
        team = Slave(faults.fmus[0], tmp_path / f"x{number}", "team")
        with pytest.raises(fmpy.fmi1.FMICallException):
            team.start()
        team.fmu.freeInstance()
        assert sentence in capfd.readouterr().out


@posix
def test_no_binary_for_windows_where_a_law_stays_python(faults: Made, tmp_path: Path) -> None:
    pytest.importorskip("ziglang")
    with pytest.raises(InputError, match="it can do on Linux and macOS only"):
        build_team_fmu(faults.scenario, faults.setup, "pid", tmp_path, platforms="windows-x86_64")
