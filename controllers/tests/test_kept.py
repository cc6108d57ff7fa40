"""Compiled functions are loaded only from folders to which others cannot write."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from formation_controllers.kept import trusted

pytestmark = pytest.mark.skipif(os.name != "posix", reason="rights of POSIX")


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
    source = "from formation_controllers.compiled import compiled\n@compiled\ndef f(x):\n    return x + 1\n"
    (tmp_path / "module.py").write_text(source)
    program = "import module; module.f(1); print(sum(module.f.stats.cache_hits.values()))"
    command = [sys.executable, "-W", "ignore", "-c", program]
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(tmp_path / "numba"),
        "PYTHONPATH": str(tmp_path),
        "NUMBA_DISABLE_JIT": "0",
    }
    options = {"cwd": tmp_path, "env": environment, "capture_output": True, "text": True, "check": True}

    def hits() -> str:
        return subprocess.run(command, **options).stdout.strip()  # type: ignore[call-overload, no-any-return]

    assert [hits(), hits()] == ["0", "1"]
    [place] = (path for path in (tmp_path / "numba").iterdir() if path.name.startswith(tmp_path.name))
    place.chmod(0o777)
    assert hits() == "0"
