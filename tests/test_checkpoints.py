"""Runs that are left and taken up again: the same bits, a note of it, and a sentence for whatever does not fit."""

import copy
import errno
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import cosim
from cosim.cli import main, resuming
from cosim.cli.earlier_results import CHECKPOINTS_BEFORE
from cosim.errors import OutputError
from cosim.export.log import log_of
from cosim.master import checkpoint_file, checkpoints
from cosim.master.branch import check_branch
from cosim.master.checkpoint_file import CheckpointFile, write_checkpoint
from cosim.master.checkpoint_folder import FOLDER, HeldFolder, name_of, ticks_in
from cosim.master.checkpoints import Checkpoints
from cosim.master.loop import Part as PartOfTick
from cosim.master.observer import Observer
from cosim.master.ticks import Ticks
from cosim.plant.process import PlantProcess
from cosim.report import content
from cosim.report.content import content_of
from cosim.results.files import load
from cosim.results.provenance import Part, Provenance
from cosim.results.result import Result
from cosim.scenario.scenario import Scenario
from cosim.tests.driving import scenario
from tests.checkpoint_kills import Bench, differences
from tests.commands import command, failed
from tests.stub.stub import make_fmu

PLANT = '<plant id="car" model="car_like"/>'
NOISE = '<sensor><noise x="2 mm" psi="0.1 deg"/><dropout probability="0.3"/><delay time="40 ms"/></sensor>'
EVENT = '<event at="0.7 s" robots="follower_1"><parameter name="m_c" value="30 kg"/></event>'
EXPECT = '<expect><peak signal="pose" component="x" below="1 km"/></expect>'
MORE = f"{EVENT}{EXPECT}"
LEAST = ("--no-figure", "--no-report")


def write(path: Path, plants: str = PLANT, more: str = MORE, **about: str) -> Path:
    """Write a scenario with noise, dropouts, a delay and an event."""
    made = scenario(path, plants, more=more, **about)
    text = made.read_text(encoding="utf-8")
    made.write_text(text.replace("<actuator>", f"{NOISE}<actuator>"), encoding="utf-8")
    return made


@pytest.fixture(scope="module")
def built_in(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the scenario of built-in plants."""
    return write(tmp_path_factory.mktemp("scenario") / "cars.xml")


@pytest.fixture(scope="module")
def whole(built_in: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of its run in one piece."""
    out = tmp_path_factory.mktemp("whole")
    assert main(["run", str(built_in), "--out", str(out), *LEAST]) == 0
    return out / "cars"


@pytest.fixture(scope="module")
def ten(built_in: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run that was left at 0.5 s, with one more checkpoint before that."""
    out = tmp_path_factory.mktemp("left")
    assert main(["run", str(built_in), "--out", str(out), "--until", "0.2 s", *LEAST]) == 0
    assert main(["resume", str(out / "cars"), "--until", "0.5 s", *LEAST]) == 0
    return out / "cars"


@pytest.fixture
def left(ten: Path, tmp_path: Path) -> Path:
    """Return a copy of it."""
    return shutil.copytree(ten, tmp_path / "runs" / "cars")


# The same bits ----------------------------------------------------------------------------------------------


def test_a_run_that_was_left_goes_on_to_the_same_files(
    left: Path, whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    attributes = load(left / "result.nc").attrs
    assert attributes["status"] == "incomplete"
    assert json.loads(attributes["failure"])["message"] == "left as asked"
    printed, _ = command(capsys, "resume", left, *LEAST)
    assert "resumed at 0.2 s and at 0.5 s" in printed
    assert not list(differences(whole, left, tmp_path))
    parts = json.loads((left / "summary.json").read_text())["parts"]
    assert [part["until"] for part in parts] == [0.2, 0.5]
    told = failed(capsys, 2, "resume", str(left), *LEAST)
    assert f"the run in {left} has reached its end at 1 s: --at TIME goes on from an earlier moment" in told


def test_status_and_words_of_a_run_that_is_left(
    built_in: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    junit = tmp_path / "verdicts.xml"
    printed, errors = command(capsys, "run", built_in, "--out", tmp_path, "--until", "0.3 s", "--junit", junit, *LEAST)
    assert "left at 0.3 s of 1 s, as asked; nothing is judged yet" in printed
    assert f"formation resume {tmp_path / 'cars'} goes on from 0.3 s" in printed
    assert "ended early" not in errors
    assert '<skipped message="left as asked at t = 0.3 s"/>' in junit.read_text()
    printed, _ = command(capsys, "show", tmp_path / "cars")
    assert "left as asked at t = 0.3 s: nothing is judged yet" in printed


def test_a_resumed_run_ends_with_the_status_of_its_verdicts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path / "low.xml", more=EXPECT.replace("1 km", "1 mm"))
    command(capsys, "run", path, "--out", tmp_path, "--until", "0.3 s", *LEAST)
    command(capsys, "resume", tmp_path / "low", *LEAST, status=1)


@pytest.mark.parametrize("isolate", ["", ' isolate="process"'], ids=["supervised", "isolated"])
def test_a_run_of_a_foreign_fmu_that_is_killed_goes_on_to_the_same_files(tmp_path: Path, isolate: str) -> None:
    fmu = make_fmu(tmp_path / "fmus", name="car", save=True, end_stop=0.2, time_event=True)
    event = EVENT.replace("m_c", "when").replace("30 kg", "0.9 s")
    path = write(tmp_path / "foreign.xml", f'<plant id="car" fmu="{fmu}"{isolate}/>', more=event)
    bench = Bench(path, tmp_path / "bench")
    assert not list(bench.killed_at(31, after=0.01))


def test_a_run_of_built_in_plants_that_is_killed_goes_on_to_the_same_files(built_in: Path, tmp_path: Path) -> None:
    bench = Bench(built_in, tmp_path / "bench")
    for tick in (1, 34, 49):
        assert not list(bench.killed_at(tick, after=0.0))


def test_what_an_fmu_logs_of_being_saved_is_no_part_of_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fmu = make_fmu(tmp_path, name="car", save=True, behaviour="log_odd", when=0.4)
    path = write(tmp_path / "talks.xml", f'<plant id="car" fmu="{fmu}"/>', more="")
    command(capsys, "run", path, "--out", tmp_path / "whole", *LEAST)
    command(capsys, "run", path, "--out", tmp_path / "parts", "--until", "0.6 s", *LEAST)
    command(capsys, "resume", tmp_path / "parts" / "talks", *LEAST)
    assert not list(differences(tmp_path / "whole" / "talks", tmp_path / "parts" / "talks", tmp_path))


def test_an_interrupted_run_says_how_it_goes_on(built_in: Path, whole: Path, tmp_path: Path) -> None:
    run = ["run", str(built_in), "--out", str(tmp_path), "--checkpoint", "every=0.1s", "--pace", "0.1", *LEAST]
    process = subprocess.Popen([sys.executable, "-m", "cosim", *run], stdout=subprocess.PIPE, text=True)
    give_up = time.monotonic() + 60.0
    while not any(ticks_in(tmp_path / "cars" / FOLDER)):
        assert time.monotonic() < give_up
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    printed, _ = process.communicate(timeout=60.0)
    assert process.returncode == 130
    assert f"formation resume {tmp_path / 'cars'} goes on from 0." in printed
    assert main(["resume", str(tmp_path / "cars"), *LEAST]) == 0
    assert not list(differences(whole, tmp_path / "cars", tmp_path))


def test_an_interruption_within_a_tick_leaves_no_checkpoint_there(
    built_in: Path, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The plants have made a step of which the rest of the run knows nothing."""
    original = Ticks._do

    def twice(self: Ticks, parts: PartOfTick, tick: int) -> None:
        if tick == 34 and parts == PartOfTick.LEAD:
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
        original(self, parts, tick)

    with monkeypatch.context() as patches:
        patches.setattr(Ticks, "_do", twice)
        patches.setattr(Ticks, "some", lambda *_: False)
        failed(capsys, 130, "run", str(built_in), "--out", str(tmp_path), "--checkpoint", "every=0.1s", *LEAST)
    assert max(ticks_in(tmp_path / "cars" / FOLDER)) < 34
    command(capsys, "resume", tmp_path / "cars", *LEAST)
    assert not list(differences(whole, tmp_path / "cars", tmp_path))


@pytest.mark.parametrize("go", ["save", "fork"])
def test_a_run_that_was_interrupted_while_it_was_saved_cannot_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, go: str
) -> None:
    """The answer of a plant's process, which nobody has waited for, would be taken for the next one."""
    fmu = make_fmu(tmp_path / "fmus", name="car", save=True)
    path = write(tmp_path / "foreign.xml", f'<plant id="car" fmu="{fmu}" isolate="process"/>', more="")
    original = PlantProcess._receive

    def pressed(self: PlantProcess, failed: str) -> Any:
        signal.raise_signal(signal.SIGINT)
        return original(self, failed)

    with cosim.Simulation(cosim.read_scenario(path)) as simulation:
        for _ in range(2):
            simulation.step()
        save = simulation.fork if go == "fork" else partial(simulation.save, tmp_path / "a.checkpoint")
        with monkeypatch.context() as patches:
            patches.setattr(PlantProcess, "_receive", pressed)
            with pytest.raises(KeyboardInterrupt):
                save()
        with pytest.raises(cosim.InputError, match="cannot go on: it was interrupted while its state was saved"):
            simulation.step()


class Stops(Observer):
    """An observer that is interrupted, some times at once."""

    def __init__(self, times: int) -> None:
        self._times = times

    def ticked(self, tick: int) -> None:
        """Stop the second tick."""
        for _ in range(self._times if tick == 1 else 0):
            signal.raise_signal(signal.SIGINT)


def step_by_step(simulation: cosim.Simulation) -> None:
    while not simulation.finished:
        simulation.step()


@pytest.mark.parametrize(("go", "times"), [(cosim.Simulation.run, 2), (step_by_step, 1)], ids=["whole", "steps"])
def test_a_run_that_was_interrupted_within_a_tick_cannot_go_on(
    built_in: Path, tmp_path: Path, go: Callable[[cosim.Simulation], object], times: int
) -> None:
    """The first signal waits for the end of a tick of a whole run, but not of a step that a program makes."""
    with cosim.Simulation(cosim.read_scenario(built_in), observers=[Stops(times)]) as simulation:
        with pytest.raises(KeyboardInterrupt):
            go(simulation)
        assert simulation.result().sizes["time"] == 2
        told = "the run cannot {}: its last tick is not complete"
        with pytest.raises(cosim.InputError, match=told.format("go on")):
            simulation.step()
        with pytest.raises(cosim.InputError, match=told.format("be saved")):
            simulation.save(tmp_path / "a.checkpoint")


def test_a_run_without_changes_goes_on_in_its_own_folder(left: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = failed(capsys, 2, "resume", str(left), "--out", str(left.with_name("other")), *LEAST)
    assert "a run without changes goes on in its own folder" in told
    assert load(left / "result.nc").sizes["time"] == 25


# How often --------------------------------------------------------------------------------------------------


class Clock:
    """A clock that a test turns."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        """Return the time [s]."""
        return self.now

    def go_on(self, seconds: float) -> None:
        """Turn it."""
        self.now += seconds


class Slow:
    """A run whose checkpoints cost what a test says; each tick records a million bytes."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, taking: float, writing: float, per_tick: float) -> None:
        self.clock, self.written = Clock(), list[int]()
        self._writing, self._per_tick = writing, per_tick
        monkeypatch.setattr(checkpoints.time, "perf_counter", self.clock)
        monkeypatch.setattr(checkpoints.time, "thread_time", lambda: 0.0)
        monkeypatch.setattr(checkpoints, "Snapshot", self)
        self.checkpoints = Checkpoints(Path(), None, every=10)  # type: ignore[arg-type]
        self._take = partial(self.clock.go_on, taking)
        self.tick = 0
        self.checkpoints.try_out(self._take, self)  # type: ignore[arg-type]
        self.checkpoints.finish()
        self.written = []

    def numbers(self, first: int, last: int) -> list[np.ndarray[Any, Any]]:
        return [np.zeros((last - first, 125_000))]

    def of(self, origin: None, state: None, recorder: None, first: int, *_: object, every: int = 0) -> Any:
        """Return a snapshot of the ticks from one on."""
        tick, size = self.tick, (self.tick - first) * 1_000_000

        def write(path: Path) -> None:
            self.clock.go_on(self._writing)
            self.written.append(tick)

        return SimpleNamespace(tick=tick, arrays={"": np.broadcast_to(np.zeros(1, "u1"), size)}, write=write)

    def run(self, ticks: int) -> list[int]:
        """Run; return the ticks of the checkpoints."""
        while self.tick < ticks:
            assert not self.checkpoints.reach(self.tick, self._take, self)  # type: ignore[arg-type]
            self.checkpoints.finish()
            stop = min(self.checkpoints.next_stop(self.tick, ticks), self.tick + 1)
            self.clock.go_on((stop - self.tick) * self._per_tick)
            self.tick = stop
        return self.written


@pytest.mark.parametrize(
    ("taking", "writing", "per_tick", "expected"),
    [
        (0.0, 0.0, 0.055, [20, 40, 60, 80]),  # a second lies between two
        (0.0, 0.19, 0.5, [10, 20, 30, 40, 50, 60, 70, 80, 90]),  # 0.19 s to write, 4.75 s
        (0.0, 0.3, 0.5, [20, 40, 60, 80]),  # 0.3 s to write, that of the start, too, 7.5 s
        (0.3, 0.0, 0.5, [20, 40, 60, 80]),  # the same to take, also before the first one
        (0.0, 9.0, 1.0, [60]),  # a minute at most
        (0.0, 0.0, 0.02, []),  # a megabyte takes a millisecond, until another number is known: 5 % of 20 ms
    ],
)
def test_a_checkpoint_that_would_cost_too_much_is_left_out(
    monkeypatch: pytest.MonkeyPatch, taking: float, writing: float, per_tick: float, expected: list[int]
) -> None:
    assert Slow(monkeypatch, taking, writing, per_tick).run(100) == expected


def test_a_run_does_not_stop_for_a_checkpoint_that_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Slow(monkeypatch, 0.0, 0.0, 0.1)
    assert run.checkpoints.next_stop(0, 100) == 101
    assert not run.run(8)
    assert run.checkpoints.next_stop(8, 100) == 101
    run.clock.go_on(0.3)
    assert run.checkpoints.next_stop(8, 100) == 10


def test_a_run_that_is_too_short_for_checkpoints_has_one_at_its_start(
    built_in: Path, whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command(capsys, "run", built_in, "--out", tmp_path, "--checkpoint", "every=0.1s", *LEAST)
    place = tmp_path / "cars"
    assert ticks_in(place / FOLDER)[0] == 0
    (place / "result.nc").unlink()  # as if it had been killed
    shutil.copytree(place, tmp_path / "killed")
    command(capsys, "resume", tmp_path / "killed", *LEAST)
    assert not list(differences(whole, tmp_path / "killed", tmp_path))
    for path in (place / FOLDER).glob("*[1-9]*.checkpoint"):
        path.unlink()
    _, errors = command(capsys, "resume", place, "--at", "0.4 s", "--set", "simulation/@seed=2", *LEAST)
    assert "running from 0 s to 0.4 s, where there is no checkpoint" in errors
    branch = next(tmp_path.glob("cars+*"))
    assert ticks_in(branch / FOLDER)[0] == 20
    command(capsys, "resume", branch, "--at", "0.5 s", "--set", "simulation/@seed=3", *LEAST)
    command(capsys, "resume", place, "--at", "0 s", "--set", "simulation/@seed=4", *LEAST)
    (branch / FOLDER / name_of(0)).unlink(missing_ok=True)
    said = failed(capsys, 2, "resume", str(branch), "--at", "0 s", "--set", "simulation/@seed=4", *LEAST)
    assert f"branched off from {place} at 0.4 s" in said


def test_the_loop_does_not_wait_for_the_records_of_a_branch(monkeypatch: pytest.MonkeyPatch) -> None:
    run, go_on = Slow(monkeypatch, 0.0, 0.0, 1.0), threading.Event()
    snapshot = SimpleNamespace(tick=5, arrays={}, write=lambda path: go_on.wait())
    monkeypatch.setattr(run, "of", lambda *_, **__: snapshot)
    run.checkpoints.before = ""
    run.checkpoints.try_out(run._take, run)  # type: ignore[arg-type]
    assert run.checkpoints.next_stop(0, 100) == 101
    assert not run.checkpoints.reach(10, run._take, run)  # type: ignore[arg-type]
    go_on.set()
    run.checkpoints.finish()


def test_records_are_read_piece_by_piece_and_forgotten(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    numbers, forgotten = np.arange(1000.0).reshape(100, 10), list[int]()
    write_checkpoint(tmp_path / "file", {}, {"records/0": numbers})
    monkeypatch.setattr(checkpoint_file, "_AT_ONCE", 1500)
    monkeypatch.setattr(checkpoint_file, "forget", lambda: forgotten.append(1))
    found = CheckpointFile(tmp_path / "file").array("records/0")
    assert np.array_equal(found, numbers)
    assert len(forgotten) == 6


def test_moments_that_are_near_have_names_and_commands_of_their_own() -> None:
    found = [SimpleNamespace(time=time, scenario=SimpleNamespace(changes=())) for time in (12345.68, 12345.72)]
    changed = SimpleNamespace(changes=("--seed 2",))
    options = SimpleNamespace(folder=Path("runs/line"), out=None)
    names = [resuming._place(options, one, changed).name for one in found]  # type: ignore[arg-type]
    assert names == ["line+at=12345.68s+seed=2", "line+at=12345.72s+seed=2"]
    told = Provenance("line.xml", ("--seed 2",), parts=(Part(12345.72, (), "", "runs/line"),))
    assert content._command(told, "line") == "formation resume runs/line --at '12345.72 s' --seed 2"


# Branches ---------------------------------------------------------------------------------------------------


@pytest.fixture
def two_teams(short_line: Scenario) -> Iterator[cosim.Simulation]:
    """Return a run at 0.2 s whose four followers are controlled by a and b, which are the same but in name."""

    def shared_out(root: Any) -> None:
        (first,) = root.findall("controller")
        first.addnext(second := copy.deepcopy(first))
        for name, law in zip("ab", (first, second), strict=True):
            law.set("id", name)
        for name, follower in zip("aabb", root.findall("follower"), strict=True):
            follower.set("controller", name)

    with cosim.Simulation(short_line.edited([shared_out])) as simulation:
        while simulation.tick < 10:
            simulation.step()
        yield simulation


def test_a_branch_keeps_the_run_and_tells_of_both_parts(
    left: Path, whole: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command(capsys, "resume", left, *LEAST)
    before = (left / "result.nc").read_bytes()
    setting = "//follower[@id='follower_1']/desired/@range=3 m"
    printed, errors = command(capsys, "resume", left, "--at", "0.4 s", "--set", setting, *LEAST)
    place = next(path for path in left.parent.iterdir() if path != left)
    assert re.fullmatch(r"cars\+at=0\.4s\+follower_1\.desired\.range=3m-[0-9a-f]{8}", place.name)
    assert f"results in {place}/" in printed
    assert "running from 0.2 s to 0.4 s, where there is no checkpoint" in errors
    assert (left / "result.nc").read_bytes() == before
    unbroken, branch = load(whole / "result.nc"), load(place / "result.nc")
    for name in unbroken.data_vars:
        one, other = (np.asarray(result[name].isel(time=slice(0, 20))) for result in (unbroken, branch))
        assert one.tobytes() == other.tobytes(), name
    assert branch.desired_range.values[19, 0] != branch.desired_range.values[20, 0] == 3.0
    assert not np.array_equal(unbroken.pose[25:], branch.pose[25:])
    assert branch.attrs["status"] == "completed"
    parts = json.loads(branch.attrs["parts"])
    assert parts[-1]["until"] == 0.4
    assert parts[-1]["changes"] == []
    assert 'range="2 m"' in parts[-1]["scenario"]
    assert json.loads(branch.attrs["changes"]) == [f'--set "{setting}"']


def test_a_branch_of_a_run_that_was_only_left_once_has_its_first_checkpoint(
    built_in: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command(capsys, "run", built_in, "--out", tmp_path, "--until", "0.5 s", *LEAST)
    to = tmp_path / "heavy"
    setting = "//plant/parameter[@name='m_c']/@value=35 kg"
    command(capsys, "resume", tmp_path / "cars", "--set", setting, "--out", to, *LEAST)
    assert [path.name for path in (to / FOLDER).glob("*.checkpoint")] == ["0000000025.checkpoint"]
    command(capsys, "resume", to, "--at", "0.6 s", "--set", "simulation/@seed=5", *LEAST)


@pytest.mark.parametrize("more", [(), ("--set", "simulation/@seed=5")], ids=["itself", "another branch"])
@pytest.mark.parametrize("at", ["0 s", "0.4 s"])
def test_a_branch_does_not_go_on_from_before_its_own_moment(
    left: Path, tmp_path: Path, at: str, more: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    to = tmp_path / "heavy"
    setting = "//plant/parameter[@name='m_c']/@value=35 kg"
    command(capsys, "resume", left, "--set", setting, "--out", to, "--until", "0.8 s", *LEAST)
    before = {path: path.read_bytes() for path in to.rglob("*") if path.is_file()}
    said = failed(capsys, 2, "resume", str(to), "--at", at, *more, *LEAST)
    assert f"the run in {to} branched off from {left} at 0.5 s; expected a moment from then on" in said
    assert {path: path.read_bytes() for path in to.rglob("*") if path.is_file()} == before
    command(capsys, "resume", to, "--at", "0.6 s", *more, *LEAST)


def test_the_page_of_a_branch_says_how_to_repeat_it(
    left: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    heavy, other = tmp_path / "heavier cars", tmp_path / "seed"
    setting = "//plant/parameter[@name='m_c']/@value=35 kg"
    command(capsys, "resume", left, "--set", setting, "--out", heavy, "--until", "0.6 s", *LEAST)
    command(capsys, "resume", heavy, *LEAST)
    command(capsys, "resume", heavy, "--at", "0.7 s", "--set", "simulation/@seed=5", "--out", other, *LEAST)
    for place, start, change in (
        (heavy, f"{left} --at '0.5 s'", f'"{setting}"'),
        (other, f"'{heavy}' --at '0.7 s'", "simulation/@seed=5"),
    ):
        result = load(place / "result.nc")
        told = content_of(Result.of(result))["provenance"]["command"]
        assert told == f"formation resume {start} --set {change}"
        command(capsys, *shlex.split(told)[1:], "--out", tmp_path / "again", *LEAST)
        assert load(tmp_path / "again" / "result.nc").drop_attrs().identical(result.drop_attrs())


def test_a_parameter_that_a_branch_changes_changes_as_by_an_event(
    left: Path, built_in: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    to = tmp_path / "heavy"
    setting = "//plant/parameter[@name='m_c']/@value=35 kg"
    command(capsys, "resume", left, "--set", setting, "--out", to, *LEAST)
    other = write(tmp_path / "cars.xml", more=f"{EVENT.replace('0.7', '0.5').replace('30', '35')}{MORE}")
    other.write_text(other.read_text().replace('robots="follower_1"', 'robots="leader follower_1"', 1))
    result = cosim.run(other)
    branch = load(to / "result.nc")
    for name in ("pose", "leader_pose", "torque"):
        assert branch[name].values.tobytes() == result[name].values.tobytes()


def test_events_before_a_branch_are_told_as_they_were(built_in: Path) -> None:
    more = ("0.14 s", "0.6 s")  # the first branch is later, at 0.2 s; the second one is at 0.6 s

    def add(root: Any) -> None:
        (event,) = root.findall("event")
        for at in more:
            event.addprevious(other := copy.deepcopy(event))
            other.set("at", at)

    parameter = "event/parameter/@value="
    scenario = cosim.read_scenario(built_in).edited([add])
    with cosim.Simulation(scenario) as simulation:
        while simulation.tick < 5:
            simulation.step()
        with simulation.fork() as same:
            while same.tick < 10:
                same.step()
            with same.fork([f"{parameter}31 kg"]) as first:
                while first.tick < 30:
                    first.step()
                with first.fork([f"{parameter}32 kg"]) as second:
                    result = Result.of(second.run())
    expected = [(0.14, "m_c = 30 kg"), (0.6, "m_c = 32 kg"), (0.7, "m_c = 32 kg")]
    assert [(entry.time, entry.text) for entry in log_of(result)] == expected
    assert [(event["time"], event["text"]) for event in content_of(result)["events"]] == expected


def test_another_horizon(left: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command(capsys, "resume", left, "--horizon", "0.8 s", "--out", tmp_path / "shorter", *LEAST)
    assert load(tmp_path / "shorter" / "result.nc").sizes["time"] == 41
    for horizon, said in (
        ("1.4 s", "the end of a run cannot be put off from 1 s to 1.4 s in its course, because its FMUs were told"),
        ("0.4 s", "the run is at 0.5 s, which is after its new end at 0.4 s"),
    ):
        assert said in failed(capsys, 2, "resume", str(left), "--horizon", horizon, *LEAST)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("simulation/@step=10 ms", "the step cannot change in the course of a run: run the scenario from its start"),
        ("//controller/@name=neural-high-gain", "the controller of follower_1 cannot change in the course of a run"),
        ("//follower[1]/pose/@x=-9 m", "the initial pose of follower_1 cannot change in the course of a run"),
        ("leader/pose/@psi=1 deg", "the initial pose of leader cannot change in the course of a run"),
        ("//delay/@time=60 ms", "<delay> cannot be added or changed in the course of a run: it depends on earlier"),
        ("//parameter[@name='wheelbase']/@value=1 m", "has no parameter 'wheelbase'"),
        (
            "//plant/parameter[@name='a']/@value=1 m",
            "the parameter 'a' of car_like.fmu plays the role 'a' of the geometry",
        ),
    ],
)
def test_changes_that_cannot_be(left: Path, change: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    if "wheelbase" in change:
        change = "//plant/parameter[@name='wheelbase']/@value=1 m"
    assert said in failed(capsys, 2, "resume", str(left), "--set", change, *LEAST)
    assert sorted(path.name for path in left.parent.iterdir()) == ["cars"]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            ["follower[@id='follower_2']/@controller=b", "follower[@id='follower_3']/@controller=a"],
            "who shares a controller with follower_1",
        ),
        (["follower[@id='follower_2']/@controller=b"], "who shares a controller with follower_1"),
    ],
    ids=["exchanged", "moved"],
)
def test_a_branch_refuses_other_followers_for_a_controller(
    two_teams: cosim.Simulation, tmp_path: Path, changes: list[str], said: str
) -> None:
    two_teams.save(tmp_path / "checkpoint")
    for go_on in (two_teams.fork, partial(cosim.Simulation.load, tmp_path / "checkpoint")):
        with pytest.raises(cosim.InputError, match=f"^{said} cannot change in the course of a run"):
            go_on(changes)


def test_a_branch_may_exchange_controllers_of_whole_teams(two_teams: cosim.Simulation) -> None:
    controllers = [f"follower[{row}]/@controller={name}" for row, name in enumerate("bbaa", 1)]
    with two_teams.fork() as same, two_teams.fork(controllers) as exchanged:
        assert np.array_equal(same.run().pose, exchanged.run().pose)


def test_a_branch_refuses_another_trajectory(scenarios: Path) -> None:
    eight = cosim.read_scenario(scenarios / "figure_eight.xml").edited(expectations=False)
    check_branch(eight, eight.edited(horizon=10.0), 200)
    other = eight.edited(["leader/trajectory/waypoint[2]/@x=3.12 m"])
    with pytest.raises(cosim.InputError, match=r"^the leader's <trajectory> cannot change in the course of a run"):
        check_branch(eight, other, 200)


def test_a_branch_may_change_delays_that_the_run_remembers(short_line: Scenario) -> None:
    def delayed(*milliseconds: int) -> Callable[[Any], None]:
        def change(root: Any) -> None:
            for sensor in root.findall("sensor"):
                root.remove(sensor)
            for follower, delay in zip(root.findall("follower"), milliseconds, strict=True):
                for sensor in follower.findall("sensor"):
                    follower.remove(sensor)
                if delay:
                    sensor = follower.makeelement("sensor")
                    sensor.append(sensor.makeelement("delay", time=f"{delay} ms"))
                    follower.find("desired").addnext(sensor)

        return change

    with cosim.Simulation(short_line.edited([delayed(40, 80, 0, 0)])) as simulation:
        while simulation.tick < 20:
            simulation.step()
        for delays in ((60, 80, 20, 0), (0, 0, 0, 0)):
            with simulation.fork([delayed(*delays)]) as fork:
                result = fork.run()
            for row, delay in enumerate(delays):
                late = result.pose.values[20 - delay // 20 : 51 - delay // 20, row]
                assert np.array_equal(result.measured_pose.values[20:, row], late)
        for delays in ((40, 100, 0, 0), (40, 60, 0, 0)):
            with pytest.raises(cosim.InputError, match="<delay> cannot be added or changed"):
                simulation.fork([delayed(*delays)])


def test_a_branch_with_other_gains_has_another_linear_quadratic_design(tmp_path: Path) -> None:
    two = cosim.read_scenario(write(tmp_path / "two.xml", followers=("car", "car"), law="lqg", more=""))
    gain = "follower[2]/gain[@name='q_max']/@value="
    own = two.edited([f"{gain}1"])
    with cosim.Simulation(own) as simulation:
        while simulation.tick < 10:
            simulation.step()
        with simulation.fork([f"{gain}0.1"]) as other, simulation.fork([f"{gain}1.0"]) as same:
            torques = [one.run().torque.values for one in (simulation, same, other)]
    assert torques[0].tobytes() == torques[1].tobytes()
    assert np.array_equal(torques[0][:, 0], torques[2][:, 0])
    assert np.array_equal(torques[0][:10, 1], torques[2][:10, 1])
    assert not np.array_equal(torques[0][10, 1], torques[2][10, 1])


# Bad input --------------------------------------------------------------------------------------------------


def altered(path: Path, change: Callable[[dict[str, object]], None]) -> None:
    """Change the origin of a checkpoint, with a checksum that is right."""
    file = CheckpointFile(path)
    arrays = {name: file.array(name) for name in file.names}
    origin = json.loads(arrays["origin"].tobytes())
    change(origin)
    arrays["origin"] = np.frombuffer(json.dumps(origin).encode(), np.uint8)
    write_checkpoint(path, file.facts, arrays)


def test_a_folder_without_checkpoints(whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert f"there is no folder {tmp_path / 'no'}" in failed(capsys, 2, "resume", str(tmp_path / "no"))
    said = f"{whole} holds no checkpoint: formation run --checkpoint every=TIME writes some"
    assert said in failed(capsys, 2, "resume", str(whole))


@pytest.mark.parametrize("damage", ["cut", "empty", "flip", "append"])
def test_a_damaged_checkpoint_names_the_one_before(
    left: Path, whole: Path, damage: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    last = left / FOLDER / name_of(25)
    data = bytearray(last.read_bytes())
    if damage == "flip":
        data[len(data) // 2] ^= 4
    last.write_bytes({"cut": data[:-100], "empty": b"", "flip": data, "append": data + b"x"}[damage])
    told = failed(capsys, 2, "resume", str(left), *LEAST)
    assert str(last) in told
    assert "the one before is at 0.2 s: --at '0.2 s'" in told
    assert (left / "result.nc").exists()
    command(capsys, "resume", left, "--at", "0.2 s", *LEAST)
    assert not list(differences(whole, left, tmp_path))


def test_a_checkpoint_under_the_name_of_another(left: Path, capsys: pytest.CaptureFixture[str]) -> None:
    last = left / FOLDER / name_of(25)
    last.write_bytes((left / FOLDER / name_of(10)).read_bytes())
    assert f"the checkpoint {last} is damaged: it is one at 0.2 s" in failed(capsys, 2, "resume", str(left))


@pytest.mark.parametrize("every", [0, -1, "often", []])
def test_a_checkpoint_whose_facts_make_no_sense(left: Path, every: object, capsys: pytest.CaptureFixture[str]) -> None:
    last = left / FOLDER / name_of(25)
    file = CheckpointFile(last)
    write_checkpoint(last, file.facts | {"every": every}, {name: file.array(name) for name in file.names})
    assert f"the checkpoint {last} is damaged: " in failed(capsys, 2, "resume", str(left), *LEAST)


def test_every_flipped_bit_is_noticed(left: Path) -> None:
    path = left / FOLDER / name_of(10)
    data = path.read_bytes()
    random = np.random.default_rng(1)
    for place in random.integers(0, len(data), 60).tolist():
        flipped = bytearray(data)
        flipped[place] ^= 1 << int(random.integers(8))
        path.write_bytes(flipped)
        with pytest.raises(cosim.InputError, match=str(path)):
            CheckpointFile(path)


def test_another_format(left: Path, capsys: pytest.CaptureFixture[str]) -> None:
    last = left / FOLDER / name_of(25)
    last.write_bytes(last.read_bytes().replace(b"formation checkpoint 1", b"formation checkpoint 7", 1))
    assert f"{last} was written by another version of Formation" in failed(capsys, 2, "resume", str(left))


def test_other_versions(left: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def older(origin: dict) -> None:  # type: ignore[type-arg]
        origin["versions"]["numpy"] = "1.0"

    altered(left / FOLDER / name_of(25), older)
    told = failed(capsys, 2, "resume", str(left))
    assert f"was written with numpy 1.0 (here {np.__version__}): the run could not go on with the same bits" in told


def test_a_law_of_another_version(left: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def older(origin: dict) -> None:  # type: ignore[type-arg]
        origin["laws"]["law"][1] = "0.0.9"

    altered(left / FOLDER / name_of(25), older)
    told = failed(capsys, 2, "resume", str(left))
    assert "the controller 'law' comes from formation-controllers 0.1.0, in the checkpoint" in told
    assert "from formation-controllers 0.0.9: install that version" in told


def test_a_law_whose_files_were_edited_since(left: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def edited(origin: dict) -> None:  # type: ignore[type-arg]
        origin["laws"]["law"][2] = "0" * 64

    def untold(origin: dict) -> None:  # type: ignore[type-arg]
        del origin["laws"]["law"][2]

    altered(left / FOLDER / name_of(25), edited)
    told = failed(capsys, 2, "resume", str(left))
    assert "the files of formation-controllers, from which the controller 'law' comes, or those of" in told
    altered(left / FOLDER / name_of(25), untold)
    command(capsys, "resume", str(left))


def test_a_scenario_that_was_edited_since(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path / "cars.xml")
    command(capsys, "run", path, "--out", tmp_path, "--until", "0.3 s", *LEAST)
    path.write_text(path.read_text().replace("-2 m", "-2.5 m"))
    told = failed(capsys, 2, "resume", str(tmp_path / "cars"))
    assert f"{path} was edited since the checkpoint" in told
    assert load(tmp_path / "cars" / "result.nc").sizes["time"] == 15


def test_an_fmu_that_was_replaced_since(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fmu = make_fmu(tmp_path, name="car", save=True)
    path = write(tmp_path / "cars.xml", f'<plant id="car" fmu="{fmu}"/>', more="")
    command(capsys, "run", path, "--out", tmp_path, "--until", "0.3 s", *LEAST)
    os.replace(make_fmu(tmp_path / "other", name="car", save=True, fillers=3), fmu)
    told = failed(capsys, 2, "resume", str(tmp_path / "cars"))
    assert "the plant 'car' is not the one of the checkpoint" in told
    assert "the FMU car.fmu had the SHA-256 " in told
    assert load(tmp_path / "cars" / "result.nc").sizes["time"] == 15


@pytest.mark.parametrize("declared", [True, False])
def test_an_fmu_without_saved_states_is_refused_at_the_start(
    tmp_path: Path, declared: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    fmu = make_fmu(tmp_path, name="car", save=True) if declared else make_fmu(tmp_path, name="car")
    if declared:  # and does not do what its description says
        from tests.fmus import rewritten

        fmu = rewritten(make_fmu(tmp_path / "without", name="car"), tmp_path / "lies" / "car.fmu", _LIE)
    path = write(tmp_path / "cars.xml", f'<plant id="car" fmu="{fmu}"/>', more="")
    told = failed(capsys, 2, "run", str(path), "--out", str(tmp_path), "--checkpoint", "every=0.2s", *LEAST)
    said = "the plant car.fmu cannot save its state: " if declared else "the FMU car.fmu cannot save its state (its "
    assert f"leader: {said}" in told
    assert "it can be run again from the start up to any moment, with the same bits" in told
    assert not (tmp_path / "cars" / FOLDER).exists()


_LIE = tuple(f'canGetAndSetFMUstate="{said}" canSerializeFMUstate="{said}"' for said in ("false", "true"))


def test_two_commands_in_one_folder(left: Path, built_in: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with HeldFolder(left / FOLDER):
        told = failed(capsys, 2, "resume", str(left), *LEAST)
        assert f"{left / FOLDER} is in use by another command: wait until it ends" in told
        told = failed(capsys, 2, "run", str(built_in), "--out", str(left.parent), *LEAST)
        assert f"{left / FOLDER} is in use by another command: wait until it ends" in told
    assert load(left / "result.nc").sizes["time"] == 25


def test_what_a_killed_writer_has_left_goes_with_the_next_command(tmp_path: Path) -> None:
    folder = tmp_path / FOLDER
    folder.mkdir()
    (folder / ".0000000007.checkpoint.partial").write_bytes(b"half")
    with HeldFolder(folder):
        assert [path.name for path in folder.iterdir()] == ["lock"]
        (folder / ".0000000008.checkpoint.partial").write_bytes(b"half")
    assert not folder.exists()


def test_a_full_disk_costs_no_run(
    built_in: Path, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(checkpoint_file, "write_all", full)
    monkeypatch.setattr(checkpoints, "MOST", 0.0)  # none is left out
    _, errors = command(capsys, "run", built_in, "--out", tmp_path, "--checkpoint", "every=0.1s", "--pace", "5", *LEAST)
    assert "the last checkpoint was not written: the checkpoint " in errors
    assert "cannot be written: No space left on device" in " ".join(errors.split())
    assert (tmp_path / "cars" / "result.nc").read_bytes() == (whole / "result.nc").read_bytes()
    assert not (tmp_path / "cars" / FOLDER).exists()
    with cosim.Simulation(cosim.read_scenario(built_in)) as simulation:
        simulation.step()
        with pytest.raises(OutputError, match="No space left on device"):
            simulation.save(tmp_path / "there" if (tmp_path / "there").mkdir() else tmp_path / "saved")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--checkpoint", "10s"], "--checkpoint 10s: expected every=TIME, such as every=10s"),
        (["--checkpoint", "every=10"], "--checkpoint every=10: '10': the unit is missing"),
        (["--checkpoint", "every=-1s"], "--checkpoint every=-1s: expected a time after 0 s"),
        (["--checkpoint", "every=0.03s"], "--checkpoint every=0.03s: falls between two ticks, which are 0.02 s apart"),
        (["--until", "2 s"], "--until 2 s: expected a time after 0 s and not after the end at 1 s"),
        (["--until", "0.41 s"], "falls between two ticks"),
    ],
)
def test_options_that_make_no_sense(
    built_in: Path, tmp_path: Path, options: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert said in failed(capsys, 2, "run", str(built_in), "--out", str(tmp_path), *options, *LEAST)


def test_a_new_run_takes_the_checkpoints_of_the_one_before_away(
    left: Path, built_in: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command(capsys, "run", built_in, "--out", left.parent, "--set", "simulation/@seed=2", *LEAST)
    assert not (left / FOLDER).exists()
    kept = left.with_name("cars+unchanged")
    assert len(list((kept / FOLDER).glob("*.checkpoint"))) == 2
    command(capsys, "resume", kept, *LEAST)
    command(capsys, "run", built_in, "--out", left.parent, "--until", "0.5 s", "--set", "simulation/@seed=2", *LEAST)
    assert not (left / CHECKPOINTS_BEFORE).exists()


# From Python ------------------------------------------------------------------------------------------------


def test_a_simulation_is_saved_and_loaded(short_line: Scenario, tmp_path: Path) -> None:
    with cosim.Simulation(short_line) as simulation:
        for _ in range(20):
            simulation.step()
        simulation.save(tmp_path / "at_20")
        expected = simulation.run()
    with cosim.Simulation.load(tmp_path / "at_20") as loaded:
        assert loaded.tick == 20
        result = loaded.run()
    assert json.loads(result.attrs.pop("parts"))[0]["until"] == 0.4
    assert expected.identical(result)


def test_a_fork_goes_on_by_itself(short_line: Scenario) -> None:
    with cosim.Simulation(short_line) as simulation:
        simulation.step()
        simulation.step()
        with simulation.fork() as same, simulation.fork(["//follower[1]/desired/@range=1 m"]) as other:
            simulation.step()
            assert (simulation.tick, same.tick, other.tick) == (3, 2, 2)
            results = [one.run() for one in (simulation, same, other)]
    assert results[0].drop_attrs().identical(results[1].drop_attrs())
    assert not np.array_equal(results[0].pose, results[2].pose)
    assert np.array_equal(results[0].pose[:2], results[2].pose[:2])


def test_a_fork_cannot_leave_out_an_input_that_has_a_value(tmp_path: Path) -> None:
    """The plants would go on with it, unsaid."""
    path = write(tmp_path / "wind.xml")
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("  <leader", '  <input name="tau_d_x" value="3 N"/>\n  <leader', 1), encoding="utf-8")
    none = ["//input/@name=tau_d_y", "//input/@value=0 N"]
    with cosim.Simulation(cosim.read_scenario(path)) as simulation:
        simulation.step()
        simulation.step()
        sentence = "follower_1 has the value of the input 'tau_d_x' from earlier in the run: give it another one"
        with pytest.raises(cosim.InputError, match=sentence):
            simulation.fork(none)
        with simulation.fork(["//input/@value=0 N"]) as calm:
            simulation.step()
            calm.step()
            assert calm.tick == simulation.tick == 3


def test_a_simulation_is_saved_before_its_first_tick(short_line: Scenario, tmp_path: Path) -> None:
    with cosim.Simulation(short_line) as simulation:
        simulation.save(tmp_path / "start")
        expected = simulation.run()
        assert simulation.finished
        simulation.save(tmp_path / "end")
    with pytest.raises(cosim.InputError, match="the run cannot be saved: it is closed"):
        simulation.save(tmp_path / "closed")
    for name in ("start", "end"):
        with cosim.Simulation.load(tmp_path / name) as loaded:
            result = loaded.run()
        result.attrs.pop("parts")
        assert expected.identical(result)


def test_commands_that_a_program_gave_are_told_of_the_run_and_its_forks(short_line: Scenario, tmp_path: Path) -> None:
    with cosim.Simulation(short_line) as simulation:
        while simulation.tick < 10:
            own = {"follower_1": (-5.0, 0.0)} if simulation.tick in (4, 7) else {}
            simulation.step(own | ({"leader": (1.0, 0.0)} if simulation.tick == 5 else {}))
        simulation.save(tmp_path / "checkpoint")
        with simulation.fork() as fork, cosim.Simulation.load(tmp_path / "checkpoint") as loaded:
            fork.step({"follower_2": (0.0, 0.0)})
            results = [one.run() for one in (simulation, fork, loaded)]
    told = {"follower_1": [0.08, 0.14], "leader": [0.1, 0.1]}
    expected = [told, {**told, "follower_2": [0.2, 0.2]}, told]
    assert [json.loads(result.attrs["given"]) for result in results] == expected
    for result in results:
        summary = cosim.summary_of(result)
        assert any(
            "follower_1: a program gave commands in place of its controller, first at t = 0.08 s" in note
            for note in summary.notes
        )
        assert any("in place of the scenario, first at t = 0.10 s; no" in note for note in summary.notes)
        page = content_of(Result.of(result))
        assert page["notes"] == list(summary.notes)
        assert page["provenance"]["command"] == ""


def test_a_run_to_which_no_program_gave_commands_says_nothing_of_them(short_line: Scenario) -> None:
    result = cosim.run(short_line)
    assert "given" not in result.attrs
    assert not [note for note in cosim.summary_of(result).notes if "a program" in note]
    assert content_of(Result.of(result))["provenance"]["command"].startswith("formation run ")
