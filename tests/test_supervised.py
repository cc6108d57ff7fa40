"""A run in a supervised process: who stops it, what it leaves behind, and what is made of an answer without sense."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core.compiler_lock import global_compiler_lock

import cosim
import cosim.master.foreign
import cosim.master.supervised
from cosim import process_tree
from cosim.cli import main
from cosim.master.simulation import Simulation
from cosim.master.supervised import SupervisedRun, whole_run
from cosim.plant.protocol import HEADER
from cosim.tests.driving import scenario

from .saved import saved

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="a process is forked on Linux alone")

WHEN = 0.5
"""When the stubs do what they are made to [s]."""
BEFORE = 26
"""Samples up to then: one each 20 ms, and that at 0."""

Make = Callable[..., Path]


def children(of: int) -> list[str]:
    listed = subprocess.run(["ps", "-wweo", "pid,ppid,stat,args"], capture_output=True, text=True, check=True).stdout
    rows = (line.split(None, 3) for line in listed.splitlines()[1:])
    return [f"{pid} {stat}" for pid, parent, stat, args in rows if int(parent) == of and not args.startswith("ps ")]


@pytest.fixture(autouse=True)
def nothing_left() -> Iterator[None]:
    """Check that a test leaves no process behind."""
    before = children(os.getpid())
    yield
    known = {child.split()[0] for child in before}
    assert [child for child in children(os.getpid()) if child.split()[0] not in known] == []


def write(path: Path, fmu: Path, attributes: str = "", horizon: str = "0.6 s") -> Path:
    plant = f'<plant id="car" fmu="{fmu}" {attributes}/>'
    return scenario(path, plant, followers=["car"], horizon=horizon)


# Who stops --------------------------------------------------------------------------------------------------


class Command:
    """The command in a process group of its own, as a shell starts it."""

    def __init__(self, path: Path, out: Path) -> None:
        program = "import sys; from cosim.cli import main; sys.exit(main(sys.argv[1:]))"
        self.arguments = [sys.executable, "-c", program, "run", str(path), "--out", str(out), "--no-figure"]
        (out / "temporary").mkdir()
        self.out = out
        environment = {**os.environ, "TMPDIR": str(out / "temporary")}
        with (out / "log").open("w") as log:
            self.process = subprocess.Popen(self.arguments, env=environment, stdout=log, stderr=log, process_group=0)

    def run(self) -> list[int]:
        """Return the process that has loaded the FMU, once there is one: libraries start others in passing."""
        found = (int(child.split()[0]) for child in children(self.process.pid))
        return [pid for pid in found if "/bad.so" in _maps(pid)]

    def wait_for(self, condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + 120.0
        while not condition():
            assert self.process.poll() is None, (self.out / "log").read_text()
            assert time.monotonic() < deadline, (self.out / "log").read_text()
            time.sleep(0.1)


def _maps(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/maps").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return ""


@pytest.fixture(scope="module")
def compiled(make: Make, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Fill the cache with functions that take seconds to compile, which no signal interrupts."""
    cosim.run(write(tmp_path_factory.mktemp("compiled") / "s.xml", make(name="car")))


@pytest.fixture
def command(make: Make, tmp_path: Path, compiled: None) -> Iterator[Callable[..., Command]]:
    started = []

    def start(**options: Any) -> Command:
        fmu = make(name="bad", **{"when": WHEN, **options})
        path = write(tmp_path / "s.xml", fmu, 'time_limit="60 s"', "400 s")
        started.append(Command(path, tmp_path))
        return started[-1]

    yield start
    for one in started:
        one.process.kill()
        one.process.wait()


def runs(command: Command) -> bool:
    """Return whether the plants are started, and the run with them."""
    return (command.out / "s").is_dir() and bool(command.run())


@pytest.mark.parametrize("group", [False, True])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_in_the_course_of_a_run(command: Callable[..., Command], number: signal.Signals, group: bool) -> None:
    """It ends after a tick; the process of the run does not belong to the terminal."""
    one = command(behaviour="slow", seconds=0.01, when=0.0)
    one.wait_for(lambda: runs(one))
    time.sleep(1.0)
    (os.killpg if group else os.kill)(one.process.pid, number)
    assert one.process.wait(60.0) == 130, (one.out / "log").read_text()
    assert list((one.out / "temporary").iterdir()) == []
    result = saved(one.out / "s" / "result.nc")
    assert result.attrs["status"] == "incomplete"
    assert result.samples > 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_the_process_of_the_run_while_plants_start(
    command: Callable[..., Command], number: signal.Signals
) -> None:
    """It ends the run, as one does that comes later: no plant has failed, and no fault is told."""
    one = command(behaviour="slow", place="instantiate", seconds=3.0)
    one.wait_for(one.run)
    time.sleep(1.0)
    (child,) = one.run()
    os.kill(child, number)
    assert one.process.wait(60.0) == 130, (one.out / "log").read_text()
    assert json.loads(saved(one.out / "s" / "result.nc").attrs["failure"])["message"] == "interrupted"


def test_under_nohup_no_process_heeds_sighup(command: Callable[..., Command]) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        one = command(behaviour="slow", seconds=0.01, when=0.0)
    finally:
        signal.signal(signal.SIGHUP, before)
    one.wait_for(lambda: runs(one))
    for process in (*one.run(), one.process.pid):
        os.kill(process, signal.SIGHUP)
    time.sleep(2.0)
    assert one.process.poll() is None, (one.out / "log").read_text()
    one.process.send_signal(signal.SIGTERM)
    assert one.process.wait(60.0) == 130


def test_two_signals_end_a_step_that_does_not_end(command: Callable[..., Command]) -> None:
    one = command(behaviour="hang_stubborn")
    one.wait_for(lambda: runs(one))
    time.sleep(2.0)
    one.process.send_signal(signal.SIGINT)
    time.sleep(0.5)
    assert one.process.poll() is None, "the first one waits for the end of the tick"
    one.process.send_signal(signal.SIGINT)
    assert one.process.wait(30.0) == 130
    assert saved(one.out / "s" / "result.nc").samples == BEFORE


def test_a_signal_while_plants_start(command: Callable[..., Command]) -> None:
    one = command(behaviour="hang", place="instantiate")
    one.wait_for(one.run)
    time.sleep(1.0)
    one.process.send_signal(signal.SIGINT)
    assert one.process.wait(30.0) == 130
    assert list((one.out / "temporary").iterdir()) == []


@pytest.mark.parametrize("behaviour", ["hang_stubborn", "spin"])
def test_a_command_that_is_killed_leaves_no_process(command: Callable[..., Command], behaviour: str) -> None:
    one = command(behaviour=behaviour)
    one.wait_for(lambda: runs(one))
    pids = one.run()
    one.process.kill()
    one.process.wait()
    deadline = time.monotonic() + 10.0
    while any(Path(f"/proc/{pid}").exists() for pid in pids) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids)


# What is run so -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("where", ["os.fork", "os.close"])
def test_ctrl_c_as_the_process_starts_or_ends_leaves_nothing(
    make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    """Neither the process, which the test's fixture looks for, nor a pipe."""
    path, before = write(tmp_path / "s.xml", make()), set(os.listdir("/proc/self/fd"))
    module, name = where.split(".")
    original, supervising, pressed = getattr(sys.modules[module], name), os.getpid(), list[bool]()

    def interrupted(*arguments: object) -> object:
        found = original(*arguments)
        if os.getpid() == supervising and cosim.master.supervised.__file__ == sys._getframe(1).f_code.co_filename:
            pressed.append(True)
            if len(pressed) == 1:
                signal.raise_signal(signal.SIGINT)
        return found

    monkeypatch.setattr(sys.modules[module], name, interrupted)
    with pytest.raises(KeyboardInterrupt):
        cosim.run(path)
    assert pressed
    assert set(os.listdir("/proc/self/fd")) == before


def test_which_runs_are_supervised(make: Make, tmp_path: Path) -> None:
    fmu = make(name="car")
    for attributes, expected in (("", SupervisedRun), ('isolate="no"', Simulation), ('isolate="process"', Simulation)):
        read = cosim.read_scenario(write(tmp_path / "s.xml", fmu, attributes))
        with whole_run(read) as run:
            assert type(run) is expected
    built_in = cosim.read_scenario(scenario(tmp_path / "t.xml", '<plant id="car" model="car_like"/>'))
    with whole_run(built_in) as run:
        assert type(run) is Simulation


def test_where_no_process_supervises_each_fmu_has_one_of_its_own(
    make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As on Windows and macOS: also there an FMU ends its own run alone."""
    monkeypatch.setattr(cosim.master.foreign, "_SUPERVISES", False)
    bad = write(tmp_path / "bad.xml", make(name="bad", behaviour="exit_0", when=WHEN))
    good = write(tmp_path / "good.xml", make(name="car"))
    assert main(["run", str(bad), str(good), "--out", str(tmp_path), "--no-figure", "--no-report"]) == 3
    printed = "".join(capsys.readouterr())
    assert "did not complete the step: its process exited with status 0" in printed
    for name, samples in (("bad", BEFORE), ("good", 31)):
        result = saved(tmp_path / name / "result.nc")
        assert result.samples == samples
        assert {plant["process"] for plant in json.loads(result.attrs["plants"]).values()} == {"its own"}


def test_the_numbers_are_the_same(make: Make, tmp_path: Path) -> None:
    fmu = make(name="car")
    here, there = (cosim.run(write(tmp_path / "s.xml", fmu, how, "4 s")) for how in ('isolate="no"', ""))
    assert here.data_vars.keys() == there.data_vars.keys()
    for name in here.data_vars:
        assert np.array_equal(here[name].values, there[name].values, equal_nan=True), name
    assert here.attrs["plants"] != there.attrs["plants"], "the result tells which process it was"


def test_the_loop_does_not_wait_for_pages_of_the_records(make: Make, tmp_path: Path) -> None:
    """They are made while the plants start: at the first touch each, a page costs as much as a tick."""
    read = cosim.read_scenario(write(tmp_path / "s.xml", make(name="car"), horizon="400 s"))
    with whole_run(read) as run:
        records = sum(place.nbytes for place in run._recorder.places)
        for process in (os.getpid(), run._pid):
            maps = re.split(r"^(?=[0-9a-f]+-)", Path(f"/proc/{process}/smaps").read_text(), flags=re.MULTILINE)
            here = [re.search(r"^Rss: +([0-9]+) kB", one, re.MULTILINE) for one in maps if "/dev/zero" in one]
            assert sum(1024 * int(size[1]) for size in here if size) >= records > 1e6
        run.run_to_end()


def test_a_paced_run_reports_its_pace(make: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path / "s.xml", make(name="car"))
    begin = time.monotonic()
    assert main(["run", str(path), "--out", str(tmp_path), "--no-figure", "--pace", "1"]) == 0
    assert time.monotonic() - begin > 0.6
    assert "paced at 1 times real time: " in capsys.readouterr().out


def test_progress_is_told(make: Make, tmp_path: Path) -> None:
    read = cosim.read_scenario(write(tmp_path / "s.xml", make(name="bad", behaviour="slow", seconds=0.01, when=0.0)))
    seen: list[int] = []
    with whole_run(read) as run:
        run.run_to_end(seen.append)
    assert seen == sorted(seen)
    assert len(seen) > 2
    assert seen[-1] == read.ticks


# Answers without sense --------------------------------------------------------------------------------------

NO_REPLY = "its process answers with bytes that are no reply"


@pytest.mark.parametrize(
    "answer",
    [
        b"nonsense of many bytes",
        HEADER.pack(99, 2) + b"{}",
        HEADER.pack(3, 2**31),
        HEADER.pack(3, 2) + b"[]",
        HEADER.pack(3, 2) + b"{}",
        HEADER.pack(3, 3) + b"{x}",
        HEADER.pack(3, 16) + b'{"failure": [1]}',
    ],
)
def test_an_answer_without_sense(make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: bytes) -> None:
    """An FMU may write whatever it likes."""

    def child(*arguments: Any) -> None:
        os.write(arguments[-1], HEADER.pack(0, 2) + b"{}")
        os.read(arguments[-2], 1)
        os.write(arguments[-1], answer)
        time.sleep(60.0)

    monkeypatch.setattr(cosim.master.supervised, "child", child)
    read = cosim.read_scenario(write(tmp_path / "s.xml", make(name="car")))
    with whole_run(read) as run:
        with pytest.raises(cosim.SimulationError, match=NO_REPLY) as caught:
            run.run_to_end()
        assert caught.value.result.sizes["time"] == 0


def test_what_nobody_foresaw_there_is_told_here(make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*arguments: object) -> None:
        raise IndexError("off by one")

    monkeypatch.setattr(cosim.master.supervised_child, "members_of", broken)
    read = cosim.read_scenario(write(tmp_path / "s.xml", make(name="car")))
    with pytest.raises(RuntimeError, match="IndexError: off by one") as caught:
        whole_run(read)
    assert "in broken" in "".join(caught.value.__notes__)


def test_a_crash_outside_of_any_call(make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a thread that an FMU has left behind."""
    run_there = cosim.master.supervised_child._run

    def crashing(*arguments: Any) -> Any:
        run_there(*arguments)
        os.abort()

    monkeypatch.setattr(cosim.master.supervised_child, "_run", crashing)
    path = write(tmp_path / "s.xml", make(name="car"))
    assert main(["run", str(path), "--out", str(tmp_path), "--no-figure"]) == 3
    summary = json.loads((tmp_path / "s" / "summary.json").read_text("utf-8"))
    assert not summary["passed"]
    assert "the process that runs car.fmu has ended: its process crashed (SIGABRT)" in summary["failure"]["message"]


def test_the_process_begins_while_no_other_thread_compiles(
    make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held, free = threading.Event(), threading.Event()

    def compiles() -> None:
        with global_compiler_lock:
            held.set()
            time.sleep(0.3)
            free.set()

    forked_while_free: list[bool] = []
    fork = os.fork

    def noting() -> int:
        forked_while_free.append(free.is_set())
        return fork()

    thread = threading.Thread(target=compiles)
    new_mark = process_tree.new_mark

    def marks() -> str:
        thread.start()
        held.wait()
        return new_mark()

    monkeypatch.setattr(os, "fork", noting)
    monkeypatch.setattr(process_tree, "new_mark", marks)  # just before the fork
    result = cosim.run(write(tmp_path / "scenario.xml", make(name="car")))
    thread.join()
    assert forked_while_free == [True]
    assert result.sizes["time"] == 31


def test_messages_of_fmi_1_are_told_beside_another_run_with_the_same_names(make: Make, tmp_path: Path) -> None:
    """FMI 1.0 tells instances apart by their names; those of the supervising process have the same ones."""
    fmu = make(behaviour="log_odd", fmi="1.0", when=0.1, name="talks")
    here = write(tmp_path / "here.xml", fmu, 'isolate="no"', "0.2 s")
    with cosim.Simulation(cosim.read_scenario(here)) as simulation:
        simulation.step()
        result = cosim.run(write(tmp_path / "there.xml", fmu, "", "0.2 s"))
    assert any("100 % sure" in message for message in json.loads(result.attrs["plant_messages"]))
