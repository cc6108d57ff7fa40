"""Temporary folders: those of killed processes are removed, those of living ones and of others never."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

import pytest

from plants import scratch

pytestmark = pytest.mark.skipif(os.name != "posix", reason="locks of POSIX")


@pytest.fixture(autouse=True)
def anew() -> Iterator[None]:
    """Let each test be the first in its process that makes a folder."""
    scratch._remove_left.cache_clear()
    yield
    scratch._remove_left.cache_clear()


@pytest.fixture
def other(tmp_path: Path) -> Iterator[Callable[..., "subprocess.Popen[str]"]]:
    """Start processes that make a folder, print its path, and wait."""
    started: list[subprocess.Popen[str]] = []

    def start(more: str = "") -> "subprocess.Popen[str]":
        program = (
            "import os, subprocess, sys, pathlib\nfrom plants import scratch\n"
            f"made = scratch.make(pathlib.Path({str(tmp_path)!r}), 'test-')\n"
            f"(made / 'file').touch()\n{more}\nprint(made, flush=True)\nsys.stdin.read()"
        )
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        started.append(subprocess.Popen([sys.executable, "-c", program], text=True, **pipes))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


def folder_of(process: "subprocess.Popen[str]") -> Path:
    assert process.stdout is not None
    return Path(process.stdout.readline().strip())


def kill(process: "subprocess.Popen[str]") -> None:
    process.kill()
    process.wait()


def test_a_folder_is_removed_with_its_descriptor(tmp_path: Path) -> None:
    before = os.listdir("/dev/fd")
    with scratch.folder(tmp_path, "test-") as made:
        assert made.stat().st_mode & 0o777 == 0o700
        assert made.name.startswith(f"test-{os.getpid()}-")
        (made / "file").touch()
    assert list(tmp_path.iterdir()) == []
    assert os.listdir("/dev/fd") == before


def test_only_those_of_killed_processes_are_removed(
    tmp_path: Path, other: Callable[..., "subprocess.Popen[str]"]
) -> None:
    killed, living = other(), other()
    left, used = folder_of(killed), folder_of(living)
    kill(killed)
    stays = [tmp_path / name for name in ("test-abc", "test--abc", "other-99999-abc", "test-99999-abc-d")]
    for folder in stays:
        folder.mkdir()
    mine = scratch.make(tmp_path, "test-")
    assert not left.exists()
    assert set(tmp_path.iterdir()) == {mine, used, *stays}


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_an_ended_process_that_nobody_has_waited_for(
    tmp_path: Path, other: Callable[..., "subprocess.Popen[str]"]
) -> None:
    killed = other()
    left = folder_of(killed)
    killed.kill()
    os.waitid(os.P_PID, killed.pid, os.WEXITED | os.WNOWAIT)
    scratch.make(tmp_path, "test-")
    assert not left.exists()


def test_a_living_process_may_have_lost_its_lock(tmp_path: Path, other: Callable[..., "subprocess.Popen[str]"]) -> None:
    """As an FMU can close all descriptors of its process; another file may then have the number."""
    used = folder_of(other("os.closerange(3, 100)"))
    scratch.make(tmp_path, "test-")
    assert (used / "file").exists()


def test_a_number_can_be_that_of_another_process(
    tmp_path: Path, other: Callable[..., "subprocess.Popen[str]"], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In another container, say, which shares the folder: a lock tells that its process lives, and no number."""
    used = folder_of(other())
    monkeypatch.setattr(scratch, "_lives", lambda number: False)
    scratch.make(tmp_path, "test-")
    assert (used / "file").exists()


def test_what_forks_keeps_the_folder(tmp_path: Path, other: Callable[..., "subprocess.Popen[str]"]) -> None:
    parent = other("child = os.fork()\nif child == 0: sys.stdin.read(); os._exit(0)\nprint(child)")
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    used = folder_of(parent)
    kill(parent)
    scratch.make(tmp_path, "test-")
    assert (used / "file").exists()
    os.kill(child, signal.SIGKILL)
    assert parent.stdout.read() == "", "both have ended"
    scratch._remove_left.cache_clear()
    scratch.make(tmp_path, "test-")
    assert not used.exists()


def test_programs_that_are_started_do_not_keep_it(
    tmp_path: Path, other: Callable[..., "subprocess.Popen[str]"]
) -> None:
    parent = other("child = subprocess.Popen(['sleep', '100'], stdout=subprocess.DEVNULL)\nprint(child.pid)")
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    left = folder_of(parent)
    kill(parent)
    scratch.make(tmp_path, "test-")
    os.kill(child, signal.SIGKILL)
    assert not left.exists()


def test_never_that_of_another_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "test-999999999-abc").mkdir()
    user = os.geteuid() + 1
    monkeypatch.setattr(os, "geteuid", lambda: user)
    scratch.make(tmp_path, "test-")
    assert (tmp_path / "test-999999999-abc").exists()


def test_never_what_a_link_leads_to(tmp_path: Path) -> None:
    (tmp_path / "else" / "precious").mkdir(parents=True)
    (tmp_path / "test-999999999-abc").symlink_to(tmp_path / "else")
    scratch.make(tmp_path, "test-")
    assert (tmp_path / "else" / "precious").exists()


def test_a_folder_that_another_process_takes_for_left_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the moment between its making and its lock."""
    lock, taken = scratch._lock, []

    def late(folder: Path) -> int | None:
        if not taken:
            taken.append(folder)
            folder.rmdir()
        return lock(folder)

    monkeypatch.setattr(scratch, "_lock", late)
    made = scratch.make(tmp_path, "test-")
    assert made.exists()
    assert made not in taken


def test_a_descriptor_that_is_another_file_by_now_stays_open(tmp_path: Path) -> None:
    made = scratch.make(tmp_path, "test-")
    descriptor, _ = scratch._locks[made]
    with (tmp_path / "file").open("wb") as file:
        os.dup2(file.fileno(), descriptor)
        scratch.remove(made)
        os.write(descriptor, b"open")
        os.close(descriptor)
    assert (tmp_path / "file").read_bytes() == b"open"


def test_where_nothing_can_be_locked_nothing_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuses(*_: object) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr(scratch.fcntl, "flock", refuses)
    (tmp_path / "test-999999999-abc").mkdir()
    made = scratch.make(tmp_path, "test-")
    assert (tmp_path / "test-999999999-abc").exists()
    scratch.remove(made)
    assert not made.exists()


def test_what_is_not_removed_goes_when_the_process_ends(tmp_path: Path) -> None:
    """A process that it has forked leaves it alone."""
    program = f"""
import os, pathlib, sys
from plants import scratch
made = scratch.make(pathlib.Path({str(tmp_path)!r}), "test-")
if os.fork() == 0:
    sys.exit(0)
os.wait()
print(made.exists())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"
    assert list(tmp_path.iterdir()) == []


def test_a_folder_into_which_a_thread_still_writes_is_removed_at_exit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An interrupt has ended the block in which it was made, and the thread has written a file meanwhile."""
    made = scratch.make(tmp_path, "scratch-")
    with monkeypatch.context() as patch:
        patch.setattr("shutil.rmtree", lambda *_, **__: None)
        scratch.remove(made)
    assert made in scratch.remembered()
    scratch._remove_at_exit()
    assert not made.exists()
    assert made not in scratch.remembered()


def test_no_folder_is_forgotten_at_whichever_moment_an_interrupt_comes(tmp_path: Path) -> None:
    def interrupted_after(lines: int) -> bool:
        """Make a folder, with an interrupt after some lines of Python; return whether it came."""
        left = lines

        def trace(frame: FrameType, event: str, _: object) -> Callable[..., object]:
            nonlocal left
            left -= event == "line"
            if left < 0:
                sys.settrace(None)
                raise KeyboardInterrupt
            return trace

        before = sys.gettrace()
        sys.settrace(trace)
        try:
            scratch.make(tmp_path, "test-")
        except KeyboardInterrupt:
            return True
        finally:
            sys.settrace(before)
        return False

    scratch.make(tmp_path, "test-")
    lines = 0
    while interrupted_after(lines):
        assert set(tmp_path.iterdir()) <= set(scratch.remembered())
        lines += 1
    assert lines > 10
    for made in tmp_path.iterdir():
        scratch.remove(made)
    assert not list(tmp_path.iterdir())
