"""Whatever nobody foresaw is a sentence with an exit status of its own, and costs no other scenario anything."""

import errno
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from lxml import etree

import cosim.cli.check
import cosim.cli.listing
import cosim.cli.run
import cosim.cli.studying
import cosim.studies.conduct
import cosim.studies.task
from cosim.cli import main
from cosim.errors import InputError, OutputError
from cosim.results.result import Result
from cosim.studies.crews import crew_of
from cosim.tests.driving import SHORT
from cosim.tests.studies import write_study
from cosim.unforeseen import Fault, Lack, foreseen, lack_of, status_of

from .commands import command, failed


@pytest.fixture
def two(line: str, tmp_path: Path) -> tuple[str, str]:
    """Return two scenarios of which the name of the first one begins with "odd"."""
    text = Path(line).read_text(encoding="utf-8")
    first, second = tmp_path / "odd.xml", tmp_path / "even.xml"
    for path in (first, second):
        path.write_text(text.replace('name="clmr_line"', f'name="{path.stem}"'), encoding="utf-8")
    return str(first), str(second)


@pytest.fixture
def breaking(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[str, BaseException], None]:
    """Return a function that lets a function, given by its path, raise an error for the scenario "odd"."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))

    def broken(place: str, error: BaseException) -> None:
        module, name = place.rsplit(".", 1)
        whole = getattr(sys.modules[module], name)

        def breaks(about: object, *arguments: object) -> object:
            if "odd" in (getattr(about, "name", ""), getattr(about, "stem", "")):
                raise error
            return whole(about, *arguments)

        monkeypatch.setattr(place, breaks)

    return broken


@pytest.mark.parametrize("place", ["cosim.cli.run.read", "cosim.cli.run.summarise"])
@pytest.mark.parametrize(
    ("error", "status", "sentence"),
    [
        (IndexError("off by one"), 70, "odd.xml: a fault of Formation itself, IndexError: off by one ("),
        (SystemExit(0), 70, "odd.xml: code that Formation has called ended the process ("),
        (MemoryError(), 71, "odd.xml: the memory has run out ("),
        (OSError(errno.ENOSPC, "No space left on device", "/x"), 71, "odd.xml: the disk is full (/x)"),
    ],
)
def test_other_scenarios_go_on(
    two: tuple[str, str],
    breaking: Callable[[str, BaseException], None],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    place: str,
    error: BaseException,
    status: int,
    sentence: str,
) -> None:
    breaking(place, error)
    junit = tmp_path / "all.xml"
    out, err = command(
        capsys, "run", *two, "--out", tmp_path / "runs", "--junit", junit, *SHORT, "--no-figure", status=status
    )
    assert sentence in " ".join(err.split())
    assert f"results in {tmp_path / 'runs' / 'even'}/" in out
    assert (tmp_path / "runs" / "odd" / "result.nc").exists() is place.endswith("summarise")
    first, second = etree.parse(junit).getroot()
    assert (first.get("errors"), second.get("errors")) == ("1", "0")
    if status == 70:
        (kept,) = tmp_path.glob("formation-fault-*.txt")
        assert str(kept) in err
        told = kept.read_text(encoding="utf-8")
        assert "Traceback" in told
        assert "Python 3" in told
        assert "numba" in told
    else:
        assert not list(tmp_path.glob("formation-fault-*.txt"))


def test_checks_go_on(
    two: tuple[str, str], breaking: Callable[[str, BaseException], None], capsys: pytest.CaptureFixture[str]
) -> None:
    breaking("cosim.cli.check.set_up", ZeroDivisionError("division by zero"))
    out, err = command(capsys, "check", *two, status=70)
    assert "odd.xml: a fault of Formation itself, ZeroDivisionError: division by zero" in err
    assert "even, 4 followers" in out


def test_a_command_that_breaks(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def breaks(*_: object) -> None:
        raise RecursionError("too deep")

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))  # nothing can be kept there
    monkeypatch.setattr("cosim.cli.listing.inventory", breaks)
    assert "RecursionError: too deep" in (printed := failed(capsys, 70, "list"))
    assert "its traceback could not be kept; please report it" in printed


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EMFILE, errno.EAGAIN, errno.ENOMEM])
def test_a_lack_of_the_machine_decides_the_status_of_what_follows_from_it(code: int) -> None:
    def write() -> None:
        try:
            raise OSError(code, "as the system says it")
        except OSError as error:
            raise OutputError(f"x cannot be written: {error.strerror}") from None

    with pytest.raises(OutputError) as raised:
        write()
    assert foreseen(raised.value) is raised.value
    assert status_of(raised.value) == 71


def test_bad_input_is_no_lack() -> None:
    def read() -> None:
        try:
            Path("/none/such").read_bytes()
        except OSError:
            raise InputError("x cannot be read") from None

    with pytest.raises(InputError) as raised:
        read()
    assert status_of(raised.value) == 2
    assert lack_of(RuntimeError("can't start new thread"))


def test_a_path_that_nobody_thought_of_is_input() -> None:
    error = foreseen(OSError(errno.ENAMETOOLONG, "File name too long", "a" * 5000), "s.xml")
    assert isinstance(error, InputError)
    assert re.fullmatch(r"s\.xml: a+\.\.\.a+: File name too long", str(error))


@pytest.mark.skipif(sys.platform == "win32", reason="the folder of a process cannot be removed there")
@pytest.mark.parametrize("arguments", [("run", "{}", *SHORT), ("compare-plants", "car_like", "car_like")])
def test_the_working_folder_is_gone(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    """The relative path of the results leads nowhere then."""
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    said = failed(capsys, 2, *(argument.replace("{}", line) for argument in arguments))
    assert "the folder in which the command was given is gone" in said


@pytest.mark.skipif(sys.platform == "win32", reason="a file that is open cannot be removed there")
def test_the_folder_of_a_study_is_removed_while_it_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    study, conduct = write_study(tmp_path), cosim.cli.studying.conduct

    def removed(read: Any, folder: Path, **options: Any) -> Any:
        outcome = conduct(read, folder, **options)
        shutil.rmtree(folder.parent)
        return outcome

    monkeypatch.setattr("cosim.cli.studying.conduct", removed)
    out = tmp_path / "studies"
    command(capsys, "study", str(study), "--out", str(out), "--no-figure", "--no-report", "--workers", "1")
    assert {"runs.csv", "runs.nc", "summary.json"} <= {path.name for path in out.glob("*/*")}


@pytest.mark.parametrize("first", [True, False])
def test_a_run_for_which_the_disk_has_no_room_has_no_row_of_its_study(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, first: bool
) -> None:
    def full(*_: object, **__: object) -> object:
        try:
            raise OSError(errno.ENOSPC, "No space left on device")
        except OSError as error:
            raise OutputError("no room for the run") from error

    study = write_study(tmp_path)
    arguments = ("study", str(study), "--out", str(tmp_path), "--no-figure", "--no-report", "--workers", "1")
    with monkeypatch.context() as patch:
        patch.setattr(cosim.studies.task, "whole_run" if first else "Prepared", full)  # the first is made by itself
        patch.setattr(cosim.studies.conduct, "crew_of", lambda *_: crew_of(workers=0))
        printed = failed(capsys, 71, *arguments)
    assert "the disk is full: the runs so far are kept in" in printed
    assert "error: no room for the run" in printed
    assert (tmp_path / "small" / "rows.jsonl").read_text().count('"key"') == (not first)
    printed, _ = command(capsys, *arguments)
    assert printed.count("6 runs; ") == printed.count("6 passed, 0 failed, 0 broken") == 1


def test_a_process_that_makes_runs_runs_out_of_memory(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        "import sys\n"
        "if 'cosim.studies.worker' in sys.orig_argv:\n"
        "    import cosim.master.recorder\n"
        "    def lacking(*_, **__):\n"
        "        raise MemoryError\n"
        "    cosim.master.recorder.Recorder.__init__ = lacking\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    arguments = ("study", str(write_study(tmp_path)), "--out", str(tmp_path), "--no-figure", "--no-report")
    printed = failed(capsys, 71, *arguments, "--workers", "1")
    assert "error: the memory has run out (" in printed
    assert "; the runs so far are kept, and the same command goes on" in printed
    assert (tmp_path / "small" / "rows.jsonl").read_text().count('"key"') == 1


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX limits")
def test_a_file_that_may_not_grow(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import resource

    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def limited(result: Result, folder: Path) -> object:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
        try:
            return save(result, folder)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)

    save = cosim.cli.run._save
    monkeypatch.setattr("cosim.cli.run._save", limited)
    printed = failed(capsys, 71, "run", line, "--out", str(tmp_path), *SHORT, "--no-figure")
    assert "result.nc cannot be written: File too large" in printed


def test_no_process_can_be_started(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class NoPlant(subprocess.Popen[bytes]):
        def __init__(self, command: list[str], **options: Any) -> None:
            if command[0] == sys.executable:
                raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
            super().__init__(command, **options)

    isolated = tmp_path / "isolated.xml"
    text = Path(line).read_text(encoding="utf-8")
    isolated.write_text(text.replace('model="car_like"', 'model="car_like" isolate="process"'), encoding="utf-8")
    monkeypatch.setattr(subprocess, "Popen", NoPlant)
    printed = failed(capsys, 71, "run", str(isolated), "--out", str(tmp_path), *SHORT, "--no-figure")
    assert "its process cannot be started: Resource temporarily unavailable" in printed


@pytest.mark.skipif(sys.platform != "linux", reason="counts threads as Linux does")
def test_a_command_needs_no_thread_for_numpy(line: str) -> None:
    """Where the system starts none, NumPy's library raises SIGINT, which looks like Ctrl-C."""
    program = "import atexit, os, sys; from cosim.cli import entry; sys.argv[1:] = ['check', sys.argv[1]]; "
    program += "atexit.register(lambda: print(os.listdir('/proc/self/task') == [str(os.getpid())])); entry()"
    variables = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run([sys.executable, "-c", program, line], capture_output=True, text=True, env=variables)
    assert done.stdout.splitlines()[-1] == "True"


@pytest.mark.skipif(sys.platform != "linux", reason="limits the memory as Linux does")
@pytest.mark.parametrize("library", ["scipy.linalg", "scipy.special"])
def test_a_library_without_room_does_not_hang(library: str) -> None:
    """OpenBLAS asks for its memory for ever."""
    program = f"""if True:
        import importlib, resource
        import cosim, numpy, scipy
        before = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (before + 70 * 2**20, resource.RLIM_INFINITY))
        try:
            importlib.import_module("{library}")
        except Exception as error:
            print(type(error).__name__, error)
    """
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert done.stdout.startswith("MemoryError scipy."), done
    assert done.stdout.endswith(" needs 128 MiB\n")


@pytest.mark.skipif(sys.platform != "linux", reason="limits the memory as Linux does")
def test_whatever_fails_without_memory_is_a_lack(monkeypatch: pytest.MonkeyPatch) -> None:
    error = OSError("Could not find a shared object file; it may have any reason")
    assert isinstance(foreseen(error), Fault)
    monkeypatch.setattr("cosim.unforeseen._LARGE", 2**62)
    assert isinstance(foreseen(error), Lack)


def test_a_thread_that_cannot_be_started(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It costs the figure, for which the thread would be."""

    def refused(_: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr("cosim.results.figure_process.threading.Thread.start", refused)
    monkeypatch.setattr("cosim.cli.console.threading.Timer.start", lambda _: None)
    assert main(["run", line, "--out", str(tmp_path), *SHORT]) == 1  # as it is so short
    assert "can't start new thread" in capsys.readouterr().err
    assert not list(tmp_path.rglob("*.png"))


def test_every_help_names_the_statuses(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["--help"], ["run", "--help"], ["list", "--help"]):
        with pytest.raises(SystemExit):
            command(capsys, *arguments)
        printed = capsys.readouterr().out
        assert "\n  70   a fault of Formation itself" in printed
        assert "\n  71   the machine lacks something" in printed
