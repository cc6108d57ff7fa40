"""The folder of unpacked FMUs: its path equals its URI, for any name of the folder for temporary files."""

import tempfile
from pathlib import Path

import pytest

import cosim.fmu.unpack_folder
from cosim.fmu.unpack_folder import plain_folder

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
