"""No plant ends the harness: every fault of an FMU has a clear outcome, in the supervised process or in one of its own.

With isolate="no" an FMU that crashes, exits or hangs does so to the harness, as is documented.
"""

import json
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import cosim.plant.companion
import cosim.plant.process
from cosim.cli import main
from cosim.errors import InputError
from cosim.plant.bells import Heard, bells_of, listen, ring
from cosim.plant.failures import PlantError
from cosim.plant.process import PlantProcess
from cosim.plant.protocol import HEADER, Reply
from cosim.plant.spec import Block, Exchanged, PlantSpec
from cosim.tests.driving import scenario

from .saved import Saved, saved

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="POSIX processes and signals")

FMI = ("1.0", "2.0", "3.0")
MODES = ["", 'isolate="process"']
"""In the process that the harness supervises, with the whole loop; in a process of its own."""
WHEN = 0.5
"""When the stubs do what they are made to [s]."""
BEFORE = 26
"""Samples up to then: one each 20 ms, and that at 0."""
ALL = 31
LIMIT = 0.5
"""What a plant that hangs may take [s]."""

EACH = [
    *(pytest.param(MODES[0], fmi, id=f"supervised-{fmi}") for fmi in FMI),
    pytest.param(MODES[1], "2.0", id="isolated-2.0"),
]
"""Mode and version of FMI: a process of its own calls an FMU as the supervised one does."""

Make = Callable[..., Path]
Run = Callable[..., tuple[int, str, Saved | None]]


@pytest.fixture(scope="module")
def make(make: Make) -> Make:
    """Return a function that makes stubs, each once, which are bad in the course of a run."""
    return lambda **options: make(**{"when": WHEN, "name": "bad", **options})


@pytest.fixture
def nothing_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Check that a test leaves no process and no folder behind."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    folder = Path.cwd()
    yield
    assert Path.cwd() == folder
    assert list(temporary.iterdir()) == []
    assert workers(os.getpid()) == []


def workers(harness: int) -> list[str]:
    """Return the processes of plants that a harness has started and that are still there, zombies included."""
    listed = subprocess.run(["ps", "-wweo", "pid,ppid,args"], capture_output=True, text=True, check=True).stdout
    ours = (line for line in listed.splitlines() if f"cosim.plant.worker {harness}" in line)
    defunct = (line for line in listed.splitlines() if f" {harness} " in line and "<defunct>" in line)
    return [*ours, *defunct]


@pytest.fixture
def run(make: Make, tmp_path: Path, nothing_left: None, capfd: pytest.CaptureFixture[str]) -> Run:
    """Return a function that runs a scenario with a bad follower: exit status, what was printed, and the result."""

    def made(mode: str = "", limit: float = 30.0, followers: tuple[str, ...] = ("bad",), **options: Any) -> Any:
        path = write(tmp_path / "bad.xml", make, mode, limit, followers, **options)
        status = main(["run", str(path), "--out", str(tmp_path), "--no-figure"])
        printed = capfd.readouterr().err
        assert "Traceback" not in printed
        result = tmp_path / "bad" / "result.nc"
        return status, " ".join(printed.split()), saved(result) if result.exists() else None

    return made


def write(path: Path, make: Make, mode: str, limit: float, followers: tuple[str, ...], **options: Any) -> Path:
    attributes = f'{mode} time_limit="{limit} s"'
    solver = 'solver="euler"' if options.get("interface") == "model_exchange" else ""
    here = 'isolate="no"' if mode else ""  # another foreign FMU would take the run to the supervised process
    plants = f'<plant id="good" fmu="{make(name="good")}" {here}/>'
    plants += f'<plant id="bad" fmu="{make(**options)}" {attributes} {solver}/>'
    return scenario(path, plants, leader="good", followers=followers, horizon="0.6 s")


@pytest.fixture(scope="module")
def reference(make: Make, tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """Return the result with a good follower."""
    plant = f'<plant id="good" fmu="{make(name="good")}"/>'
    path = tmp_path_factory.mktemp("reference") / "good.xml"
    return cosim.run(scenario(path, plant, leader="good", followers=["good"], horizon="0.6 s"))


def recorded(result: Saved | None, reference: xr.Dataset, samples: int) -> bool:
    """Return whether exactly so many samples are recorded, equal to a run with a good plant."""
    assert result is not None
    assert result.attrs["status"] == ("completed" if samples == ALL else "incomplete")
    return result.samples == samples and np.array_equal(result.pose, reference.pose.values[:samples])


# What fails in a step ---------------------------------------------------------------------------------------

FAILS = {
    "error": "Error",
    "fatal_strict": "Fatal",
    "pending": "Pending",
    "illegal": "17",
    "minus": "-1",
}
"""Behaviours, and how the status is told."""


@pytest.mark.parametrize("mode", MODES, ids=["supervised", "isolated"])
@pytest.mark.parametrize(
    ("behaviour", "fmi"),
    [
        ("error", "1.0"),
        ("fatal_strict", "3.0"),
        ("pending", "2.0"),
        ("illegal", "2.0"),
        ("minus", "2.0"),
        ("minus", "3.0"),
    ],
)
def test_a_status_that_is_no_success(run: Run, reference: xr.Dataset, behaviour: str, fmi: str, mode: str) -> None:
    status, printed, result = run(mode, behaviour=behaviour, fmi=fmi)
    assert status == 3
    sentence = f"the plant bad.fmu did not complete the step (status {FAILS[behaviour]}): step returns {behaviour} at"
    assert f"error: follower_1 at t = 0.5 s: {sentence} t = 0.5 s, as it was made to" in printed
    assert "the run ended early, at 0.5 s of 0.6 s; everything recorded up to then is saved" in printed
    assert recorded(result, reference, BEFORE)


@pytest.mark.parametrize("fmi", FMI)
def test_a_status_below_zero_in_cvode_and_before_the_first_step(make: Make, tmp_path: Path, fmi: str) -> None:
    exchanged = make(behaviour="minus", fmi=fmi, interface="model_exchange")
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{exchanged}" solver="cvode"/>')
    with pytest.raises(cosim.SimulationError, match=r"the plant bad\.fmu did not .* \(status -1\)"):
        cosim.run(path)
    early = make(behaviour="minus", fmi=fmi, place="initialization")
    path = scenario(tmp_path / "i.xml", f'<plant id="car" fmu="{early}"/>')
    with pytest.raises(InputError, match="initialization returns minus at t = 0 s, as it was made to"):
        cosim.run(path)


@pytest.mark.parametrize(("mode", "fmi"), EACH)
def test_an_fmu_that_asks_to_end(run: Run, reference: xr.Dataset, fmi: str, mode: str) -> None:
    status, printed, result = run(mode, behaviour="terminate", fmi=fmi)
    assert status == 3
    how = {"1.0": "did not complete the step", "2.0": "asks to end the simulation", "3.0": "asks to end the simulation"}
    assert f"follower_1 at t = 0.5 s: the plant bad.fmu {how[fmi]}" in printed
    assert recorded(result, reference, BEFORE)


@pytest.mark.parametrize(("mode", "fmi"), EACH)
@pytest.mark.parametrize("behaviour", ["error", "discard", "terminate", "nan"])
def test_model_exchange(run: Run, behaviour: str, fmi: str, mode: str) -> None:
    status, printed, result = run(mode, behaviour=behaviour, fmi=fmi, interface="model_exchange")
    assert status == 3
    assert {
        "error": "bad.fmu did not return the derivatives of its states (status Error): step returns error",
        "discard": "did not return the derivatives of its states (status Discard): step returns discard",
        "terminate": "follower_1 at t = 0.5 s: the plant bad.fmu asks to end the simulation",
        "nan": "follower_1 at t = 0.5 s: the plant bad.fmu has diverged: x = nan m",
    }[behaviour] in printed
    assert result is not None
    assert result.samples == (BEFORE if behaviour != "nan" else BEFORE - 1)


@pytest.mark.parametrize(
    ("behaviour", "what", "fmi"), [("nan", "x = nan m", "1.0"), ("infinity", "v = inf m/s", "3.0")]
)
def test_numbers_that_are_none(run: Run, reference: xr.Dataset, behaviour: str, what: str, fmi: str) -> None:
    """They are caught at the communication point where they first appear, before anyone computes with them."""
    status, printed, result = run(behaviour=behaviour, fmi=fmi)
    assert status == 3
    assert f"follower_1 at t = 0.5 s: the plant bad.fmu has diverged: {what}" in printed
    assert recorded(result, reference, BEFORE - 1)


@pytest.mark.parametrize("mode", MODES, ids=["supervised", "isolated"])
@pytest.mark.parametrize("place", ["set", "get"])
def test_inputs_and_outputs(run: Run, place: str, mode: str) -> None:
    status, printed, result = run(mode, behaviour="error", place=place, fmi="3.0")
    assert status == 3
    how = {"set": "t = 0.5 s: the plant bad.fmu did not accept its inputs", "get": "did not return its outputs"}
    assert f"{how[place]} (status Error): {place} returns error" in printed
    assert result is not None
    assert result.samples == (BEFORE if place == "set" else BEFORE - 1)


def test_all_failures_of_a_step_are_told(run: Run, make: Make) -> None:
    for mode in MODES:
        status, printed, _ = run(mode, behaviour="error", followers=("good", "bad", "bad"))
        assert status == 3
        assert "error: follower_2 at t = 0.5 s: the plant bad.fmu did not complete the step (status Error)" in printed
        assert "; follower_3: the plant bad.fmu did not complete the step (status Error): step returns error" in printed


def test_failures_here_and_there_are_told_together(make: Make, tmp_path: Path, nothing_left: None) -> None:
    plants = f'<plant id="good" fmu="{make(name="good")}"/><plant id="here" fmu="{make(behaviour="error")}"/>'
    plants += f'<plant id="there" fmu="{make(behaviour="segfault")}" isolate="process"/>'
    path = scenario(tmp_path / "s.xml", plants, leader="good", followers=["there", "good", "here"])
    with pytest.raises(cosim.SimulationError) as caught:
        cosim.run(path)
    assert "follower_1 at t = 0.5 s: the plant bad.fmu did not complete the step: its process crashed (SIGSEGV)" in str(
        caught.value
    )
    assert "; follower_3: the plant bad.fmu did not complete the step (status Error)" in str(caught.value)
    assert caught.value.result.sizes["time"] == BEFORE


def test_a_failure_within_cvode(make: Make, tmp_path: Path, nothing_left: None) -> None:
    """CVODE stops where the FMU fails, and tries shorter steps where it discards the states."""
    for behaviour, sentence in {
        "error": r"did not complete the step \(status Error\): step returns error at t = 0\.5",
        "discard": r"did not complete the step \(status Discard\): .*step returns discard at t = 0\.5",
        "nan": "did not complete the step: CVODE: ",
    }.items():
        for mode in MODES:
            fmu = make(behaviour=behaviour, interface="model_exchange")
            plant = f'<plant id="bad" fmu="{fmu}" solver="cvode" {mode} time_limit="30 s"/>'
            path = scenario(tmp_path / "s.xml", plant, leader="bad", followers=["bad"])
            with pytest.raises(cosim.SimulationError, match=f"leader at t = 0.[45].* s: the plant bad.fmu {sentence}"):
                cosim.run(path)


# What kills or hangs a process ------------------------------------------------------------------------------

DEADLY = {
    "segfault": ": its process crashed (SIGSEGV)",
    "spin": " within 0.5 s; its process was ended",
    "daemon_exit": ": its process exited with status 7",
}
"""Behaviours, and how the end of the process is told; `tests.safety` has more."""


@pytest.mark.parametrize("mode", MODES, ids=["supervised", "isolated"])
@pytest.mark.parametrize(
    ("behaviour", "fmi"), [("segfault", "1.0"), ("segfault", "3.0"), ("spin", "2.0"), ("daemon_exit", "2.0")]
)
def test_the_harness_survives(
    run: Run, reference: xr.Dataset, tmp_path: Path, behaviour: str, fmi: str, mode: str
) -> None:
    limit = LIMIT if "within" in DEADLY[behaviour] else 30.0
    status, printed, result = run(mode, limit, behaviour=behaviour, fmi=fmi)
    assert status == 3
    assert json.loads((tmp_path / "bad" / "summary.json").read_text("utf-8"))["passed"] is False
    said = f"it had logged: step goes into {behaviour} at t = 0.5 s, as it was made to"
    sentence = f"the plant bad.fmu did not complete the step{DEADLY[behaviour]}; {said}"
    assert f"error: follower_1 at t = 0.5 s: {sentence}" in printed
    assert recorded(result, reference, BEFORE)


@pytest.mark.parametrize("mode", MODES, ids=["supervised", "isolated"])
@pytest.mark.parametrize("place", ["instantiate", "free"])
def test_what_an_fmu_leaves_behind_ends_with_it(run: Run, reference: xr.Dataset, place: str, mode: str) -> None:
    """Though it is in a session of its own, its parent has ended, and it holds the pipe to the harness."""
    begin = time.monotonic()
    status, printed, result = run(mode, behaviour="daemon", place=place)
    assert (status, printed) == (0, "")
    assert recorded(result, reference, ALL)
    assert time.monotonic() - begin < 20.0, "the time limit is not waited for"


@pytest.mark.parametrize("mode", MODES, ids=["supervised", "isolated"])
@pytest.mark.parametrize("place", ["set", "get"])
def test_it_survives_wherever_that_happens(run: Run, place: str, mode: str) -> None:
    status, printed, _ = run(mode, behaviour="segfault", place=place)
    assert status == 3
    assert f"its process crashed (SIGSEGV); it had logged: {place} goes into segfault" in printed


@pytest.mark.parametrize("mode", MODES, ids=["supervised", "isolated"])
@pytest.mark.parametrize("behaviour", ["segfault", "daemon_hang", "fatal"])
def test_what_cannot_be_started(run: Run, behaviour: str, mode: str) -> None:
    limit = LIMIT if behaviour == "daemon_hang" else 30.0
    status, printed, result = run(mode, limit, behaviour=behaviour, place="initialization", fmi="3.0")
    assert status == 2
    how = {
        "segfault": "it did not start: its process crashed (SIGSEGV); it had logged:",
        "daemon_hang": "it did not start within 0.5 s; its process was ended; it had logged:",
    }
    goes = "goes into" if behaviour in how else "returns"
    said = f"{how.get(behaviour, '')} initialization {goes} {behaviour}".strip()
    assert "bad.xml:4:" in printed
    assert f"the FMU bad.fmu cannot be started as follower_1: {said}" in printed
    assert result is None


@pytest.mark.parametrize("mode", MODES, ids=["supervised", "isolated"])
@pytest.mark.parametrize("behaviour", ["exit", "daemon_hang"])
def test_what_does_not_end_well_has_run_all_the_same(
    run: Run, reference: xr.Dataset, behaviour: str, mode: str
) -> None:
    begin = time.monotonic()
    followers = ("bad", "bad")
    status, printed, result = run(mode, LIMIT, behaviour=behaviour, place="terminate", fmi="3.0", followers=followers)
    assert (status, printed) == (0, "")
    assert result is not None
    assert result.samples == ALL
    assert time.monotonic() - begin < 20.0


@pytest.mark.parametrize("mode", MODES, ids=["supervised", "isolated"])
@pytest.mark.parametrize("behaviour", ["error", "fatal_strict"])
def test_a_status_on_terminating(run: Run, reference: xr.Dataset, behaviour: str, mode: str) -> None:
    """After Fatal nothing is called any more: this one would abort."""
    status, _, result = run(mode, behaviour=behaviour, place="terminate")
    assert status == 0
    assert recorded(result, reference, ALL)


def command(path: Path, out: Path) -> list[str]:
    program = "import sys; from cosim.cli import main; sys.exit(main(sys.argv[1:]))"
    return [sys.executable, "-c", program, "run", str(path), "--out", str(out), "--no-figure"]


@pytest.mark.parametrize(("behaviour", "ends"), [("segfault", -11), ("exit", 7), ("abort", -6), ("hang", None)])
def test_in_the_harness_it_takes_the_harness_down(make: Make, tmp_path: Path, behaviour: str, ends: int | None) -> None:
    """As documented of isolate="no": a crash or an exit ends the harness and nothing is saved; a hang hangs it."""
    path = write(tmp_path / "bad.xml", make, 'isolate="no"', 30.0, ("bad",), behaviour=behaviour)
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    harness = subprocess.Popen(
        command(path, tmp_path), env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        if ends is not None:
            assert harness.wait(60.0) == ends
        else:
            with pytest.raises(subprocess.TimeoutExpired):
                harness.wait(3.0)
    finally:
        harness.kill()
        harness.wait()
    assert not (tmp_path / "bad" / "result.nc").exists()


# What can be borne ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("mode", "fmi"), EACH)
def test_a_flood_of_messages(run: Run, reference: xr.Dataset, fmi: str, mode: str) -> None:
    status, printed, result = run(mode, behaviour="log_million", lines=50_000, fmi=fmi)
    assert (status, printed) == (0, "")
    assert recorded(result, reference, ALL)
    [message] = json.loads(result.attrs["plant_messages"])  # type: ignore[union-attr]
    last = "; ".join(f"line {i} of 50000" for i in range(49_981, 50_001))
    assert message == f"follower_1, t = 0.5 s: 50000 messages, the last of them: {last}"


@pytest.mark.parametrize(("mode", "fmi"), EACH)
@pytest.mark.parametrize("behaviour", ["log_odd", "log_percent", "log_long"])
def test_odd_messages(run: Run, reference: xr.Dataset, behaviour: str, fmi: str, mode: str) -> None:
    status, printed, result = run(mode, behaviour=behaviour, fmi=fmi)
    assert (status, printed) == (0, "")
    assert recorded(result, reference, ALL)
    [message] = json.loads(result.attrs["plant_messages"])  # type: ignore[union-attr]
    assert message.startswith("follower_1, t = 0.5 s: ")
    assert len(message) < 2100
    if behaviour == "log_odd":
        assert message.endswith(
            "100 % sure of %s and %d: \ufffd\ufffd not UTF-8, ?[31mred?[0m, bell ?, tab , two lines"
        )


@pytest.mark.parametrize("mode", MODES, ids=["supervised", "isolated"])
def test_what_is_printed(run: Run, reference: xr.Dataset, mode: str, caplog: pytest.LogCaptureFixture) -> None:
    """It goes to the log, which shows it on standard error: the output is the command's own."""
    status, _, result = run(mode, behaviour="print")
    assert status == 0
    assert recorded(result, reference, ALL)
    files = "bad.fmu" if mode else "good.fmu, bad.fmu"  # all those of the process
    assert caplog.messages == [f"{files}: follower_1 prints at t = {t} s" for t in (0.5, 0.52, 0.54, 0.56, 0.58)]


@pytest.mark.parametrize("behaviour", ["rounding", "trap", "chdir", "signals"])
@pytest.mark.parametrize("mode", MODES, ids=["supervised", "isolated"])
def test_what_changes_the_process(make: Make, run: Run, reference: xr.Dataset, behaviour: str, mode: str) -> None:
    """The harness goes on unchanged: changes that an FMU makes at its start are undone."""
    status, printed, result = run(mode, behaviour=behaviour)
    assert (status, printed) == (0, "")
    assert recorded(result, reference, ALL)
    assert 1.0 + 1e-17 == 1.0
    with np.errstate(all="ignore"):
        assert math.isnan((np.ones(1) / np.zeros(1) - np.ones(1) / np.zeros(1))[0])


@pytest.mark.parametrize("mode", MODES, ids=["supervised", "isolated"])
def test_a_change_of_the_directory_in_a_step(
    make: Make, tmp_path: Path, nothing_left: None, monkeypatch: pytest.MonkeyPatch, mode: str
) -> None:
    """Relative paths of the command line keep their meaning, for this scenario and the next."""
    for name in ("one", "two"):
        write(tmp_path / f"{name}.xml", make, mode, 30.0, ("bad",), behaviour="chdir", place="step")
    monkeypatch.chdir(tmp_path)
    assert main(["run", "one.xml", "two.xml", "--out", "results", "--junit", "results/all.xml"]) == 0
    assert {path.name for path in (tmp_path / "results").rglob("*.*")} == {
        "result.nc",
        "summary.json",
        "figure.png",
        "report.html",
        "all.xml",
    }
    monkeypatch.undo()


@pytest.mark.parametrize("mode", MODES, ids=["supervised", "isolated"])
def test_descriptors_that_are_closed(make: Make, tmp_path: Path, mode: str) -> None:
    """The FMU can close its standard streams and nothing else."""
    path = write(tmp_path / "bad.xml", make, mode, 30.0, ("bad",), behaviour="close_descriptors")
    done = subprocess.run(command(path, tmp_path), capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0
    assert saved(tmp_path / "bad" / "result.nc").samples == ALL


def test_descriptors_that_are_closed_in_the_harness(make: Make, tmp_path: Path) -> None:
    """Only what the harness prints is lost."""
    path = write(tmp_path / "bad.xml", make, 'isolate="no"', 30.0, ("bad",), behaviour="close_descriptors")
    subprocess.run(command(path, tmp_path), capture_output=True, check=False, timeout=300)
    assert saved(tmp_path / "bad" / "result.nc").samples == ALL


def test_without_standard_error(make: Make, tmp_path: Path) -> None:
    path = write(tmp_path / "bad.xml", make, MODES[1], 30.0, ("bad",), behaviour="print")
    shell = " ".join(f"'{argument}'" for argument in command(path, tmp_path)) + " 2>&- >/dev/null"
    assert subprocess.run(["bash", "-c", shell], check=False, timeout=300).returncode == 0
    assert saved(tmp_path / "bad" / "result.nc").samples == ALL


def test_slow_within_its_limit(run: Run, reference: xr.Dataset) -> None:
    status, _, result = run(MODES[1], 2.0, behaviour="slow", seconds=0.1)
    assert status == 0
    assert recorded(result, reference, ALL)


def test_a_parameter_that_is_refused_in_the_course_of_a_run(make: Make, tmp_path: Path, nothing_left: None) -> None:
    event = '<event at="0.2 s" robots="follower_1"><parameter name="when" value="-1 s"/></event>'
    for mode in MODES:
        for interface in ("co_simulation", "model_exchange"):
            plant = f'<plant id="car" fmu="{make(interface=interface)}" {mode} time_limit="30 s"/>'
            path = scenario(tmp_path / "s.xml", plant, more=event)
            sentence = r"the plant bad\.fmu refuses when = -1\.0: the time when = -1 s is negative"
            with pytest.raises(cosim.SimulationError, match=rf"follower_1 at t = 0\.2 s: {sentence}"):
                cosim.run(path)


@pytest.mark.parametrize("mode", MODES, ids=["supervised", "isolated"])
@pytest.mark.parametrize(("at", "behaviour"), [("0.2", "segfault"), ("0", "segfault"), ("0.2", "hang")])
def test_a_change_of_parameters_that_ends_the_process(
    make: Make, tmp_path: Path, nothing_left: None, mode: str, at: str, behaviour: str
) -> None:
    """What was recorded up to then is kept, and time and occasion are told."""
    event = f'<event at="{at} s" robots="follower_1"><parameter name="when" value="9 s"/></event>'
    fmu = make(behaviour=behaviour, place="change")
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}" {mode} time_limit="1 s"/>', more=event)
    sentence = rf"follower_1 at t = {re.escape(at)} s: the plant bad\.fmu did not change its parameters"
    with pytest.raises(cosim.SimulationError, match=sentence) as caught:
        cosim.run(path)
    assert caught.value.recorded.sizes["time"] == round(float(at) / 0.02) + 1


# How many processes there are --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "isolate", "horizon", "processes"),
    [
        ({}, "process", "0.6 s", 1),
        ({}, "process", "104 s", 1),
        ({"interface": "model_exchange"}, "process", "0.6 s", 1),
        ({}, "robot", "0.6 s", 3),
        ({"once": True}, "process", "0.6 s", 3),
        ({"once": True, "says_once": False}, "process", "0.6 s", 3),
    ],
    ids=["together", "compiled", "model_exchange", "apart", "once", "once_unsaid"],
)
def test_all_robots_of_an_fmu_share_a_process_if_it_allows_that(
    make: Make,
    tmp_path: Path,
    nothing_left: None,
    options: dict[str, Any],
    isolate: str,
    horizon: str,
    processes: int,
) -> None:
    """The longer run is stepped by compiled code in that process as well: the bits are those of the harness."""

    def written(fmu: Path, isolate: str) -> Path:
        plant = f'<plant id="car" fmu="{fmu}" isolate="{isolate}" time_limit="30 s"/>'
        return scenario(tmp_path / "s.xml", plant, followers=["car", "car"], horizon=horizon)

    with cosim.Simulation(cosim.read_scenario(written(make(**options), isolate))) as run:
        assert len(workers(os.getpid())) == processes
        allowed = os.sched_getaffinity(0)
        found = run.run()
        assert os.sched_getaffinity(0) == allowed
    several = {name: value for name, value in options.items() if name == "interface"}
    expected = cosim.run(written(make(**several), "no"))
    for name in expected.data_vars:
        assert np.array_equal(found[name].values, expected[name].values, equal_nan=True), name


# Who stops --------------------------------------------------------------------------------------------------


class Harness:
    """A harness in a process group of its own, as one that a shell starts."""

    def __init__(self, path: Path, out: Path) -> None:
        self.log = out / "log"
        environment = {**os.environ, "TMPDIR": str(out / "temporary")}
        (out / "temporary").mkdir(exist_ok=True)
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                command(path, out), env=environment, stdout=log, stderr=log, process_group=0
            )

    def wait_for(self, condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + 120.0
        while not condition():
            assert self.process.poll() is None, self.log.read_text()
            assert time.monotonic() < deadline, (self.log.read_text(), self.workers())
            time.sleep(0.1)

    def workers(self) -> list[str]:
        return workers(self.process.pid)

    def waits(self) -> int:
        """Return how often its plants' process has waited, as it does for each step, and hardly before."""
        status = Path("/proc", self.workers()[0].split()[0], "status").read_text()
        return int(status.partition("\nvoluntary_ctxt_switches:")[2].split()[0])

    def gone(self) -> bool:
        """Return whether its plants' processes go within a few seconds."""
        deadline = time.monotonic() + 10.0
        while self.workers() and time.monotonic() < deadline:
            time.sleep(0.1)
        return self.workers() == []


@pytest.fixture(scope="module")
def compiled(make: Make, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Fill the cache with functions that take seconds to compile."""
    folder = tmp_path_factory.mktemp("compiled")
    path = write(folder / "bad.xml", make, MODES[1], 60.0, ("bad", "bad"))
    subprocess.run(command(path, folder), capture_output=True, check=True, timeout=300)


@pytest.fixture
def harness(make: Make, tmp_path: Path, compiled: None) -> Iterator[Callable[..., Harness]]:
    started = []

    def start(limit: float = 60.0, horizon: str = "400 s", **options: Any) -> Harness:
        path = write(tmp_path / "bad.xml", make, MODES[1], limit, ("bad", "bad"), **options)
        path.write_text(path.read_text("utf-8").replace('horizon="0.6 s"', f'horizon="{horizon}"'), "utf-8")
        started.append(Harness(path, tmp_path))
        return started[-1]

    yield start
    for one in started:
        one.process.kill()
        one.process.wait()
        assert one.gone()


def slow(harness: Callable[..., Harness], tmp_path: Path) -> Harness:
    """Return a harness in the midst of a run that takes long."""
    one = harness(behaviour="slow", seconds=0.01, when=0.0)
    one.wait_for(lambda: len(one.workers()) == 1 and (tmp_path / "bad").is_dir())
    one.wait_for(lambda: one.waits() > 100)
    return one


@pytest.mark.parametrize(("number", "group"), [(signal.SIGINT, False), (signal.SIGINT, True), (signal.SIGTERM, False)])
def test_a_signal_in_the_course_of_a_run(
    harness: Callable[..., Harness], tmp_path: Path, number: signal.Signals, group: bool
) -> None:
    """Ctrl-C reaches all processes of the terminal; the plants' processes do not belong to it."""
    one = slow(harness, tmp_path)
    (os.killpg if group else os.kill)(one.process.pid, number)
    assert one.process.wait(60.0) == 130
    assert one.workers() == []
    assert list((tmp_path / "temporary").iterdir()) == []
    result = saved(tmp_path / "bad" / "result.nc")
    assert result.attrs["status"] == "incomplete"
    assert result.samples > 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_all_processes_of_a_run(
    harness: Callable[..., Harness], tmp_path: Path, number: signal.Signals
) -> None:
    """Those of plants leave it to the command, else a plant would have failed."""
    one = slow(harness, tmp_path)
    worker = int(one.workers()[0].split()[0])
    os.kill(worker, number)
    seen = one.waits()
    one.wait_for(lambda: one.waits() > seen + 100)
    one.process.send_signal(number)
    assert one.process.wait(60.0) == 130
    printed = one.log.read_text()
    assert "Traceback" not in printed
    assert json.loads(saved(tmp_path / "bad" / "result.nc").attrs["failure"])["message"] == "interrupted"


@pytest.mark.parametrize("behaviour", ["slow", "daemon_hang"])
def test_a_harness_that_is_killed_leaves_no_process(
    harness: Callable[..., Harness], tmp_path: Path, behaviour: str
) -> None:
    one = slow(harness, tmp_path) if behaviour == "slow" else harness(behaviour=behaviour)
    one.wait_for(lambda: len(one.workers()) >= 1)
    time.sleep(1.0)
    one.process.kill()
    one.process.wait()
    assert one.gone()


def test_ctrl_c_while_plants_start(harness: Callable[..., Harness], tmp_path: Path) -> None:
    one = harness(behaviour="hang", place="instantiate")
    one.wait_for(lambda: len(one.workers()) == 1)
    time.sleep(0.5)
    begin = time.monotonic()
    one.process.send_signal(signal.SIGINT)
    assert one.process.wait(60.0) == 130
    assert time.monotonic() - begin < 10.0, "the plant's time limit is not waited for"
    assert one.workers() == []
    assert list((tmp_path / "temporary").iterdir()) == []


@pytest.mark.skipif(sys.platform != "linux", reason="looks at the processes that Linux shows")
def test_ctrl_c_in_the_moment_in_which_a_process_starts(
    make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Interrupted(subprocess.Popen[bytes]):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            signal.raise_signal(signal.SIGINT)

    path = scenario(tmp_path / "case.xml", f'<plant id="car" fmu="{make(fmi="2.0")}" isolate="process"/>')
    before = Path(f"/proc/self/task/{os.getpid()}/children").read_text()
    monkeypatch.setattr(subprocess, "Popen", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        cosim.Simulation(cosim.read_scenario(path))
    assert Path(f"/proc/self/task/{os.getpid()}/children").read_text() == before


def test_ctrl_c_twice_in_a_step_that_does_not_end(harness: Callable[..., Harness], tmp_path: Path) -> None:
    one = harness(behaviour="hang")
    one.wait_for(lambda: len(one.workers()) == 1 and (tmp_path / "bad").is_dir())
    time.sleep(1.0)
    begin = time.monotonic()
    one.process.send_signal(signal.SIGINT)
    time.sleep(0.3)
    assert one.process.poll() is None, "the first one waits for the end of the tick"
    one.process.send_signal(signal.SIGINT)
    assert one.process.wait(60.0) == 130
    assert time.monotonic() - begin < 20.0, "the plant's time limit is not waited for"
    assert one.workers() == []
    assert saved(tmp_path / "bad" / "result.nc").samples == BEFORE


# What a plant's process answers -----------------------------------------------------------------------------

SPEC = PlantSpec(
    "robot",
    "a.fmu",
    "",
    "2.0",
    "co_simulation",
    "a",
    "",
    (),
    Block((), (), ()),
    Block((1,), (0.0,), (Exchanged("x", "Real"),)),
    1.0,
    time_limit=1.0,
)
HELLO = HEADER.pack(Reply.DONE, 0)
STARTED = HELLO + HEADER.pack(Reply.DONE, 0)
NO_REPLY = "its process answers with bytes that are no reply"


@pytest.fixture
def answering(monkeypatch: pytest.MonkeyPatch, nothing_left: None) -> Iterator[Callable[..., PlantProcess]]:
    """Return a function that starts a process which writes some bytes and then runs a program."""
    processes = []

    def start(answer: bytes, program: str = "sys.stdin.read()") -> PlantProcess:
        code = f"import os, subprocess, sys, time\nos.write(1, {answer!r})\n{program}"
        monkeypatch.setattr(cosim.plant.process, "WORKER", ("-c", code))
        processes.append(PlantProcess([SPEC]))
        return processes[-1]

    yield start
    begin = time.monotonic()
    for process in processes:
        process.close()
    assert time.monotonic() - begin < 3.0
    assert all(process._process.returncode is not None for process in processes)


def reason(call: Callable[[], object]) -> str:
    with pytest.raises(PlantError) as caught:
        call()
    return str(caught.value)


def reply(kind: Reply, told: object) -> bytes:
    body = json.dumps(told).encode()
    return HEADER.pack(kind, len(body)) + body


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (b"", "its process did not start: its process exited with status 3"),
        (HELLO, "it did not start: its process exited with status 3"),
        (HELLO[:3], "its process did not start: its process exited"),
        (b"nonsense of many bytes", f"its process did not start: {NO_REPLY}"),
        (HELLO + HEADER.pack(Reply.DONE, 7) + bytes(7), f"it did not start: {NO_REPLY}"),
        (HELLO + HEADER.pack(Reply.DONE, 2**32 - 1), f"it did not start: {NO_REPLY}"),
        (HELLO + HEADER.pack(Reply.DONE, 100) + bytes(8), "it did not start: its process exited with status 3"),
        (HELLO + HEADER.pack(99, 0), f"it did not start: {NO_REPLY}"),
        (HELLO + reply(Reply.DONE, [0, "it \x1b[31m", False]), "it ?[31m"),
        (HELLO + reply(Reply.DONE, [9, "it", False]), f"it did not start: {NO_REPLY}"),
        (HELLO + reply(Reply.DONE, {"a": 1}), f"it did not start: {NO_REPLY}"),
        (HELLO + reply(Reply.FAILED, "what"), "what"),
    ],
)
def test_other_answers_when_it_starts(answering: Callable[..., PlantProcess], answer: bytes, sentence: str) -> None:
    process = answering(answer, "sys.exit(3)")
    assert reason(process.wait_until_started).startswith(sentence)


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize(
    ("program", "sentence"),
    [
        ("os.write(1, b'nonsense of many bytes')", NO_REPLY),
        (f"os.write(1, {HEADER.pack(99, 0)!r})", NO_REPLY),
        ("sys.exit(3)", "its process exited with status 3"),
        ("os.close(1); time.sleep(100)", "its process has closed the pipe to the harness"),
    ],
)
def test_other_answers_to_a_step(
    answering: Callable[..., PlantProcess],
    monkeypatch: pytest.MonkeyPatch,
    program: str,
    sentence: str,
    compiled: bool,
) -> None:
    monkeypatch.setattr(cosim.plant.companion, "_EXIT_LIMIT", 0.2)
    process = answering(STARTED, f"frame = sys.stdin.buffer.read(5)\n{program}\nsys.stdin.read()")
    process.wait_until_started()
    if compiled:
        places = np.arange(0), np.arange(1)
        bells = bells_of(process.bell, [process.board], [places], np.zeros(0), np.zeros(1))
        ring(bells.bells, bells.gives, 0.0, 0.02)
        while process.heard == Heard.NOTHING:
            listen(bells.bells, bells.takes)
        assert process.heard in (Heard.GONE, Heard.NONSENSE)
    else:
        process.begin(0.0, 0.02)
        process.finish()
    assert process.failures() == {0: f"did not complete the step: {sentence}"}


def test_messages_without_end(make: Make, run: Run) -> None:
    status, printed, _ = run(MODES[1], LIMIT, behaviour="log_million", lines=100_000_000)
    assert status == 3
    assert "did not complete the step within 0.5 s; its process was ended; it had logged: " in printed
    assert len(printed) < 25_000


def test_an_interpreter_that_does_not_come(
    answering: Callable[..., PlantProcess], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cosim.plant.companion, "_LAUNCH_LIMIT", 0.2)
    plant = answering(b"", "time.sleep(100)")
    assert reason(plant.wait_until_started) == "its process did not start within 0.2 s; its process was ended"


def test_what_a_plant_starts_is_ended_with_it(answering: Callable[..., PlantProcess]) -> None:
    program = "p = subprocess.Popen(['sleep', '1000']); open(PATH, 'w').write(str(p.pid)); sys.stdin.read()"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pid"
        plant = answering(STARTED, program.replace("PATH", repr(str(path))))
        plant.wait_until_started()
        while not (path.exists() and path.read_text()):
            time.sleep(0.01)
        grandchild = int(path.read_text())
        plant.close()
    deadline = time.monotonic() + 5.0
    while Path(f"/proc/{grandchild}").exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    with pytest.raises(ProcessLookupError):
        os.kill(grandchild, 0)


def test_no_more_processes(monkeypatch: pytest.MonkeyPatch, make: Make, tmp_path: Path, nothing_left: None) -> None:
    def fails(*_: object, **__: object) -> None:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    path = write(tmp_path / "bad.xml", make, MODES[1], 30.0, ("bad",))
    with monkeypatch.context() as patch:
        patch.setattr(subprocess, "Popen", fails)
        with pytest.raises(InputError, match="its process cannot be started: Resource temporarily unavailable"):
            cosim.run(path)
