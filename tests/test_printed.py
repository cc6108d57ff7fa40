"""What FMUs print in the process that is supervised: through the log, limited, without characters that control."""

import logging
import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import cosim
from cosim.plant.printed import CHARACTERS, LINES, Printed
from cosim.tests.driving import scenario


def said(data: bytes, caplog: pytest.LogCaptureFixture) -> list[str]:
    """Return what the log shows of what is printed."""
    printed = Printed("car.fmu")
    pipe = printed.of(os.dup)
    with os.fdopen(pipe, "wb") as file:
        file.write(data)
    printed.close()
    return [record.getMessage() for record in caplog.records]


def test_what_controls_a_terminal_is_shown_as_a_question_mark(caplog: pytest.LogCaptureFixture) -> None:
    data = "a\x1b[2J\x9b1m\u202eb\r\nc\x00\n".encode() + b"\xff\nlast"
    shown = ["car.fmu: a?[2J?1m?b", "car.fmu: c?", "car.fmu: \ufffd", "car.fmu: last"]
    assert said(data, caplog) == shown


def test_long_lines_are_cut(caplog: pytest.LogCaptureFixture) -> None:
    (first, second) = said(b"x" * 1_000_000 + b"\nnext\n", caplog)
    assert first == f"car.fmu: {'x' * CHARACTERS}..."
    assert second == "car.fmu: next"


def test_the_first_lines_are_shown(caplog: pytest.LogCaptureFixture) -> None:
    lines = said(b"y\n" * 200_000, caplog)
    assert lines[:-1] == ["car.fmu: y"] * LINES
    assert lines[-1] == f"car.fmu prints more than {LINES} lines; the others are not shown"


def test_what_is_logged_in_the_process_keeps_its_name(caplog: pytest.LogCaptureFixture) -> None:
    """It may come after a line that is begun, and does not count among those that are printed."""
    printed = Printed("car.fmu")
    data = f"begun{printed.mark}cosim.controller law: a\x1b\n{printed.mark}cosim.fmu other.fmu: b\nc\n"
    data += f"{printed.mark}root x\n" + f"{printed.mark}cosim.fmu d\n" * (LINES + 1) + "e\n"
    pipe = printed.of(os.dup)
    with os.fdopen(pipe, "wb") as file:
        file.write(data.encode())
    printed.close()
    found = [(record.name, record.getMessage()) for record in caplog.records]
    assert sorted(found[:2]) == [("cosim.controller", "law: a?"), ("cosim.fmu", "car.fmu: begun")]
    assert found[2:4] == [("cosim.fmu", "other.fmu: b"), ("cosim.fmu", "car.fmu: c")]
    assert found[4:] == [("cosim.fmu", "d")] * (LINES + 1) + [("cosim.fmu", "car.fmu: e")]


def test_who_holds_the_pipe_is_not_waited_for() -> None:
    printed = Printed("car.fmu")
    pipe = printed.of(os.dup)
    printed.close()  # returns
    with pytest.raises(BrokenPipeError):
        os.write(pipe, b"late\n")
    os.close(pipe)


def test_what_is_printed_is_lost_where_no_thread_can_start(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(_: object) -> None:
        raise RuntimeError("can't start new thread")

    printed = Printed("car.fmu")
    monkeypatch.setattr("threading.Thread.start", fails)
    pipe = printed.of(os.dup)
    assert os.write(pipe, b"lost\n") == 5
    printed.close()
    os.close(pipe)


@pytest.mark.skipif(sys.platform != "linux", reason="a process is supervised on Linux alone")
def test_a_supervised_fmu_prints_to_the_log(
    make: Callable[..., Path], tmp_path: Path, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    fmu = make(name="car", behaviour="print", when=0.1)
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}"/>', followers=["car"], horizon="0.2 s")
    with caplog.at_level(logging.WARNING):
        cosim.run(path)
    assert {f"car.fmu: {robot} prints at t = 0.1 s" for robot in ("leader", "follower_1")} <= set(caplog.messages)
    assert "prints at" not in capfd.readouterr().out
