"""The folder of unpacked FMUs: its path equals its URI, for any folder for temporary files; it never stays."""

import os
import signal
import subprocess
import sys
import tempfile
from contextlib import closing
from pathlib import Path

import pytest

import cosim.fmu.unpack_folder
from cosim.fmu.package import open_package
from cosim.fmu.unpack_folder import plain_folder
from plants import scratch
from tests.stub.stub import make_fmu

ODD = ["Jürgen", "a+b", "a#b", "a b", "100%", "日本"]


@pytest.fixture(params=ODD)
def odd(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder for temporary files, which is called so."""
    folder = tmp_path / request.param
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def test_a_plain_one_is_preferred(odd: Path) -> None:
    made = plain_folder("formation-test-")
    try:
        assert made.as_uri().endswith(made.as_posix())
        assert odd not in made.parents
    finally:
        made.rmdir()


def test_the_usual_one_if_it_is_plain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "RUNNER~1"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    assert plain_folder("formation-test-").parent == folder


def test_the_usual_one_if_there_is_no_other(odd: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cosim.fmu.unpack_folder, "_bases", lambda: iter([str(odd), str(tmp_path / "missing")]))
    assert plain_folder("formation-test-").parent == odd


@pytest.mark.skipif(os.name != "posix", reason="locks of POSIX")
def test_a_killed_run_leaves_what_the_next_one_removes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "temporary").mkdir()
    fmu = make_fmu(tmp_path)
    program = (
        "import os, pathlib, signal\nfrom cosim.fmu.package import open_package\n"
        f"open_package(pathlib.Path({str(fmu)!r}))\nos.kill(os.getpid(), signal.SIGKILL)"
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path / "temporary")}
    assert subprocess.run([sys.executable, "-c", program], env=environment, check=False).returncode == -signal.SIGKILL
    [left] = (tmp_path / "temporary").iterdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    scratch._remove_left.cache_clear()
    with closing(open_package(fmu)) as package:
        assert list((tmp_path / "temporary").iterdir()) == [package.directory]
    assert list((tmp_path / "temporary").iterdir()) == []
    assert not left.exists()
