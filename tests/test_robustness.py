"""Computed results survive their reader, an interrupt, and foreign files."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from formation_controllers import Signal
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePid

import cosim
import cosim.cli.run
import cosim.master.recorded_result
from cosim.cli import main
from cosim.master.loop import Loop, Part, advance
from cosim.results.figure_process import PROGRAM
from cosim.results.files import load
from cosim.tests import driving

from .commands import failed

SHORT = [*driving.SHORT, "--no-figure"]
POSIX_SIGNALS = [] if sys.platform == "win32" else [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
FORMATION = str(Path(sys.executable).with_name("formation"))


# Who reads --------------------------------------------------------------------------------------------------


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="the system has no disk that is always full")
def test_output_that_a_full_disk_refuses_is_no_success() -> None:
    done = subprocess.run(["bash", "-c", f"{FORMATION} list >/dev/full"], capture_output=True, text=True, check=False)
    assert done.returncode == 71
    assert done.stderr == "error: standard output cannot be written: No space left on device\n"


@pytest.mark.skipif(sys.platform == "win32", reason="needs a POSIX shell")
@pytest.mark.parametrize(
    "shell",
    [
        "{run} | true; exit ${{PIPESTATUS[0]}}",
        "{run} | head -1 >/dev/null; exit ${{PIPESTATUS[0]}}",
        "{run} >&-",
        "{run} 2>&-",
        "{run} >/dev/full" if os.path.exists("/dev/full") else "{run} >/dev/null",
        "PYTHONIOENCODING=ascii {run} --set '//title=编队 \U0001f697'",
        "LC_ALL=C PYTHONUTF8=0 PYTHONCOERCECLOCALE=0 {run} --set '//title=Flotte [red] $\\frac{{1}}{{$'",
    ],
)
def test_the_result_does_not_depend_on_who_reads_what_is_printed(line: str, tmp_path: Path, shell: str) -> None:
    short = " ".join(f"'{argument}'" for argument in SHORT)
    command = shell.format(run=f"{FORMATION} run {line} --out {tmp_path} {short}")
    done = subprocess.run(["bash", "-c", command], capture_output=True, timeout=300, check=False)
    assert b"Traceback" not in done.stderr
    assert done.returncode == 1, "the expectations fail after 1 s"
    assert sorted(path.name for path in (tmp_path / "clmr_line").iterdir()) == [
        "report.html",
        "result.nc",
        "summary.json",
    ]


def test_a_title_in_any_letters_can_be_drawn(line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    title = "//title=编队 \U0001f697 $\\frac{1}{$"
    assert main(["run", line, "--out", str(tmp_path), "--set", title, *SHORT[:-1]]) == 1
    assert capsys.readouterr().err == ""
    assert (tmp_path / "clmr_line" / "figure.png").exists()


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ("import os; os._exit(7)", "its process ended with status 7"),
        ("import sys; sys.modules['matplotlib'] = None", "ModuleNotFoundError: "),
        (
            "import matplotlib.figure; matplotlib.figure.Figure.savefig = lambda *_, **__: 1 / 0",
            "ZeroDivisionError: division by zero",
        ),
    ],
)
def test_a_figure_that_cannot_be_drawn_costs_nothing_else(
    line: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    fault: str,
    sentence: str,
) -> None:
    monkeypatch.setattr("cosim.results.figure_process.PROGRAM", f"{fault}; {PROGRAM}")
    printed = failed(capsys, 1, "run", line, "--out", str(tmp_path), *SHORT[:-1])
    assert f"warning: the figure could not be drawn: {sentence}" in printed
    assert not (tmp_path / "clmr_line" / "figure.png").exists()
    assert load(tmp_path / "clmr_line" / "result.nc").attrs["status"] == "completed"
    assert (tmp_path / "clmr_line" / "summary.json").exists()


# Who stops --------------------------------------------------------------------------------------------------


def test_ctrl_c_in_a_text_that_is_executed(tmp_path: Path) -> None:
    """As where a dataclass is made. Python notes it, and would end itself by SIGINT in the end."""
    program = 'from cosim import cli\ncli._function = lambda _: exec("raise KeyboardInterrupt")\ncli.entry()\n'
    (tmp_path / "interrupted.py").write_text(program, encoding="utf-8")
    command = [sys.executable, "-m", "interrupted", "list"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "interrupted\n")


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.parametrize(("number", "times"), [*((number, 1) for number in POSIX_SIGNALS), (signal.SIGINT, 1000)])
def test_a_signal_to_the_process(line: str, tmp_path: Path, number: int, times: int) -> None:
    """The signal comes when the run has begun; all that the process made apart from its results is gone afterwards.

    However often it comes, the result is written and the exit status is right.
    """
    started = tmp_path / "started"
    program = f"""
import pathlib, sys, time
from cosim.cli import entry
from cosim.master.ticks import Ticks
original = Ticks.some
def some(self, most):
    time.sleep(0.001)
    possible = original(self, min(most, 10))
    if self.tick >= 10:
        pathlib.Path({str(started)!r}).touch()
    return possible
Ticks.some = some
sys.argv[1:] = ["run", {line!r}, "--out", {str(tmp_path)!r}, "--set", "//simulation/@horizon=2000 s"]
entry()
"""
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    process = subprocess.Popen([sys.executable, "-c", program], env=environment, stderr=subprocess.PIPE, text=True)
    while not started.exists() and process.poll() is None:
        time.sleep(0.01)
    for _ in range(times):
        process.send_signal(number)
        time.sleep(0.01)
        if process.poll() is not None:
            break
    _, printed = process.communicate(timeout=300)
    assert process.returncode == 130
    assert "Traceback" not in printed
    result = load(tmp_path / "clmr_line" / "result.nc")
    assert 10 <= result.sizes["time"] < 100_000
    assert result.attrs["status"] == "incomplete"
    if times == 1:  # otherwise what is left may be cut short: the next run removes what an FMU left
        assert "interrupted" in printed
        assert list(tmp_path.glob("formation-*")) == []


@pytest.mark.parametrize(
    ("place", "told"),
    [
        ("cosim.master.recorded_result.who_is_who", "interrupted at t = 1 s"),
        ("cosim.cli.run.save", "interrupted at t = 1 s"),
        ("cosim.cli.run.summarise", "the run was ended"),
    ],
)
def test_a_signal_while_the_result_is_made_or_written(
    line: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    place: str,
    told: str,
) -> None:
    module, name = place.rsplit(".", 1)
    original: Callable[..., object] = getattr(import_module(module), name)

    def interrupted(*arguments: object) -> object:
        signal.raise_signal(signal.SIGINT)
        return original(*arguments)

    monkeypatch.setattr(sys.modules[module], name, interrupted)
    junit = tmp_path / "verdicts.xml"
    assert "ended early" not in failed(capsys, 130, "run", line, "--out", str(tmp_path), "--junit", str(junit), *SHORT)
    assert told in junit.read_text(encoding="utf-8")
    assert load(tmp_path / "clmr_line" / "result.nc").sizes["time"] == 51


@pytest.fixture
def ignored() -> Iterator[None]:
    """Ignore signals as a command does that a script starts in the background, or that nohup starts."""
    before = {number: signal.signal(number, signal.SIG_IGN) for number in POSIX_SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", POSIX_SIGNALS[::2])
@pytest.mark.parametrize("name", ["whole_run", "summarise"])
def test_a_signal_that_was_ignored_before(
    line: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    ignored: None,
    number: signal.Signals,
    name: str,
) -> None:
    """It interrupts at any moment, or at none: nohup keeps SIGHUP away."""
    original: Callable[..., object] = getattr(cosim.cli.run, name)

    def interrupted(*arguments: object) -> object:
        signal.raise_signal(number)
        return original(*arguments)

    monkeypatch.setattr(cosim.cli.run, name, interrupted)
    failed(capsys, 1 if number == signal.SIGHUP else 130, "run", line, "--out", str(tmp_path), *SHORT)
    assert [signal.getsignal(number) for number in POSIX_SIGNALS] == [signal.SIG_IGN] * 3
    assert (tmp_path / "clmr_line" / "result.nc").exists() == (number == signal.SIGHUP or name != "whole_run")


def test_signals_are_heard() -> None:
    """Tests send them to themselves and to what they start."""
    assert signal.SIG_IGN not in [signal.getsignal(number) for number in POSIX_SIGNALS]


@pytest.mark.skipif(sys.platform == "win32", reason="has no such signals")
def test_signals_are_heard_where_whoever_starts_the_tests_ignores_them() -> None:
    """As a script that starts them in the background does, and nohup."""
    test = f"{__file__}::{test_signals_are_heard.__name__}"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", test]
    ignoring = ["sh", "-c", """trap '' INT TERM HUP; exec "$@" """, "sh", *command]
    assert "1 passed" in subprocess.run(ignoring, capture_output=True, text=True, check=False).stdout


def test_a_signal_before_the_first_tick(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """While the folder of the results is made: the run does not go on to its horizon first."""
    original = cosim.cli.run.writable_folder

    def interrupted(*arguments: Any) -> Path:
        signal.raise_signal(signal.SIGINT)
        return original(*arguments)

    monkeypatch.setattr(cosim.cli.run, "writable_folder", interrupted)
    failed(capsys, 130, "run", line, "--out", str(tmp_path), *SHORT)
    assert load(tmp_path / "clmr_line" / "result.nc").sizes["time"] == 0


@pytest.mark.parametrize("number", POSIX_SIGNALS)
def test_many_signals_at_once(
    line: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    number: signal.Signals,
) -> None:
    """Where the second one ends the tick, others find the recorded data safe."""
    made = cosim.master.recorded_result.who_is_who

    def never_ends(loop: Loop, parts: int, first: int, last: int) -> tuple[int, int]:
        if first == 5 and parts == Part.SENSE:
            for _ in range(2):
                signal.raise_signal(number)
            pytest.fail("the second signal should have ended this tick")
        return advance(loop, parts, first, last)

    def disturbed(*arguments: Any) -> object:
        for _ in range(5):
            signal.raise_signal(number)
        return made(*arguments)

    monkeypatch.setattr("cosim.master.recorded_result.who_is_who", disturbed)
    monkeypatch.setattr("cosim.master.ticks.advance", never_ends)
    monkeypatch.setattr("cosim.master.ticks.Ticks.some", lambda ticks, most: False)
    failed(capsys, 130, "run", line, "--out", str(tmp_path), *SHORT)
    assert load(tmp_path / "clmr_line" / "result.nc").sizes["time"] == 5


def test_a_signal_and_a_failure(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The failure is told, and no further scenario is run."""

    def fails(loop: Loop, parts: int, first: int, last: int) -> tuple[int, int]:
        if first == 5 and parts == Part.SENSE:
            signal.raise_signal(signal.SIGINT)
            raise RuntimeError("made up")
        return advance(loop, parts, first, last)

    monkeypatch.setattr("cosim.master.ticks.advance", fails)
    monkeypatch.setattr("cosim.master.ticks.Ticks.some", lambda ticks, most: False)
    other = line.replace("clmr_line", "clmr_circle")
    printed = failed(capsys, 130, "run", line, other, "--out", str(tmp_path), *SHORT)
    assert "made up" in printed
    assert load(tmp_path / "clmr_line" / "result.nc").sizes["time"] == 5
    assert not (tmp_path / "clmr_circle").exists()


def test_a_second_ctrl_c_ends_a_tick_that_does_not_end(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def never_ends(loop: Loop, parts: int, first: int, last: int) -> tuple[int, int]:
        if first == 5 and parts == Part.SENSE:
            for _ in range(2):
                signal.raise_signal(signal.SIGINT)
            pytest.fail("the second signal should have ended this tick")
        return advance(loop, parts, first, last)

    monkeypatch.setattr("cosim.master.ticks.advance", never_ends)
    monkeypatch.setattr("cosim.master.ticks.Ticks.some", lambda ticks, most: False)
    failed(capsys, 130, "run", line, "--out", str(tmp_path), *SHORT)
    assert load(tmp_path / "clmr_line" / "result.nc").sizes["time"] == 5


# What strangers bring ---------------------------------------------------------------------------------------


class Law(NeuralAdaptivePid):
    """A law with one fault after the other."""


def raising(error: BaseException) -> Callable[..., object]:
    def method(*_: object, **__: object) -> object:
        raise error

    return method


def run_with(law: type, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    monkeypatch.setattr("formation_controllers.Installed.load", lambda _installed: law)
    return ["run", line, "--out", str(tmp_path), *SHORT]


@pytest.mark.parametrize(
    ("method", "fault", "sentence"),
    [
        ("step", raising(SystemExit(0)), "failed: SystemExit: 0"),
        ("step", raising(KeyError("gain")), "failed: KeyError: 'gain'"),
        ("step", lambda *_: np.zeros(3), "it returned torques of shape (3,), not (4, 2)"),
        ("step", lambda *_: "fast", "failed: ValueError"),
        ("step", lambda *_: np.full((4, 2), np.inf), "follower_1 at t = 0 s: "),
        ("start", raising(RuntimeError("no")), "failed: RuntimeError: no"),
        ("telemetry_record", property(raising(RuntimeError("no"))), "failed: RuntimeError: no"),
        (
            "telemetry_record",
            np.zeros(4, [("weight_norm", float)]),
            "its telemetry is ('weight_norm',), not the signals",
        ),
    ],
)
def test_laws_that_fail(
    line: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    method: str,
    fault: object,
    sentence: str,
) -> None:
    law = type("Law", (NeuralAdaptivePid,), {method: fault})
    printed = failed(capsys, 3, *run_with(law, line, tmp_path, monkeypatch))
    assert sentence in printed
    assert load(tmp_path / "clmr_line" / "result.nc").sizes["time"] == 0


@pytest.mark.parametrize(
    ("attributes", "sentence"),
    [
        ({"__init__": raising(KeyError("x"))}, "controller 'pid': KeyError: 'x'"),
        ({"__init__": raising(SystemExit("no licence"))}, "controller 'pid': SystemExit: no licence"),
        ({"gains_type": type("G", (), {"from_mapping": raising(SystemExit(0))})}, "controller 'pid': SystemExit: 0"),
        ({"vehicles": ("boat",)}, "boat"),
        ({"signals": (Signal("pose", "m", "mine"),)}, "its signal 'pose' has the name of another in the result"),
        ({"signals": (Signal("time", "s", "mine"),)}, "its signal 'time' has the name of another in the result"),
        ({"signals": (Signal("pose_component", "s", "mine"),)}, "its signal 'pose_component'"),
    ],
)
def test_laws_that_do_not_fit(
    line: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    attributes: dict[str, object],
    sentence: str,
) -> None:
    law = type("Law", (NeuralAdaptivePid,), attributes)
    printed = failed(capsys, 2, *run_with(law, line, tmp_path, monkeypatch))
    assert sentence in printed


@pytest.mark.parametrize("method", ["compiled_tick", "reset"])
def test_a_law_that_exits_where_it_may_refuse(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    """It is stepped from Python, or made anew for the next run."""
    run_with(type("Law", (NeuralAdaptivePid,), {method: raising(SystemExit(0))}), line, tmp_path, monkeypatch)
    short = cosim.read_scenario(line).edited(horizon=0.1, expectations=False)
    with cosim.Prepared(short, ["pose"]) as prepared:
        first, second = (prepared.run().result for _ in range(2))
    assert first is not None
    assert second is not None
    assert len(first["pose"].values) == 6
    assert np.array_equal(first["pose"].values, second["pose"].values)


def test_a_fault_of_the_master_loses_nothing_either(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def breaks(loop: Loop, parts: int, first: int, last: int) -> tuple[int, int]:
        if first > 7:
            raise IndexError("off by one")
        return advance(loop, parts, first, min(last, 8))

    monkeypatch.setattr("cosim.master.ticks.advance", breaks)
    printed = failed(capsys, 3, "run", line, "--out", str(tmp_path), *SHORT)
    assert "the master at t = 0.16 s: IndexError: off by one" in printed
    assert load(tmp_path / "clmr_line" / "result.nc").sizes["time"] == 8


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('encoding="UTF-8"', 'encoding="bogus-9"', "declares an encoding that does not fit"),
        ('seed="1"', f'seed="{"9" * 5000}"', "is not a whole number from 0 to 2^63 - 1"),
        ('value="30 kg"', 'value="30 Mg99999999/Mg99999998"', "is not a symbol with an exponent"),
        ("<sensor>", '<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="x"/><sensor>', "is not part of"),
        ("<title>", '<title lang="en">', "<title> has no attribute 'lang'"),
    ],
)
def test_scenarios_from_strangers(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, sentence: str
) -> None:
    text = Path(line).read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "stranger.xml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    for command in ("run", "check"):
        assert sentence in failed(capsys, 2, command, str(path))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="POSIX pipes")
def test_a_pipe_is_no_file_to_wait_for(line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert "is not a regular file" in failed(capsys, 2, "check", str(pipe))
    assert "is not a regular file" in failed(capsys, 2, "check", line, "--plant", f"clmr={pipe}")


@pytest.mark.parametrize(
    "replacement", ["//title=\u0001", "//title=\udcff", "//parameter[1]/@value=\ufffe", "//gain[1]/@name=\x1b[31m"]
)
def test_replacements_that_xml_cannot_hold(line: str, capsys: pytest.CaptureFixture[str], replacement: str) -> None:
    printed = failed(capsys, 2, "check", line, "--set", replacement)
    assert "--set" in printed
    assert "\x1b" not in printed


@pytest.mark.parametrize(
    "arguments",
    [
        ["--set", "//gain[1]/@name=K_q"],
        ["--set", "//parameter[2]/@value=-30 kg"],
        ["--set", "//parameter[2]/@name=m_q"],
        ["--set", "//rms[1]/@signal=pose"],
        ["--plant", "clmr=none.fmu"],
        ["--seed", "-1"],
    ],
)
def test_check_refuses_what_run_refuses(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    checked = failed(capsys, 2, "check", line, *arguments)
    ran = failed(capsys, 2, "run", line, "--out", str(tmp_path), *arguments)
    assert checked == ran
