"""An FMU with a thread that never ends, which must not be unloaded: the run is still judged, written and reported.

The stub aborts where it is unloaded, and where it is torn down at the end of the process.
"""

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from lxml import etree

from cosim.plant.unloading import threads
from cosim.results.files import load
from cosim.tests.driving import fleet, scenario

from .stub.stub import make_fmu

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="POSIX threads")

FMI = ("1.0", "2.0", "3.0")


def written(folder: Path, name: str, below: str, fmi: str = "2.0", more: str = "") -> Path:
    fmu = make_fmu(folder, fmi=fmi, behaviour="thread", name=f"thread_{fmi[0]}")
    expect = f'<expect><final signal="range_error" below="{below}"/>{more}</expect>'
    return scenario(folder / f"{name}.xml", f'<plant id="car" fmu="{fmu}" isolate="no"/>', more=expect)


def python(folder: Path, *arguments: str) -> tuple[int, str, str]:
    # As commands have it: SciPy, which xarray imports if Dask is there, would start threads while a library is loaded.
    environment = {**os.environ, "TMPDIR": str(folder), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True, timeout=300
    )
    return done.returncode, done.stdout, done.stderr


def test_everything_is_written_and_said(tmp_path: Path) -> None:
    compare = '<compare measure="rms" signal="range_error" factor="2" scenario="first.xml"/>'
    written(tmp_path, "first", "1000 m")
    written(tmp_path, "second", "1 mm", more=compare)
    written(tmp_path, "third", "1000 m", fmi="3.0")
    names = ("first", "second", "third")
    files = [f"{name}.xml" for name in names]
    program = "import cosim.cli; cosim.cli.entry()"
    status, printed, said = python(tmp_path, "-c", program, "run", *files, "--out", "runs", "--junit", "junit.xml")
    assert (status, said) == (1, "")
    assert all(f"results in runs/{name}/" in printed for name in names)
    assert "FAILS  final range_error below 1 mm" in printed
    assert [json.loads((tmp_path / "runs" / n / "summary.json").read_text())["passed"] for n in names] == [
        True,
        False,
        True,
    ]
    assert len(etree.parse(tmp_path / "junit.xml").findall("testsuite")) == 3
    assert all(load(tmp_path / "runs" / name / "result.nc").attrs["status"] == "completed" for name in names)
    assert not list(tmp_path.glob("formation-fmu-*")), "what was unpacked is removed, though it is in use"


@pytest.mark.parametrize("fmi", FMI)
def test_in_python(tmp_path: Path, fmi: str) -> None:
    """The process ends with its own status, and its output is not lost."""
    path = written(tmp_path, "s", "1 m", fmi=fmi)
    program = f"import sys, cosim; print(cosim.run({str(path)!r}).sizes['time']); sys.exit(5)"
    assert python(tmp_path, "-c", program) == (5, "51\n", "")


def test_in_pytest(tmp_path: Path) -> None:
    written(tmp_path, "good", "1000 m")
    written(tmp_path, "bad", "1 mm")
    status, printed, said = python(tmp_path, "-m", "pytest", "-p", "no:cacheprovider", "-q", "bad.xml", "good.xml")
    assert (status, said) == (1, "")
    assert "1 failed, 1 passed" in printed


def test_isolated(tmp_path: Path) -> None:
    fmu = make_fmu(tmp_path, behaviour="thread")
    with fleet(fmu, isolated=True) as (started, _):
        assert started.messages == []


@pytest.mark.skipif(sys.platform != "linux", reason="/proc")
@pytest.mark.parametrize("behaviour", ["good", "thread"])
def test_what_is_unloaded(tmp_path: Path, behaviour: str) -> None:
    """A library without threads is unloaded: many runs in one session do not fill the memory."""
    path = scenario(
        tmp_path / "s.xml", f'<plant id="car" fmu="{make_fmu(tmp_path, behaviour=behaviour)}" isolate="no"/>'
    )
    program = (
        f"import cosim\nfor _ in range(3): cosim.run({str(path)!r})\n"
        "print(len({l.split()[5] for l in open('/proc/self/maps') if '/stub.so' in l}))"
    )
    status, printed, _ = python(tmp_path, "-c", program)
    assert status == 0
    assert int(printed) == (3 if behaviour == "thread" else 0)


def test_threads_of_python_do_not_count() -> None:
    found = threads()
    assert found is not None
    done = threading.Event()
    thread = threading.Thread(target=done.wait)
    thread.start()
    try:
        assert threads() == found
    finally:
        done.set()
        thread.join()
