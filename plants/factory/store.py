"""Where FMUs are kept: one folder for each combination of sources and tools, named by a digest of both."""

import hashlib
import importlib.metadata
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

import plants
from plants.errors import BuildError


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


class CannotWrite(BuildError):
    """A folder cannot be written."""


def write(target: Path, make: Callable[[Path], None]) -> Path:
    """Make a file so that no other process ever sees half of it: `make` writes it elsewhere, then it is moved.

    Parameters
    ----------
    target
        The file. An older one is replaced.
    make
        Is given the path of a file to write, alone in a temporary folder.

    Raises
    ------
    CannotWrite
        The folder cannot be written.
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".build-", dir=target.parent) as scratch:
            made = Path(scratch) / target.name
            make(made)
            os.replace(made, target)
    except OSError as error:
        raise CannotWrite(
            f"cannot write {target}: {error.strerror or error}; choose a folder that can be written"
            " (the environment variable FORMATION_CACHE names the cache)"
        ) from error
    return target


def copy(source: Path, target: Path) -> Path:
    """Copy a file in the manner of `write`."""

    def make(path: Path) -> None:
        shutil.copyfile(source, path)

    return write(target, make)
