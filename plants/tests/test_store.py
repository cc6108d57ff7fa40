"""The cache of built FMUs: what is not as it was built is built anew, and where others can write nothing is loaded."""

import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

import plants
from plants.factory import build as building
from plants.factory import store


@pytest.fixture
def kept(fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The FMU of the car-like robot in a copy of the cache."""
    shutil.copytree(store.folder(), tmp_path / "cache", ignore=shutil.ignore_patterns(".*"))  # what others build now
    copy = tmp_path / "cache" / fmu.relative_to(store.folder())
    monkeypatch.setenv("FORMATION_CACHE", str(tmp_path / "cache"))
    return copy


def flip_a_byte(fmu: Path) -> None:
    data = bytearray(fmu.read_bytes())
    data[len(data) // 2] ^= 1
    fmu.write_bytes(data)


def cut(fmu: Path) -> None:
    fmu.write_bytes(fmu.read_bytes()[:1000])


def bring_a_foreign_library(fmu: Path) -> None:
    with zipfile.ZipFile(fmu, "a") as archive:
        archive.writestr("binaries/linux64/foreign.so", b"\x7fELF")


def damage_the_checksum(fmu: Path) -> None:
    fmu.with_name("car_like.fmu.sha256").write_bytes(b"\xff\0 none")


def remove_the_checksum(fmu: Path) -> None:
    fmu.with_name("car_like.fmu.sha256").unlink()


@pytest.mark.parametrize(
    "damage", [flip_a_byte, cut, bring_a_foreign_library, damage_the_checksum, remove_the_checksum]
)
def test_what_is_not_as_it_was_built_is_built_anew(
    fmu: Path, kept: Path, damage: Callable[[Path], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, built = fmu.read_bytes(), []

    def make(*arguments: object) -> None:
        built.append(arguments[0])
        shutil.copyfile(fmu, Path(str(arguments[-1])))

    monkeypatch.setattr(building, "_generate", lambda *arguments: {})
    monkeypatch.setattr(building, "_make", make)
    assert plants.build("car_like") == kept
    assert built == []
    damage(kept)
    assert plants.build("car_like").read_bytes() == whole
    assert plants.build("car_like").read_bytes() == whole
    assert built == ["car_like"], "once"


def test_the_checksum_is_one_that_other_tools_can_check(kept: Path) -> None:
    done = subprocess.run(["sha256sum", "--check", "car_like.fmu.sha256"], cwd=kept.parent, capture_output=True)
    assert done.returncode == 0, done.stderr


posix = pytest.mark.skipif(os.name != "posix", reason="rights of POSIX")


@posix
def test_folders_are_the_users_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the user's mask is: folders that are made, and only these."""
    (tmp_path / "there").mkdir()
    monkeypatch.setenv("FORMATION_CACHE", str(tmp_path / "there" / "new" / "cache"))
    mask = os.umask(0o002)
    try:
        fmu = store.place("0" * 64, "model")
        store.keep(fmu, lambda path: path.write_bytes(b"FMU") and None)
    finally:
        os.umask(mask)
    assert store.holds(fmu)
    modes = {path.name: path.stat().st_mode & 0o777 for path in (tmp_path / "there" / "new").rglob("*")}
    assert modes == {"cache": 0o700, "fmus": 0o700, "0" * 32: 0o700, "model.fmu": 0o644, "model.fmu.sha256": 0o644}


@posix
@pytest.mark.parametrize("part", ["cache", "fmus", "key", "fmu", "checksum"])
@pytest.mark.parametrize("right", [0o020, 0o002], ids=["group", "all"])
def test_where_others_can_write_nothing_is_used(kept: Path, tmp_path: Path, part: str, right: int) -> None:
    path = {
        "cache": kept.parents[2],
        "fmus": kept.parents[1],
        "key": kept.parent,
        "fmu": kept,
        "checksum": kept.with_name("car_like.fmu.sha256"),
    }[part]
    path.chmod(path.stat().st_mode | right)
    before = kept.stat().st_mtime_ns
    for cache in (True, False):
        with pytest.raises(plants.BuildError) as error:
            plants.build("car_like", cache=cache)
        assert str(error.value) == (
            f"the cache of built FMUs is not used, because others can write to {path}: take that right away (chmod -R "
            f"go-w '{tmp_path}/cache'), or choose a folder of your own (the environment variable FORMATION_CACHE names "
            "the cache)"
        )
    assert kept.stat().st_mtime_ns == before
    subprocess.run(["chmod", "-R", "go-w", tmp_path / "cache"], check=True)
    assert plants.build("car_like") == kept


@posix
def test_an_fmu_of_another_user_is_not_used(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    user = os.geteuid() + 1
    monkeypatch.setattr(os, "geteuid", lambda: user)
    if user > 1:  # those of the administrator may be used
        with pytest.raises(plants.BuildError, match=r"because .*/cache belongs to another user: remove it, or choose"):
            plants.build("car_like")
    else:
        assert plants.build("car_like") == kept


def test_elsewhere_it_is_built_without_the_cache(kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of a cache to which others can write gets into the copy."""
    kept.parent.chmod(0o777)
    kept.write_bytes(b"foreign")
    monkeypatch.setattr(building, "_generate", lambda *arguments: {})
    monkeypatch.setattr(building, "_make", lambda *arguments: arguments[-1].write_bytes(b"built"))
    assert plants.build("car_like", out=tmp_path / "out").read_bytes() == b"built"


@posix
def test_a_killed_build_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its folder goes with the next build, of any model."""
    monkeypatch.setenv("FORMATION_CACHE", str(tmp_path / "cache"))
    program = (
        "import os, signal, sys\nfrom plants.factory import store\n"
        "def make(path):\n    path.write_bytes(b'half')\n    os.kill(os.getpid(), signal.SIGKILL)\n"
        "store.keep(store.place('1' * 64, 'model'), make)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == -9
    assert len(list((tmp_path / "cache" / "fmus").glob(".build-*/model.fmu"))) == 1
    store.keep(store.place("2" * 64, "other"), lambda path: path.write_bytes(b"whole") and None)
    assert list((tmp_path / "cache" / "fmus").glob(".build-*")) == []
    assert not store.holds(store.place("1" * 64, "model"))
