"""`formation run --live`: the run is the same, and ends with Ctrl-C, with its viewers, or at once without any."""

import json
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from cosim.cli import main
from cosim.tests.driving import scenario

from .commands import command, failed
from .live_viewer import LiveRun, live_run

client = pytest.importorskip("websockets.sync.client")
from websockets.exceptions import ConnectionClosed  # noqa: E402

SHORT = ("--horizon", "1 s", "--no-expectations")


@contextmanager
def watching(run: LiveRun) -> Iterator[Callable[[str], dict[str, Any]]]:
    """Watch a run; yield a function that waits for a message of a kind."""
    address = urlsplit(run.address)
    origin = f"http://{address.netloc}"
    url = f"ws://{address.netloc}{address.path}feed"
    options: Any = {"max_size": None, "compression": None, "open_timeout": 60, "close_timeout": 1}
    with client.connect(url, origin=origin, **options) as socket:

        def until(kind: str, **having: Any) -> dict[str, Any]:
            while True:
                message = socket.recv(timeout=120)
                if isinstance(message, bytes):
                    ticks = int.from_bytes(message[12:16], "little")
                    if kind == "ticks" and ticks >= having.get("least", 0):
                        return {"ticks": ticks}
                    continue
                told: dict[str, Any] = json.loads(message)
                if told["kind"] == kind and having.items() <= told.items():
                    return told

        until.send = socket.send  # type: ignore[attr-defined]
        yield until


def test_nobody_watches(line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It prints the address, does not wait for a viewer where there is no terminal, and gives the same file."""
    command(capsys, "run", line, *SHORT, "--out", tmp_path / "plain", "--no-figure")
    _, said = command(capsys, "run", line, *SHORT, "--out", tmp_path / "live", "--no-figure", "--live")
    assert said.startswith("live page: http://127.0.0.1:")
    files = [(tmp_path / name / "clmr_line" / "result.nc").read_bytes() for name in ("plain", "live")]
    assert files[0] == files[1]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--live", "--pace", "0"], "--pace 0: the pace is 0; it must be a positive number"),
        (["--live", "--port", "70000"], "port 70000 does not exist: ports go from 1 to 65535"),
        (["--port", "8000"], "--port is about the live page: add --live, or leave it out"),
        (["--open"], "--open is about the live page"),
        (["--paused"], "--paused is about the live page"),
    ],
)
def test_bad_input(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], sentence: str
) -> None:
    assert sentence in failed(capsys, 2, "run", line, *SHORT, "--out", str(tmp_path), *options)
    assert not (tmp_path / "clmr_line").exists()


def test_without_a_display_no_browser_is_opened(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("webbrowser.open", lambda address: pytest.fail("a browser was opened"))
    said = failed(capsys, 0, "run", line, *SHORT, "--out", str(tmp_path), "--no-figure", "--live", "--open")
    assert "there is no display here, so no browser was opened" in said


def test_a_browser_is_opened_if_it_is_asked_for(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("cosim.cli.watching._PATIENCE_FOR_A_BROWSER", 0.1)
    monkeypatch.setattr("webbrowser.open", opened.append)
    said = failed(capsys, 0, "run", line, *SHORT, "--out", str(tmp_path), "--no-figure", "--live", "--open")
    assert opened
    assert f"live page: {opened[0]}\n" in said


def test_ctrl_c_ends_a_paused_run_and_its_page(line: str, tmp_path: Path) -> None:
    with live_run(tmp_path, line, "--paused", "--no-expectations") as run:
        with watching(run) as until:
            until("ticks", least=1)
            run.process.send_signal(signal.SIGINT)
            end = until("end")["run"]
            assert end["status"] == "incomplete"
            assert end["samples"] == 1
            assert "interrupted" in end["failure"]["text"]
            with pytest.raises(ConnectionClosed):
                until("next")
        assert run.process.wait(60) == 130
        assert (tmp_path / "clmr_line" / "result.nc").exists()


def test_ctrl_c_after_the_end_keeps_the_exit_status(line: str, tmp_path: Path) -> None:
    """The page stays as long as somebody looks at it, or until Ctrl-C."""
    late = ("--set=//rms/@from=0.5 s", "--set=//settled/@by=0.5 s", "--horizon", "1 s")
    with live_run(tmp_path, line, *late, "--paused") as run, watching(run) as until:
        until("ticks", least=1)
        until.send("go on")  # type: ignore[attr-defined]
        assert until("end")["run"]["verdicts"]
        while "results in" not in run.said:
            time.sleep(0.02)
        time.sleep(0.5)
        run.process.send_signal(signal.SIGINT)
        with pytest.raises(ConnectionClosed):
            until("next")
        assert run.process.wait(60) == 1


def test_it_ends_when_the_last_viewer_has_left(line: str, tmp_path: Path) -> None:
    with live_run(tmp_path, line, *SHORT, "--paused") as run:
        with watching(run) as until:
            until("ticks", least=1)
            until.send("go on")  # type: ignore[attr-defined]
            until("end")
            assert run.process.poll() is None
        assert run.process.wait(60) == 0


@pytest.mark.skipif(sys.platform != "linux", reason="a process is forked on Linux alone")
def test_a_run_in_a_supervised_process(make: Callable[..., Path], tmp_path: Path) -> None:
    """Pausing and stepping work there, and what is recorded there is seen here."""
    file = scenario(tmp_path / "run.xml", f'<plant id="car" fmu="{make()}"/>', followers=["car"], horizon="1 s")
    assert main(["run", str(file), "--out", str(tmp_path / "plain"), "--no-figure"]) == 0
    with live_run(tmp_path, str(file), "--paused") as run:
        with watching(run) as until:
            assert until("ticks", least=1) == {"ticks": 1}
            for ticks in (2, 3):
                until.send("step")  # type: ignore[attr-defined]
                assert until("ticks", least=2) == {"ticks": ticks}
            until.send("go on")  # type: ignore[attr-defined]
            assert until("end")["run"]["samples"] == 51
        assert run.process.wait(60) == 0
    files = [folder / "run" / "result.nc" for folder in (tmp_path / "plain", tmp_path)]
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.skipif(sys.platform != "linux", reason="a process is forked on Linux alone")
def test_an_fmu_that_crashes(make: Callable[..., Path], tmp_path: Path) -> None:
    crashing = make(name="bad", behaviour="segfault", when=0.5)
    file = scenario(tmp_path / "run.xml", f'<plant id="car" fmu="{crashing}"/>', followers=["car"], horizon="1 s")
    with live_run(tmp_path, str(file), "--paused") as run:
        with watching(run) as until:
            until("ticks", least=1)
            until.send("go on")  # type: ignore[attr-defined]
            end = until("end")["run"]
            assert end["status"] == "incomplete"
            assert end["failure"]["time"] == pytest.approx(0.5)
            assert "crashed" in end["failure"]["text"]
        assert run.process.wait(60) == 3


def test_one_scenario_after_the_other(line: str, scenarios: Path, tmp_path: Path) -> None:
    other = str(scenarios / "convoy.xml")
    with live_run(tmp_path, line, other, *SHORT, "--paused") as run:
        with watching(run) as until:
            assert until("begin")["run"]["name"] == "clmr_line"
            until.send("go on")  # type: ignore[attr-defined]
            until("next")
        with watching(run) as until:
            assert until("begin")["run"]["name"] == "convoy"
            until.send("go on")  # type: ignore[attr-defined]
            until("end")
        assert run.process.wait(60) == 0
