"""Compiled functions are loaded only from folders to which others cannot write, and only if they are what is wanted."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from formation_controllers.compiled import compiled
from formation_controllers.kept import Files, trusted

pytestmark = pytest.mark.skipif(os.name != "posix", reason="rights of POSIX")


LAW = "from formation_controllers.compiled import compiled\n"


def printed(program: str, folder: Path, *more: Path) -> str:
    """Return what a new process prints that imports from these folders and keeps compiled functions in the first."""
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(folder / "numba"),
        "PYTHONPATH": os.pathsep.join(map(str, (folder, *more))),
        "NUMBA_DISABLE_JIT": "0",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    command = [sys.executable, "-W", "ignore", "-c", program]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=True
    ).stdout.strip()


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Return a folder with a compiled function, and the folder of its source."""
    kept, sources = tmp_path / "kept", tmp_path / "sources"
    for folder in (kept, sources):
        folder.mkdir(mode=0o700)
        (folder / "file").touch()
    return kept, sources


@pytest.mark.parametrize(
    ("kept_mode", "sources_mode", "good"),
    [
        (0o700, 0o755, True),
        (0o755, 0o755, True),
        (0o775, 0o775, True),  # the sources are as much in their hands
        (0o777, 0o777, True),
        (0o775, 0o755, False),
        (0o757, 0o775, False),
        (0o1777, 0o755, False),
    ],
)
def test_rights(folders: tuple[Path, Path], kept_mode: int, sources_mode: int, good: bool) -> None:
    kept, sources = folders
    kept.chmod(kept_mode)
    sources.chmod(sources_mode)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert trusted(str(kept), str(sources)) is good
        assert trusted(str(kept), str(sources)) is good
    assert len(caught) == (0 if good else 1)
    assert all(f"because others can write to {kept}, where" in str(one.message) for one in caught)
    assert kept.stat().st_mode & 0o7777 == kept_mode, "what is there stays as it is"


def test_another_users(folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    kept, sources = folders
    user, owner = os.geteuid() + 1, sources.stat().st_uid
    os.chmod(kept, 0o755)
    monkeypatch.setattr(os, "geteuid", lambda: user)
    assert trusted(str(kept), str(sources)), "who owns the sources could as well change them"
    if owner == 0:
        os.chown(kept, 4711, 4711)
        with pytest.warns(RuntimeWarning, match="others can write"):
            assert not trusted(str(kept), str(sources / ".."))


def test_a_new_folder_becomes_the_users_alone(folders: tuple[Path, Path]) -> None:
    kept, sources = folders
    (kept / "file").unlink()
    kept.chmod(0o775)
    assert trusted(str(kept), str(sources))
    assert kept.stat().st_mode & 0o777 == 0o700


def test_nothing_is_loaded_from_there(tmp_path: Path) -> None:
    """The name of Numba's folder can be foretold, so that another user of a shared folder could lay it out."""
    (tmp_path / "numba").mkdir()
    (tmp_path / "module.py").write_text(LAW + "@compiled\ndef f(x):\n    return x + 1\n")

    def hits() -> str:
        return printed("import module; module.f(1); print(sum(module.f.stats.cache_hits.values()))", tmp_path)

    assert [hits(), hits()] == ["0", "1"]
    [place] = (path for path in (tmp_path / "numba").iterdir() if path.name.startswith(tmp_path.name))
    place.chmod(0o777)
    assert hits() == "0"


# What is in the files -----------------------------------------------------------------------------------------

ROW = np.arange(6.0)
COLUMN = np.arange(12.0)[::2]
"""Six other numbers, in every other place of an array."""


def total(values: Any) -> float:
    """Return a sum, by code that is another for numbers in a row and for others."""
    result = 0.0
    for i in range(len(values)):
        result += values[i]
    return result


@pytest.fixture
def anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], Any]:
    """Return what makes the function as another process does, with the files that are kept."""
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        pytest.skip("nothing is compiled")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "numba"))
    return lambda: compiled(total)


def files(folder: Path, kind: str) -> list[Path]:
    return sorted(folder.glob(f"numba/**/*.{kind}"))


def test_processes_that_compile_for_different_types_at_once(
    anew: Callable[[], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both read the index before either writes it, and choose one name; the last file is not that of the last index."""
    one, other = anew(), anew()
    save_index, save_data, late = Files._save_index, Files._save_data, list[Callable[[], None]]()

    def after_the_other(self: Any, overloads: Any) -> None:
        if self is one._cache._cache_file:
            assert other(ROW) == 15.0
        save_index(self, overloads)

    def before_the_other(self: Any, name: str, data: Any) -> None:
        if self is other._cache._cache_file:
            late.append(lambda: save_data(self, name, data))
        else:
            save_data(self, name, data)

    monkeypatch.setattr(Files, "_save_index", after_the_other)
    monkeypatch.setattr(Files, "_save_data", before_the_other)
    assert one(COLUMN) == 30.0
    [save] = late
    save()
    monkeypatch.setattr(Files, "_save_index", save_index)
    monkeypatch.setattr(Files, "_save_data", save_data)
    assert len(files(tmp_path, "nbc")) == 1, "both have the same name"
    for hits in (0, 2):
        found = anew()
        assert (found(COLUMN), found(ROW)) == (30.0, 15.0)
        assert sum(found.stats.cache_hits.values()) == hits


def test_code_of_older_sources_under_a_new_entry(anew: Callable[[], Any], tmp_path: Path) -> None:
    """A process that was killed has written the index, and not the file."""
    assert anew()(ROW) == 15.0
    [file] = files(tmp_path, "nbc")
    old = file.read_bytes()
    older = anew()
    older._cache._cache_file._version = "older sources"
    assert older(ROW) == 15.0
    assert file.read_bytes() != old
    [index] = files(tmp_path, "nbi")
    index.unlink()
    of_older = file.read_bytes()
    assert anew()(ROW) == 15.0
    file.write_bytes(of_older)
    found = anew()
    assert found(ROW) == 15.0
    assert sum(found.stats.cache_hits.values()) == 0
    found = anew()
    assert found(ROW) == 15.0
    assert sum(found.stats.cache_hits.values()) == 1


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", ["flip", "cut", "empty", "garbage"])
def test_damaged_files(anew: Callable[[], Any], tmp_path: Path, kind: str, damage: str) -> None:
    assert anew()(ROW) == 15.0
    [file] = files(tmp_path, kind)
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    cut = bytes(content[: len(content) // 2])
    file.write_bytes({"flip": bytes(content), "cut": cut, "empty": b"", "garbage": b"garbage" * 100}[damage])
    hits = []
    for _ in range(2):
        found = anew()
        assert found(ROW) == 15.0
        hits.append(sum(found.stats.cache_hits.values()))
    assert hits == [0, 1]


def test_a_class_that_is_not_in_this_project(tmp_path: Path) -> None:
    """What a library's function was compiled for elsewhere ends nobody's start."""
    (tmp_path / "project").mkdir()
    (tmp_path / "library.py").write_text(LAW + "@compiled\ndef first(s):\n    return s[0]\n")
    (tmp_path / "project" / "caller.py").write_text(
        "from typing import NamedTuple\nfrom library import first\n"
        "class S(NamedTuple):\n    x: float\n    y: float\nprint(first(S(1.0, 2.0)))\n"
    )
    assert printed("import caller", tmp_path, tmp_path / "project") == "1.0"
    assert printed("from library import first; print(first((3.0, 4.0)))", tmp_path) == "3.0"


def test_a_module_that_is_not_imported_as_others_are(anew: Callable[[], Any], tmp_path: Path) -> None:
    """Nobody knows what it imports."""
    source = tmp_path / "apart.py"
    source.write_text(LAW + "@compiled\ndef f(x):\n    return x + 1.0\n")
    spec = importlib.util.spec_from_file_location("apart", source)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.f(1.0) == 2.0
    assert files(tmp_path, "nbc") == []


@pytest.mark.parametrize("kind", ["module", "package", "relative", "constant", "far"])
def test_an_edit_of_another_file_counts(tmp_path: Path, kind: str) -> None:
    """Of a law in several files each is a source of the others; Numba looks at the function's own file alone."""
    package = tmp_path / "laws"
    package.mkdir()
    (package / "__init__.py").touch()
    helper = package / "helper.py"
    helper.write_text(LAW + "GAIN = 2.0\n@compiled\ndef scaled(x):\n    return 2.0 * x\n")
    (package / "between.py").write_text("from laws.helper import *\n")
    imports, term = {
        "module": ("import laws.helper as helper", "helper.scaled(x)"),
        "package": ("from laws import helper", "helper.scaled(x)"),
        "relative": ("from .helper import scaled", "scaled(x)"),
        "constant": ("from laws.helper import GAIN", "GAIN * x"),
        "far": ("from laws.between import scaled", "scaled(x)"),
    }[kind]
    (package / "law.py").write_text(LAW + f"{imports}\n@compiled\ndef law(x):\n    return 1.0 + {term}\n")
    program = "from laws.law import law; print(law(1.0), sum(law.stats.cache_hits.values()))"
    assert [printed(program, tmp_path) for _ in range(2)] == ["3.0 0", "3.0 1"]
    helper.write_text(helper.read_text().replace("2.0", "5.0"))
    assert [printed(program, tmp_path) for _ in range(2)] == ["6.0 0", "6.0 1"]
