"""A process ends with everything that it has started, wherever that has gone."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress

import pytest

from cosim import process_tree
from cosim.plant import interpreter

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")

Start = Callable[..., tuple[subprocess.Popen[str], str, int]]

LEAVES_ONE = """
import os, sys, time
from cosim import process_tree
from cosim.plant import interpreter
def daemon():
    if os.fork() == 0:
        os.setsid()
        if os.fork() == 0:
            print(os.getpid(), flush=True)
            return True
        os._exit(0)
    os.wait()
    return False
"""


@pytest.fixture
def start() -> Iterator[Start]:
    """Start a program that leaves a process behind; return its process, its mark, and the number of the other one."""
    started: list[tuple[subprocess.Popen[str], int]] = []

    def made(program: str) -> tuple[subprocess.Popen[str], str, int]:
        mark = process_tree.new_mark()
        process = subprocess.Popen(
            [sys.executable, "-c", LEAVES_ONE + program],
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, mark: "1"},
            start_new_session=True,
        )
        assert process.stdout is not None
        left = int(process.stdout.readline())
        started.append((process, left))
        return process, mark, left

    yield made
    for process, left in started:
        for number in (process.pid, left):
            if process.returncode is None or number != process.pid:
                with suppress(ProcessLookupError):
                    os.kill(number, signal.SIGKILL)
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


def lives(process: int) -> bool:
    """Return whether a process lives, given that its end takes a moment."""
    for _ in range(500):
        if process_tree._state(process) in ("Z", ""):
            return False
        time.sleep(0.01)
    return True


def test_what_has_left_the_group(start: Start) -> None:
    process, mark, left = start("process_tree.adopt()\nif daemon(): time.sleep(1000)\ntime.sleep(1000)")
    process_tree.end(process.pid, mark)
    assert process.wait(30) == -signal.SIGKILL
    assert not lives(left)


def test_without_its_environment(start: Start) -> None:
    """While what started it lives, the mark is not needed."""
    process, mark, left = start(
        "process_tree.adopt()\nif daemon(): os.execve('/bin/sleep', ['sleep', '1000'], {})\ntime.sleep(1000)"
    )
    process_tree.end(process.pid, mark)
    assert not lives(left)


def test_what_is_left_behind_during_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second process ends after the children of the first one were listed: the third becomes one of these."""
    ended, searches = {2}, iter([[2], *[[2, 3]] * 3])
    monkeypatch.setattr(process_tree, "_descendants", lambda root: next(searches))
    monkeypatch.setattr(process_tree, "_state", lambda process: "Z" if process in ended else "S")
    monkeypatch.setattr(process_tree, "_signal", lambda process, number: ended.add(process))
    assert process_tree.end_descendants(1)
    assert ended == {2, 3}


def test_of_a_process_that_has_ended(start: Start) -> None:
    process, mark, left = start("process_tree.adopt()\nif daemon(): time.sleep(1000)\nos._exit(3)")
    deadline = time.monotonic() + 30
    while process_tree._state(process.pid) != "Z" and time.monotonic() < deadline:
        time.sleep(0.01)
    process_tree.end(process.pid, mark)
    assert process.wait(30) == 3, "its own status is kept"
    assert not lives(left)


def test_what_starts_more_and_more(start: Start) -> None:
    """Each goes on in a session of its own before it is found; the one that began is stopped first."""
    chain = "    while os.fork() == 0: os.setsid(); time.sleep(0.02)\n    os._exit(0)"
    process, mark, _ = start(f"process_tree.adopt()\nif daemon():\n{chain}\ntime.sleep(1000)")
    process_tree.end(process.pid, mark)
    assert process.wait(30) == -signal.SIGKILL
    time.sleep(0.1)
    assert process_tree._marked(mark, "") == []


def test_nothing_else_is_touched() -> None:
    other = subprocess.Popen(["sleep", "1000"], start_new_session=True)
    mark = process_tree.new_mark()
    process = subprocess.Popen(["sleep", "1000"], env={**os.environ, mark: ""}, start_new_session=True)
    process_tree.end(process.pid, mark)
    assert process.wait(30) == -signal.SIGKILL
    assert other.poll() is None
    other.kill()
    other.wait()


def test_a_process_that_leaves_the_terminal_cannot_reach_it() -> None:
    """It stays in the session of the command, but FMUs neither read what is typed nor write what looks like ours."""
    program = """
import os, sys
from cosim.process_tree import leave_terminal
os.close(os.open("/dev/tty", os.O_RDWR))
if (child := os.fork()) == 0:
    os.setpgid(0, 0)
    leave_terminal()
    try:
        os.open("/dev/tty", os.O_RDWR)
    except OSError:
        os._exit(7)
    os._exit(1)
os.close(os.open("/dev/tty", os.O_RDWR))
os._exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    pid, terminal = pty.fork()
    if pid == 0:
        os.execv(sys.executable, [sys.executable, "-c", program])
    with suppress(OSError):  # the end, on Linux
        while os.read(terminal, 1024):
            pass
    os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 7


def test_a_number_that_has_become_another_process_s_is_left_alone(start: Start) -> None:
    """Numbers are given anew after some thousand processes; what has been waited for is known by its mark alone."""
    process, mark, left = start("if daemon(): time.sleep(1000)\nos._exit(3)")
    assert process.wait(30) == 3
    with subprocess.Popen(["sleep", "1000"], start_new_session=True) as other:
        try:
            process.pid = other.pid
            interpreter.kill_only(process, mark)  # type: ignore[arg-type]
            assert other.poll() is None
            assert not lives(left)
        finally:
            other.kill()
