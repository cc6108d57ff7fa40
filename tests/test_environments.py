"""Controllers in environments of their own: the same bits, several versions in a scenario, faults that are told."""

import json
import os
import pickle
import select
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import formation_controllers
import numba
import numpy as np
import pytest
import xarray as xr
from formation_controllers.controller import Controller

import cosim
import plants
from cosim.cli import main
from cosim.control import host, host_process, new_environment
from cosim.control.environment import environment_at
from cosim.control.hosts import Host
from cosim.control.law import Law
from cosim.errors import InputError, OutputError, SimulationError
from cosim.master.setup import set_up
from cosim.master.simulation import Simulation
from cosim.plant import bells, protocol
from cosim.studies.conduct import check_study, conduct
from cosim.studies.reader import read_study
from cosim.tests.studies import write_study
from cosim.unforeseen import status_of

from .commands import command, failed
from .environments import CONTROLLERS, FAULTY, ROOT, distribution, environment, packages_of

SHORT = ("--horizon", "0.6 s", "--no-expectations", "--no-figure", "--no-report")
LINE = ROOT / "scenarios" / "clmr_line.xml"


@pytest.fixture(scope="module")
def laws(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the module of a law, as a distribution."""
    folder = tmp_path_factory.mktemp("laws")
    distribution(
        folder, "faulty-laws", "1.2", ["faulty = faulty_laws:Faulty", "compiled = faulty_laws:Compiled"], FAULTY
    )
    return folder


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory, laws: Path) -> Path:
    """Return an environment with the controllers of the tree, and that law."""
    return environment(tmp_path_factory.mktemp("environments") / "own", CONTROLLERS, laws)


def written(path: Path, *controllers: str, of: Path = LINE, assigned: tuple[str, ...] = ()) -> Path:
    """Write a scenario with other controllers, the first of which all followers have but those assigned in order."""
    text = of.read_text(encoding="utf-8")
    begin, end = text.index("<controller"), text.rindex("</controller>") + len("</controller>")
    text = text[:begin] + "\n".join(controllers) + text[end:]
    for number, name in enumerate(assigned, start=1):
        before, follower, after = text.partition(f'<follower id="follower_{number}"')
        text = before + follower + after.replace('controller="pid"', f'controller="{name}"', 1)
    path.write_text(text, encoding="utf-8")
    return path


def faulty(environment: Path, fault: int = 0, more: str = "") -> str:
    package = 'package="faulty-laws" version="~=1.2"'
    gain = f'<gain name="fault" value="{fault}"/>'
    return f'<controller id="pid" name="faulty" {package} environment="{environment}" {more}>{gain}</controller>'


def inside(text: str, environment: Path) -> str:
    return text.replace("<controller ", f'<controller environment="{environment}" ')


def same(one: xr.Dataset, other: xr.Dataset) -> None:
    assert one.data_vars.keys() == other.data_vars.keys()
    for name in one.data_vars:
        assert np.array_equal(one[name].values, other[name].values, equal_nan=True), name


def nothing_left(folder: Path) -> bool:
    """Return whether no process runs an interpreter of an environment any more."""
    until = time.monotonic() + 5
    while time.monotonic() < until:
        found = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True).stdout
        if str(folder) not in found:
            return True
        time.sleep(0.05)
    return False


# The same numbers ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["clmr_line", "mixed_team", "convoy"])
def test_a_law_in_an_environment_gives_the_same_bits(own: Path, tmp_path: Path, name: str) -> None:
    file = ROOT / "scenarios" / f"{name}.xml"
    copy = tmp_path / f"{name}.xml"
    copy.write_text(inside(file.read_text(encoding="utf-8"), own), encoding="utf-8")
    short: dict[str, Any] = {"horizon": 4.0, "expectations": False}
    same(cosim.run(copy, **short), cosim.run(file, **short))
    assert nothing_left(own)


def test_the_segments_stay_compiled_and_a_tick_by_hand_gives_the_same(own: Path, tmp_path: Path) -> None:
    scenario = cosim.read_scenario(written(tmp_path / "line.xml", faulty(own))).edited(horizon=1.0, expectations=False)
    with Simulation(scenario) as simulation:
        simulation.step()
        assert simulation._ticks.some(20)
        simulation.run_to_end()
        at_once = simulation.result()
    with Simulation(scenario) as simulation:
        while not simulation.finished:
            simulation.step()
        same(simulation.result(), at_once)
    assert at_once["count"].values[:, 0].tolist() == list(range(51))
    assert at_once["pair"].sizes["pair_component"] == 2


def test_a_state_goes_on_in_another_host(own: Path, tmp_path: Path) -> None:
    scenario = cosim.read_scenario(written(tmp_path / "line.xml", faulty(own))).edited(horizon=1.0, expectations=False)
    with Simulation(scenario) as one, Simulation(scenario) as other:
        for _ in range(5):
            one.step()
        other.step()
        (team,), (its,) = one._teams, other._teams
        its.from_bytes(team.to_bytes(0.1), 0.1)
        assert its.to_bytes(0.1) == team.to_bytes(0.1)
        other.step()
        assert other.result()["count"].values[1].tolist() == [5.0] * 4
        with pytest.raises(SimulationError, match="the bytes are not a controller's state"):
            its.from_bytes(b"nothing", 0.1)


def test_a_run_of_a_law_in_an_environment_goes_on_to_the_same_results(
    own: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path / "line.xml", faulty(own))
    command(capsys, "run", file, "--out", tmp_path / "whole", *SHORT)
    command(capsys, "run", file, "--out", tmp_path, "--until", "0.3 s", *SHORT)
    left = tmp_path / "clmr_line"
    with monkeypatch.context() as patch:
        patch.setattr(Law, "environment", {"python": "3.11.1", "numpy": "1.0"})
        told = failed(capsys, 2, "resume", str(left), "--no-figure", "--no-report")
    assert f"the environment of the controller 'pid' had numpy {np.__version__} (here 1.0) when the checkpoint" in told
    command(capsys, "resume", left, "--no-figure", "--no-report")
    unbroken, resumed = (xr.load_dataset(folder / "result.nc") for folder in (tmp_path / "whole" / "clmr_line", left))
    assert unbroken["count"].values[:, 0].tolist() == list(range(31))
    same(unbroken, resumed)


def test_a_set_up_comes_back_without_its_processes(own: Path, tmp_path: Path) -> None:
    scenario = cosim.read_scenario(written(tmp_path / "line.xml", faulty(own))).edited(expectations=False)
    with ExitStack() as cleanup:
        setup = set_up(scenario, cleanup, {})
        other = pickle.loads(pickle.dumps(setup))
        cleanup.callback(other.hosts.stop)
        assert other.laws["pid"].signals == setup.laws["pid"].signals
        assert other.laws["pid"].host.gains("faulty", [("fault", 3.0)]) == (("fault", 3.0),)
    assert nothing_left(own)


def test_prepared_runs_share_a_host(own: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    says: list[int] = []  # by the host, when the memory of the run before is cleared for another one
    cleared = host.Board.__init__

    def clear(board: host.Board, *about: Any) -> None:
        cleared(board, *about)
        if board.asked[0]:
            says.append(int(board.asked[1]))

    monkeypatch.setattr(host.Board, "__init__", clear)
    scenario = cosim.read_scenario(written(tmp_path / "line.xml", inside(_controller_of(LINE), own))).edited(
        horizon=0.6, expectations=False
    )
    changes = ("//gain[@name='K_p']/@value=9", "simulation/@seed=7", "//gain[@name='K_p']/@value=9")
    with cosim.Prepared(scenario, "everything") as prepared:
        (host_of,) = prepared._setup.hosts._hosts.values()
        processes = []
        for change in changes:
            outcome = prepared.run([change])
            processes.append(host_of.process.number)
            alone = cosim.run(scenario.edited([change]))
            assert outcome.result is not None
            same(outcome.result.dataset, alone[list(outcome.result.dataset.data_vars)])
    assert len(set(processes)) == 1
    assert set(says) == {host.BY_PIPE}  # it does not look there any more
    assert nothing_left(own)


def test_a_run_after_one_that_has_ended_the_host_has_a_new_one(own: Path, tmp_path: Path) -> None:
    scenario = cosim.read_scenario(written(tmp_path / "line.xml", faulty(own))).edited(horizon=0.4, expectations=False)
    with cosim.Prepared(scenario) as prepared:
        statuses = [prepared.run([f"//gain/@value={fault}"]).status for fault in (0, 3, 0, 9, 0)]
    assert statuses == ["completed", "failed", "completed", "failed", "completed"]


def _controller_of(file: Path) -> str:
    text = file.read_text(encoding="utf-8")
    return text[text.index("<controller") : text.index("</controller>") + len("</controller>")]


# Two versions -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def versions(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return environments with a release 0.1 of the controllers, of the tree, and 0.2, a copy with one law changed."""
    folder = tmp_path_factory.mktemp("versions")
    copy = folder / "copy"
    shutil.copytree(CONTROLLERS, copy, ignore=shutil.ignore_patterns("__pycache__", "tests", "benchmarks", "dist"))
    law, project = copy / "formation_controllers" / "feedback_linearisation.py", copy / "pyproject.toml"
    _replace(law, "torque[i, 0], torque[i, 1] = tau_1, tau_2", "torque[i, 0], torque[i, 1] = 0.9 * tau_1, tau_2")
    _replace(project, 'version = "0.1.0"', 'version = "0.2.0"')
    found = {}
    for version, source in (("0.1.0", CONTROLLERS), ("0.2.0", copy)):
        build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
        subprocess.run(build, cwd=source, check=True, capture_output=True)
        (wheel,) = folder.glob(f"formation_controllers-{version}-*.whl")
        assert main(["env", "create", str(folder / version), str(wheel), "--share"]) == 0
        found[version] = folder / version
    return found


def _replace(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")


def test_two_versions_in_one_scenario(
    versions: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    start = host_process.start

    def plain(command: Any, variables: dict[str, str], *about: Any) -> Any:
        return start(command, {**variables, "NUMBA_DISABLE_JIT": "1"}, *about)

    monkeypatch.setattr(host_process, "start", plain)  # nothing is compiled for a test

    def law(name: str, version: str) -> str:
        about = f'name="feedback-linearisation" package="formation-controllers" version="=={version}"'
        return f'<controller id="{name}" {about} environment="{versions[version]}"/>'.replace("/>", "></controller>")

    old, new = law("pid", "0.1.0"), law("other", "0.2.0")
    files = {
        "mixed": written(tmp_path / "mixed.xml", old, new, assigned=("pid", "other", "pid", "other")),
        "old": written(tmp_path / "old.xml", old),
        "new": written(tmp_path / "new.xml", law("pid", "0.2.0")),
    }
    for name, file in files.items():  # each with its own name, as by a user
        _replace(file, 'name="clmr_line"', f'name="{name}"')
    command(capsys, "run", *files.values(), "--out", tmp_path, *SHORT)
    results = {name: xr.load_dataset(tmp_path / name / "result.nc", engine="h5netcdf") for name in files}
    for row, alone in enumerate(("old", "new", "old", "new")):
        for variable in ("pose", "velocity", "torque", "measured_pose", "range_rate"):
            here, there = results["mixed"][variable][:, row], results[alone][variable][:, row]
            assert np.array_equal(here.values, there.values, equal_nan=True), (row, variable)
    assert not np.array_equal(results["old"]["pose"].values, results["new"]["pose"].values)
    told = [(one["version"], one["robots"]) for one in json.loads(results["mixed"].attrs["controllers"])]
    assert told == [("0.1.0", ["follower_1", "follower_3"]), ("0.2.0", ["follower_2", "follower_4"])]
    assert json.loads(results["mixed"].attrs["controllers"])[1]["environment"]["formation-controllers"] == "0.2.0"
    page = tmp_path / "compared.html"
    command(capsys, "report", tmp_path / "old", tmp_path / "new", "--out", page)
    assert all(f'"version": "{v}"' in page.read_text() or f'"version":"{v}"' in page.read_text() for v in versions)
    option = ("--environment", f"pid={versions['0.2.0']}")
    command(capsys, "run", files["old"], *option, "--out", tmp_path / "changed", *SHORT)
    changed = xr.load_dataset(tmp_path / "changed" / "old" / "result.nc", engine="h5netcdf")
    assert np.array_equal(changed["pose"].values, results["new"]["pose"].values)
    assert json.loads(changed.attrs["controllers"])[0]["version"] == "0.2.0"
    printed, _ = command(capsys, "check", files["mixed"])
    assert "0.2.0" in printed
    assert str(versions["0.2.0"]) in printed.replace("\n", "")


def test_an_environment_is_made_whole_or_not_at_all(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    there = tmp_path / "there"
    said = failed(capsys, 2, "env", "create", str(there), "formation-controllers==99", "--wheels", str(tmp_path))
    assert "formation-controllers==99" in said
    assert not there.exists()
    (there / "file").mkdir(parents=True)
    assert "is there already" in failed(capsys, 2, "env", "create", str(there), "some-laws")
    assert "there is no such wheel or folder" in failed(capsys, 2, "env", "create", str(tmp_path / "x"), "no.whl")
    assert "name a package" in failed(capsys, 2, "env", "create", str(tmp_path / "x"))
    assert "is no project" in failed(capsys, 2, "env", "create", str(tmp_path / "x"), str(there))
    assert "--share is of formation env create" in failed(capsys, 2, "env", "list", str(there), "--share")


def wheel(folder: Path, name: str) -> Path:
    """Write a wheel with an empty module."""
    path, about = folder / f"{name}-1.0-py3-none-any.whl", f"{name}-1.0.dist-info"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr(f"{name}.py", "")
        for place, text in (
            ("METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n"),
            ("WHEEL", "Wheel-Version: 1.0\nGenerator: a test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"),
            ("RECORD", ""),
        ):
            file.writestr(f"{about}/{place}", text)
    return path


@pytest.fixture(params=["uv", "pip"])
def installer(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Let environments be made by uv, if it is there, and by pip."""
    if request.param == "uv" and shutil.which("uv") is None:
        pytest.skip("uv is not installed")
    if request.param == "pip":
        monkeypatch.setattr(new_environment.shutil, "which", lambda name: None)
    return str(request.param)


def test_an_environment_that_cannot_be_used_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], installer: str
) -> None:
    """Not the folders above it either; a folder that was there stays, empty."""
    said = failed(capsys, 2, "env", "create", str(tmp_path / "not" / "yet"), str(wheel(tmp_path, "plain")))
    assert "it lacks formation-controllers, which every controller needs" in said
    assert "name a package that needs formation-controllers, or formation-controllers besides, or" in said
    assert not (tmp_path / "not").exists()
    (tmp_path / "empty").mkdir()
    (tmp_path / "bad-1.0-py3-none-any.whl").write_text("no wheel")
    said = failed(capsys, 2, "env", "create", str(tmp_path / "empty"), str(tmp_path / "bad-1.0-py3-none-any.whl"))
    assert "empty cannot be completed: " in said
    assert "bad-1.0-py3-none-any.whl" in said
    assert list((tmp_path / "empty").iterdir()) == []


@pytest.mark.parametrize("place", ["file/new", "loop/new", "above/" + "n" * 300])
def test_an_environment_where_no_folder_can_be_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], installer: str, place: str
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "loop").symlink_to("loop")
    said = failed(capsys, 2, "env", "create", str(tmp_path / place), "some-laws")
    assert f"{tmp_path / place} cannot be made: " in said
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "loop"]


def test_an_environment_of_a_wheel_is_made(tmp_path: Path, capsys: pytest.CaptureFixture[str], installer: str) -> None:
    printed, _ = command(capsys, "env", "create", tmp_path / "e", wheel(tmp_path, "plain"), "--share")
    assert "neural-adaptive-pid" in printed
    assert list(packages_of(tmp_path / "e").glob("plain.py"))


def test_an_installer_that_fills_the_disk_is_told_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    uv = tmp_path / "uv"
    uv.write_text("#!/bin/sh\necho 'error: it failed\n  cause: No space left on device (os error 28)' >&2\nexit 2\n")
    uv.chmod(0o755)
    monkeypatch.setattr(new_environment.shutil, "which", lambda name: str(uv))
    with pytest.raises(OutputError, match="No space left on device") as told:
        new_environment.create(tmp_path / "new", ["some-laws"], check=print)
    assert status_of(told.value) == 71
    assert not (tmp_path / "new").exists()


def test_the_words_of_an_installer_are_told_without_labels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = "Resolving...\nerror: it failed\n  Caused by: no answer\n  cause: no route\nError: no folder"
    pip = ["sh", "-c", f"echo '{words}' >&2; exit 2"]
    monkeypatch.setattr(new_environment, "_make", lambda *given: pip)
    with pytest.raises(InputError, match=r"new cannot be made: it failed; no answer; no route; no folder$"):
        new_environment.create(tmp_path / "new", ["some-laws"], check=print)


def test_a_shared_environment_has_the_controllers_that_are_installed_for_editing(tmp_path: Path) -> None:
    there = environment(tmp_path / "there")
    new_environment._share(there)
    (packages_of(there) / "found.pth").unlink()
    its = Host(environment_at(there))
    try:
        assert "neural-adaptive-pid" in its.installed()
    finally:
        its.stop()


# Faults -------------------------------------------------------------------------------------------------------------

WHO = "follower_1 and follower_2 and follower_3 and follower_4 at t = 0.2 s: the controller 'faulty' of faulty-laws 1.2"


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        (1, "did not complete the tick within 2 s; its process was ended"),
        (2, "did not complete the tick: its process crashed (SIGSEGV)"),
        (3, "did not complete the tick: its process exited with status 7"),
        (4, "failed: SystemExit: enough"),
        (7, "did not complete the tick: its process answers with bytes that are no reply"),
        (9, "failed: ZeroDivisionError: integer division or modulo by zero"),
    ],
)
def test_a_law_that_misbehaves_is_named(
    own: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], fault: int, sentence: str
) -> None:
    file = written(tmp_path / "line.xml", faulty(own, fault, 'time_limit="2 s"'))
    said = failed(capsys, 3, "run", str(file), "--out", str(tmp_path), *SHORT)
    assert f"{WHO} in the environment {own} {sentence}" in said
    result = xr.load_dataset(tmp_path / "clmr_line" / "result.nc", engine="h5netcdf")
    assert result["count"].values[:, 0].tolist() == list(range(10))
    assert nothing_left(own)


def test_a_compiled_law_that_raises_is_named_with_its_line(
    own: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of two teams in one host, whose ticks compiled code runs one after the other, the second one fails."""
    whole, part = faulty(own), faulty(own, 9)
    first = whole.replace('id="pid" name="faulty"', 'id="first" name="compiled"')
    file = written(tmp_path / "line.xml", first, part.replace('name="faulty"', 'name="compiled"'), assigned=("first",))
    said = failed(capsys, 3, "run", str(file), "--out", str(tmp_path), *SHORT)
    line = FAULTY[: FAULTY.index("a number is wrong")].count("\n") + 1
    assert "follower_2 and follower_3 and follower_4 at t = 0.2 s: the controller 'compiled' of faulty-laws 1.2" in said
    assert "failed: ValueError: a number is wrong" in said
    assert f"faulty_laws.py:{line}" in said
    kept = xr.load_dataset(tmp_path / "clmr_line" / "result.nc", engine="h5netcdf")
    expected = cosim.run(written(tmp_path / "python.xml", whole), horizon=0.18, expectations=False)
    assert np.array_equal(kept["pose"].values, expected["pose"].values)
    assert nothing_left(own)


def test_beside_a_supervised_plant(own: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fmu = tmp_path / "robot.fmu"
    shutil.copyfile(plants.build("car_like"), fmu)
    for name, fault, status in (("whole", 0, 0), ("failed", 3, 3)):
        file = written(tmp_path / f"{name}.xml", faulty(own, fault))
        _replace(file, 'name="clmr_line"', f'name="{name}"')
        _, said = command(capsys, "run", file, "--plant", f"clmr={fmu}", "--out", tmp_path, *SHORT, status=status)
        assert status == 0 or f"{WHO} in the environment {own} did not complete the tick: its process exited" in said
        assert nothing_left(own)
    whole, part = (xr.load_dataset(tmp_path / name / "result.nc", engine="h5netcdf") for name in ("whole", "failed"))
    alone = cosim.run(written(tmp_path / "alone.xml", faulty(own)), horizon=0.6, expectations=False)
    assert np.array_equal(whole["pose"].values, alone["pose"].values)
    assert np.array_equal(part["pose"].values, alone["pose"].values[:10])


def test_a_law_beside_a_supervised_plant_prints_in_its_own_name(
    own: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    fmu = tmp_path / "robot.fmu"
    shutil.copyfile(plants.build("car_like"), fmu)
    file = written(tmp_path / "line.xml", faulty(own, 5, 'time_limit="60 s"'))
    assert main(["run", str(file), "--plant", f"clmr={fmu}", "--out", str(tmp_path), *SHORT]) == 0
    lines = [(record.name, record.getMessage()) for record in caplog.records]
    assert lines[0] == ("cosim.controller", f"controllers in {own}: line 0")
    assert lines[-1][1] == f"controllers in {own} prints more than 1000 lines; the others are not shown"
    assert len(lines) == 1001


def test_a_law_names_its_robot(own: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for fault, said in ((6, "failed: too near"), (8, "failed: the torque is not finite, at count = ")):
        file = written(tmp_path / "line.xml", faulty(own, fault))
        robot = "follower_2" if fault == 6 else "follower_1"
        printed = failed(capsys, 3, "run", str(file), "--out", str(tmp_path), *SHORT)
        assert f"{robot} at t = 0.2 s: the controller 'faulty'" in printed
        assert said in printed


def test_a_law_may_print_and_take_its_time(
    own: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    for fault in (5, 10):  # the second takes longer than compiled code waits
        file = written(tmp_path / "line.xml", faulty(own, fault, 'time_limit="60 s"'))
        command(capsys, "run", file, "--out", tmp_path, *SHORT)
    lines = [record.getMessage() for record in caplog.records if record.name == "cosim.controller"]
    assert lines[0] == f"controllers in {own}: line 0"
    assert lines[-1] == f"controllers in {own} prints more than 1000 lines; the others are not shown"
    assert len(lines) == 1001
    result = xr.load_dataset(tmp_path / "clmr_line" / "result.nc", engine="h5netcdf")
    assert result["count"].values[:, 0].tolist() == list(range(31))


def test_a_law_that_ends_its_process_at_the_start(
    own: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path / "line.xml", faulty(own, 20))
    printed = failed(capsys, 3, "run", str(file), "--out", str(tmp_path), *SHORT)
    assert "at t = 0 s: the controller 'faulty'" in printed
    assert "its process exited with status 4" in printed


def test_a_law_that_hangs_is_interrupted(own: Path, tmp_path: Path) -> None:
    file = written(tmp_path / "line.xml", faulty(own, 1, 'time_limit="100 s"'))
    run = [sys.executable, "-m", "cosim", "run", str(file), "--out", str(tmp_path), *SHORT]
    with subprocess.Popen(run, stderr=subprocess.PIPE, text=True, start_new_session=True) as process:
        children = _until(lambda: _hosts(own), 60)
        time.sleep(3)  # it hangs by then, or Ctrl-C ends it before
        for _ in range(2):
            os.kill(process.pid, signal.SIGINT)
            time.sleep(0.3)
        _, printed = process.communicate(timeout=30)
    assert process.returncode == 130, printed
    assert children
    assert nothing_left(own)


def test_a_host_ends_with_a_harness_that_is_killed(own: Path, tmp_path: Path) -> None:
    file = written(tmp_path / "line.xml", faulty(own, 1, 'time_limit="100 s"'))
    run = [sys.executable, "-m", "cosim", "run", str(file), "--out", str(tmp_path), *SHORT]
    with subprocess.Popen(run, stderr=subprocess.DEVNULL, start_new_session=True) as process:
        assert _until(lambda: _hosts(own), 60)
        process.kill()
    assert nothing_left(own)


def _hosts(folder: Path) -> list[str]:
    found = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True).stdout
    return [line for line in found.splitlines() if line.startswith(str(folder))]


def _until(look: Callable[[], Any], seconds: float) -> Any:
    until = time.monotonic() + seconds
    while not (found := look()) and time.monotonic() < until:
        time.sleep(0.05)
    return found


# Environments that will not do --------------------------------------------------------------------------------------


def refused(scenario: Path) -> str:
    with pytest.raises(InputError) as caught:
        cosim.run(scenario, horizon=0.2, expectations=False)
    assert caught.value.where is not None
    assert caught.value.where.file == str(scenario)
    assert caught.value.where.line > 1
    return caught.value.message


def test_folders_that_are_no_environments(tmp_path: Path) -> None:
    file, there = tmp_path / "line.xml", tmp_path / "there"
    assert "there is no such folder" in refused(written(file, faulty(there)))
    there.write_text("")
    assert "is a file" in refused(written(file, faulty(there)))
    there.unlink()
    there.mkdir()
    assert "is no virtual environment: it has no bin/python" in refused(written(file, faulty(there)))
    (there / "bin").mkdir()
    (there / "bin" / "python").symlink_to(tmp_path / "python3.99")
    assert f"is broken: its bin/python leads to {tmp_path / 'python3.99'}, which is not there" in refused(file)


@pytest.mark.parametrize(
    ("program", "sentence"),
    [
        ("#!/bin/sh\nexit 3\n", "did not start: its process exited with status 3"),
        ("#!/bin/sh\nkill -11 $$\n", "did not start: its process crashed (SIGSEGV)"),
        ("#!/bin/sh\nyes nonsense\n", "did not start: its process answers with bytes that are no reply"),
        ("#!/nowhere/sh\n", "cannot be started: No such file or directory"),
        ("nothing", "cannot be started: Exec format error"),
    ],
)
def test_a_python_that_is_none(tmp_path: Path, program: str, sentence: str) -> None:
    python = tmp_path / "environment" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(program)
    python.chmod(0o755)
    assert sentence in refused(written(tmp_path / "line.xml", faulty(python.parents[1])))


@pytest.mark.parametrize(
    "wrong",
    [
        {"gain_facts": "none"},
        {"gain_facts": {"K_p": 1}},
        {"signals": {"name": "a"}},
        {"signals": [{"name": "a", "unit": "m", "description": "b", "singular_below": 10**400}]},
        {"vehicles": 1},
        {"known": 1},
    ],
)
def test_a_host_that_tells_what_makes_no_sense(tmp_path: Path, wrong: dict[str, Any]) -> None:
    law = {"package": "a", "version": "1", "interface": "1.0", "vehicles": [], "needs": [], "signals": []}
    bodies = [json.dumps(told).encode() for told in ({"python": "3.11"}, law | {"gain_facts": {}} | wrong)]
    python = tmp_path / "environment" / "bin" / "python"
    python.parent.mkdir(parents=True)
    reply = tmp_path / "reply"
    reply.write_bytes(b"".join(host.HEADER.pack(host.DONE, len(body)) + body for body in bodies))
    python.write_text(f'#!/bin/sh\nprintf %s "$7"; cat "{reply}"; exec sleep 60\n')
    python.chmod(0o755)
    sentence = "did not describe the controller 'faulty': its process answers with bytes that are no reply"
    assert sentence in refused(written(tmp_path / "line.xml", faulty(python.parents[1])))


@pytest.mark.parametrize(
    ("interface", "sentence"),
    [
        (None, "it lacks formation-controllers, which every controller needs"),
        (
            'INTERFACE_VERSION = "2.0"',
            "speak version 2.0 of the controllers' interface, and versions 1.x are spoken here",
        ),
        ("import nowhere", "its formation-controllers cannot be imported: No module named 'nowhere'"),
        ("import sys; sys.exit(5)", "did not start: its process exited with status 1"),
    ],
)
def test_an_environment_without_the_controllers(tmp_path: Path, interface: str | None, sentence: str) -> None:
    there = tmp_path / "environment"
    environment(there)
    packages = packages_of(there)
    (packages / "found.pth").unlink()
    if interface is not None:
        (packages / "formation_controllers").mkdir()
        (packages / "formation_controllers" / "__init__.py").write_text("")
        (packages / "formation_controllers" / "interface.py").write_text(interface)
    assert sentence in refused(written(tmp_path / "line.xml", faulty(there)))


def test_an_older_python_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "version_info", (3, 9, 2))
    assert host._greeting()["fault"] == "it has Python 3.9.2, and controllers need 3.11 or newer"


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('name="faulty"', 'name="fualty"', "offers a controller 'fualty': did you mean 'faulty'?"),
        ("~=1.2", "~=1.3", "needs faulty-laws ~=1.3, but version 1.2 is installed in the environment"),
        ("faulty-laws", "other-laws", "is installed in the environment"),
        ('value="0"', 'value="-1"', "controller 'pid': gain 'fault' is -1: must be at least 0"),
        ('name="fault"', 'name="faults"', "unknown gain 'faults'; did you mean 'fault'?"),
    ],
)
def test_a_controller_that_is_not_there(own: Path, tmp_path: Path, old: str, new: str, sentence: str) -> None:
    text = faulty(own)
    assert old in text
    assert sentence in refused(written(tmp_path / "line.xml", text.replace(old, new, 1)))


@pytest.mark.parametrize(
    ("module", "sentence"),
    [
        ("import os; os._exit(9)", "did not describe the controller 'own': its process exited with status 9"),
        ("import time; time.sleep(100)", "did not describe the controller 'own' within 2 s; its process was ended"),
        ("1 // 0", "cannot be imported: integer division or modulo by zero, at "),
        ("import sys; sys.exit('no licence')", "'own' of own-laws 1.0 cannot be imported: SystemExit: no licence, at "),
        ("Law = 3", "is 3: expected a subclass of Controller"),
    ],
)
def test_a_module_that_fails(
    own: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, laws: Path, module: str, sentence: str
) -> None:
    if "sleep" in module:  # the others may need longer on a busy machine
        monkeypatch.setattr(host_process, "START_LIMIT", 2.0)
    distribution(tmp_path / "laws", "own-laws", "1.0", ["own = own_laws:Law"], module)
    there = environment(tmp_path / "environment", CONTROLLERS, tmp_path / "laws")
    text = faulty(there).replace("faulty-laws", "own-laws").replace("~=1.2", "~=1.0").replace('"faulty"', '"own"')
    assert sentence in refused(written(tmp_path / "line.xml", text))


def test_a_law_that_exits_when_it_is_made(tmp_path: Path) -> None:
    text = FAULTY.replace("def state_shapes(self):", "def state_shapes(self):\n        sys.exit('no licence')")
    distribution(tmp_path / "laws", "faulty-laws", "1.2", ["faulty = faulty_laws:Faulty"], text)
    there = environment(tmp_path / "environment", CONTROLLERS, tmp_path / "laws")
    said = refused(written(tmp_path / "line.xml", faulty(there)))
    assert f"controller 'pid': SystemExit: no licence, at {tmp_path / 'laws' / 'faulty_laws.py'}:" in said


def test_a_vehicle_that_a_law_does_not_serve(own: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = ROOT / "scenarios" / "tractor_trailer_circle.xml"
    text = scenario.read_text(encoding="utf-8")
    name = text.partition('<controller id="')[2].partition('"')[0]
    file = written(tmp_path / "circle.xml", faulty(own).replace('id="pid"', f'id="{name}"'), of=scenario)
    sentence = "the controller 'faulty' serves vehicles of kind car_like, not tractor_trailer"
    assert sentence in refused(file)
    assert sentence in failed(capsys, 2, "check", str(file))


def test_a_time_limit_needs_an_environment(tmp_path: Path) -> None:
    text = _controller_of(LINE).replace("<controller ", '<controller time_limit="1 s" ')
    assert "time_limit of a <controller> is for one with an environment" in refused(written(tmp_path / "l.xml", text))


def test_a_law_of_an_interface_without_records(monkeypatch: pytest.MonkeyPatch) -> None:
    """Release 1.0 had neither a telemetry record nor an error of commands that are not finite."""
    law = formation_controllers.load("lqg")
    size = host.telemetry_type(law.signals).itemsize // 8
    shapes = [host.shapes_of(2, 4, 2, 2, size)]
    about = {
        "gains": [[]],
        "shared": True,
        "vehicle": host.stated(formation_controllers.CarLike(1.2)),
        "size": 2,
        "period": 0.02,
        "accelerates": False,
    }
    found = []
    for old in (False, True):
        numbers = np.zeros(sum(int(np.prod(shape)) for shape in shapes[0]))
        (arrays,) = host.parts_of(numbers, shapes)
        arrays[0][:] = [[-5.0, 0.0, 0.0, 0.0], [-5.0, 5.0, 0.0, 0.0]]
        arrays[5][:] = [3.0, 0.1]
        team = host._Team(law, about, arrays)
        if old:
            for name in ("telemetry_record", "not_finite"):
                monkeypatch.delattr(Controller, name)
        team.tick(host.FIRST)
        found.append(arrays[9].copy())
        arrays[8][1] = np.nan
        assert host.row_of(team.not_finite()) == 1
    assert np.isfinite(found[0]).any()
    assert np.array_equal(*found, equal_nan=True)


# Ticks by compiled code ----------------------------------------------------------------------------------------------


@numba.njit
def _doubled(inputs: Any, own: Any, commands: Any) -> None:
    if inputs[0] < 0:
        raise ValueError("below zero")
    own[0] += 1
    commands[0] = 2 * inputs[0]


def test_compiled_code_serves_ticks_as_long_as_they_come() -> None:
    compiled = host._compile(host._core())
    if compiled is None:
        pytest.skip("nothing is compiled here")
    board = host.Board(bytearray(host.board_size(6)), 6)
    board.answered[1], board.current[0] = host.BY_PIPE, -1
    counts, work = np.zeros((2, 1)), []
    for inputs, commands, telemetry, count in zip(*board.numbers.reshape(3, 2, 1), counts, strict=True):
        given = inputs, count, commands
        _doubled.compile(tuple(map(numba.typeof, given)))
        address = host._address_of(_doubled, given)
        assert address is not None
        work.append((address, telemetry.ctypes.data, count.ctypes.data, 8, *given))
    seen = board.asked[:1].copy()
    serve = compiled.serving(board, seen, tuple(work))

    assert serve(10) == host._NOTHING
    board.numbers[:2], board.asked[0] = [3, 4], 1
    assert serve(10) == host._BY_PIPE
    assert board.numbers.tolist() == [3, 4, 6, 8, 1, 1]
    board.answered[1], board.numbers[:2], board.asked[0] = host.AWAKE, [5, 6], 2
    assert serve(10) == host._NOTHING
    assert board.numbers.tolist() == [5, 6, 10, 12, 2, 2]
    assert (board.answered[0], board.current[0], board.tells[0]) == (2, -1, 0)
    board.told[0], board.asked[0] = host.FIRST, 3
    assert serve(10) == host._BY_PYTHON
    assert counts.tolist() == [[2], [2]]

    board.told[0], board.numbers[1], board.asked[0] = host.AS_COMPILED, -1, 4
    with pytest.raises(ValueError, match="below zero"):
        serve(10)
    assert board.current[0] == 1  # who was at work
    assert board.answered[0] == 2  # Python says what has failed, and answers
    assert seen[0] == 4


def test_a_late_ring_wakes_nobody_who_waits_for_the_next_one() -> None:
    """Whoever rings may lose its core before it looks whether the other side sleeps."""
    compiled = host._compile(None)
    if compiled is None:
        pytest.skip("nothing is compiled here")
    place = np.array([4, host.ASLEEP + 4 * 5])  # the other side has found number 5 meanwhile, and waits for another
    assert compiled.ring(place.ctypes.data) == 0
    assert place.tolist() == [5, host.ASLEEP + 4 * 5]
    assert compiled.ring(place.ctypes.data) == 1
    assert place.tolist() == [6, host.AWAKE]

    ends, ringing = os.pipe()
    bell, answered = np.zeros(1, bells.BELL), np.zeros(2, dtype=np.int64)
    try:
        bells.fill(bell, (ringing, ends), (place, answered), bells.STEP)
        for says, rung in ((host.ASLEEP + 4 * 7, 0), (host.ASLEEP + 4 * 7, bells.SIZE)):
            place[1] = says
            bells.ring(bell, np.zeros((0, 3), np.int64), 0.0, 0.0)
            found = select.select([ends], [], [], 0)[0]
            assert len(os.read(ends, 64) if found else b"") == rung
    finally:
        os.close(ends)
        os.close(ringing)


# Words that both sides share ----------------------------------------------------------------------------------------


def test_both_sides_speak_the_same() -> None:
    assert [int(request) for request in host_process.Request] == [
        getattr(host, request.name) for request in host_process.Request
    ]
    assert tuple(protocol.Reply) == (host.DONE, host.FAILED)
    assert host.HEADER.format == protocol.HEADER.format
    assert (host.AWAKE, host.ASLEEP, host.BY_PIPE, host.SAYS) == (bells.AWAKE, bells.ASLEEP, bells.BY_PIPE, bells.SAYS)
    assert int(host.STEP) == protocol.Request.STEP


def test_the_host_starts_with_the_standard_library_alone() -> None:
    folder = str(Path(host.__file__).parent)
    program = f"import sys; sys.path.insert(0, {folder!r}); import host; print('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-I", "-S", "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


# Studies ------------------------------------------------------------------------------------------------------------


def test_a_study_of_a_law_in_an_environment_has_the_same_rows(own: Path, tmp_path: Path) -> None:
    rows = []
    for name, of, workers in (("beside", None, 0), ("here", own, 0), ("workers", own, 2)):
        folder = tmp_path / name
        folder.mkdir()
        study = write_study(folder)
        if of is not None:
            base = folder / "base.xml"
            base.write_text(inside(base.read_text("utf-8"), of), "utf-8")
        rows.append(conduct(read_study(study), folder, workers=workers).rows)
    beside, *others = ([(row.status, row.values, row.measures, row.margins) for row in found] for found in rows)
    assert len(beside) == 6
    assert others == [beside, beside]
    assert nothing_left(own)


def test_another_version_in_an_environment_that_a_value_names_makes_its_runs_anew(
    own: Path, laws: Path, tmp_path: Path
) -> None:
    (tmp_path / "laws").mkdir()
    other = environment(tmp_path / "other", CONTROLLERS, tmp_path / "laws")
    vary = f'<vary name="env" select="controller/@environment"><list values="{own}, {other}"/></vary>'
    path = write_study(tmp_path, vary, '<sample method="grid"/>')
    about = f'<controller id="pid" name="faulty" package="faulty-laws" version="&gt;=1" environment="{own}"/>'
    written(tmp_path / "base.xml", about, of=tmp_path / "base.xml")
    keys = []
    for version in ("1.2", "1.3", "1.2"):
        shutil.rmtree(tmp_path / "laws")
        distribution(tmp_path / "laws", "faulty-laws", version, ["faulty = faulty_laws:Faulty"], FAULTY)
        study = read_study(path)
        plan, of_runs, _ = check_study(study)
        keys.append([of_runs.of(run) for run in plan])
    assert keys[0] == keys[2]
    assert keys[0][0] == keys[1][0]
    assert len({key for found in keys for key in found}) == 3


@pytest.mark.parametrize(("fault", "broken"), [(11, 0), (12, 2)])
def test_a_run_of_a_study_whose_host_is_killed_is_made_once_more(
    own: Path, laws: Path, tmp_path: Path, fault: int, broken: int
) -> None:
    study = write_study(tmp_path, sample='<sample method="random" runs="2"/>')
    base = tmp_path / "base.xml"
    base.write_text(base.read_text("utf-8").replace('horizon="0.2 s"', 'horizon="0.3 s"'), "utf-8")
    written(base, faulty(own, fault), of=base)
    rows = conduct(read_study(study), tmp_path, workers=0).rows
    assert [row.status for row in rows].count("broken") == broken
    assert all("its process crashed (SIGKILL)" in row.message for row in rows if row.status == "broken")
    assert (laws / "faulty_laws.py.killed").exists() is (fault == 11)
    (laws / "faulty_laws.py.killed").unlink(missing_ok=True)
    assert nothing_left(own)
