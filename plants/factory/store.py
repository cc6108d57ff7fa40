"""Where FMUs are kept: one folder for each combination of sources and tools, named by a digest of both.

An FMU is a library that is loaded, so what is kept is not trusted blindly: it is used only if its checksum, in a file
beside it, still holds, and if nobody else can write there.
"""

import hashlib
import importlib.metadata
import os
import shutil
import stat
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import plants
from plants import scratch
from plants.errors import BuildError

_OTHERS_CAN_WRITE = stat.S_IWGRP | stat.S_IWOTH


def folder() -> Path:
    """Return the cache folder: ``$FORMATION_CACHE``, or ``formation-cosim`` in the user's cache folder."""
    if chosen := os.environ.get("FORMATION_CACHE"):
        return Path(chosen).absolute()
    import platformdirs

    return Path(platformdirs.user_cache_dir("formation-cosim"))


def package_digest() -> str:
    """Return a digest of the sources of a built-in model's FMU except the compiler: this package and its tools."""
    root = Path(plants.__file__).parent
    suffixes = {".py", ".c", ".h", ".jinja", ".png", ".svg"}
    files = sorted(p for p in root.rglob("*") if p.suffix in suffixes and "tests" not in p.relative_to(root).parts)
    parts = [part for path in files for part in (path.relative_to(root).as_posix(), path.read_bytes())]
    return digest([*parts, *(f"{name} {version(name)}" for name in ("formation-cosim", "sympy", "fmpy", "jinja2"))])


def version(distribution: str) -> str:
    """Return the version of an installed distribution, without importing it."""
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return "none"


def digest(parts: Iterable[str | bytes]) -> str:
    """Return a digest of a sequence of texts."""
    total = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        total.update(len(data).to_bytes(8, "big") + data)
    return total.hexdigest()


class CannotKeep(BuildError):
    """A folder cannot be written, or others can write there."""


def place(key: str, name: str) -> Path:
    """Return where the FMU of a model is kept; `key` is a digest of all that determines it."""
    return folder() / "fmus" / key[:32] / f"{name}.fmu"


def holds(fmu: Path) -> bool:
    """Return whether an FMU is kept at its place, as it was when it was built.

    Raises
    ------
    CannotKeep
        Others can write there.
    """
    _check_rights(fmu)
    try:
        return _checksum_file(fmu).read_text("ascii") == _checksum_line(fmu)
    except (OSError, UnicodeDecodeError):
        return False


def keep(fmu: Path, make: Callable[[Path], None]) -> None:
    """Build an FMU at its place, in folders of this user alone, with its checksum; see `write`.

    Raises
    ------
    CannotKeep
        The folder cannot be written, or others can write there.
    """
    try:
        folder().parent.mkdir(parents=True, exist_ok=True)
        for part in _folders(fmu):
            part.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise _cannot_write(fmu, error) from error
    _check_rights(fmu)

    def make_both(made: Path) -> None:
        make(made)
        checksum = _checksum_file(made)
        checksum.write_text(_checksum_line(made), "ascii")
        for file in (made, checksum):
            file.chmod(0o644)
        os.replace(checksum, _checksum_file(fmu))

    write(fmu, make_both, fmu.parents[1])


def write(target: Path, make: Callable[[Path], None], base: Path | None = None) -> Path:
    """Make a file so that no other process ever sees half of it: `make` writes it elsewhere, then it is moved.

    Parameters
    ----------
    target
        The file. An older one is replaced.
    make
        Is given the path of a file to write, alone in a temporary folder.
    base
        Where that folder is, on the same file system; beside the file by default.

    Raises
    ------
    CannotKeep
        The folder cannot be written.
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with scratch.folder(base or target.parent, ".build-") as temporary:
            made = temporary / target.name
            make(made)
            os.replace(made, target)
    except OSError as error:
        raise _cannot_write(target, error) from error
    return target


def copy(source: Path, target: Path) -> Path:
    """Copy a file in the manner of `write`."""

    def make(path: Path) -> None:
        shutil.copyfile(source, path)

    return write(target, make)


def _cannot_write(target: Path, error: OSError) -> CannotKeep:
    return CannotKeep(
        f"cannot write {target}: {error.strerror or error}; choose a folder that can be written"
        " (the environment variable FORMATION_CACHE names the cache)"
    )


def _folders(fmu: Path) -> tuple[Path, ...]:
    """Return the folders of the cache that lead to an FMU."""
    return folder(), fmu.parents[1], fmu.parent


def _checksum_file(fmu: Path) -> Path:
    return fmu.with_name(f"{fmu.name}.sha256")


def _checksum_line(fmu: Path) -> str:
    """Return the checksum of a file as `sha256sum --check` reads it."""
    return f"{hashlib.sha256(fmu.read_bytes()).hexdigest()}  {fmu.name}\n"


def _check_rights(fmu: Path) -> None:
    """Refuse an FMU if others than this user and the administrator can write to it or its folders."""
    if sys.platform == "win32":  # the user's folders have lists of rights there
        return
    for path in (*_folders(fmu), fmu, _checksum_file(fmu)):
        try:
            status = path.stat()
        except OSError:
            continue
        if status.st_uid not in (os.geteuid(), 0):
            raise CannotKeep(
                f"the cache of built FMUs is not used, because {path} belongs to another user: remove it, or choose"
                " a folder of your own (the environment variable FORMATION_CACHE names the cache)"
            )
        if status.st_mode & _OTHERS_CAN_WRITE:
            raise CannotKeep(
                f"the cache of built FMUs is not used, because others can write to {path}: take that right away"
                f" (chmod -R go-w '{folder()}'), or choose a folder of your own (the environment variable"
                " FORMATION_CACHE names the cache)"
            )
