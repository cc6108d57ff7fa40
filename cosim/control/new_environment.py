"""Making a Python environment for controllers: by uv where there is one, else by venv and pip."""

from __future__ import annotations

import errno
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

from cosim.control.environment import interpreter_in
from cosim.errors import InputError, OutputError, printable
from cosim.undisturbed import undisturbed

T = TypeVar("T")

SHARED = "_formation_libraries.pth"
"""The file by which an environment has the libraries of another one."""
_FULL = os.strerror(errno.ENOSPC)
_LABEL = r"(ERROR|[Ee]rror|[Cc]ause|Caused by): *"
_LINES = 6
"""Lines of an installer's complaint that are shown."""


def create(
    folder: Path,
    packages: Sequence[str],
    *,
    python: str = "",
    wheels: Path | None = None,
    share: bool = False,
    check: Callable[[Path], T],
) -> T:
    """Make an environment with packages, all of it or nothing; return what `check` tells of it.

    Parameters
    ----------
    folder
        Its folder, which does not exist or is empty.
    packages
        Each a name with a version range, a wheel, or the folder of a project, as pip takes them.
    python
        An interpreter, or a version for uv; without one, the Python of this process.
    wheels
        A folder: packages are taken from it, and nothing is downloaded.
    share
        Whether the environment has the libraries of this one besides, such as NumPy and Numba; of the packages named
        nothing more is installed then.
    check
        Is called with the folder; what it raises is a reason to leave nothing.

    Raises
    ------
    InputError
        The folder is in use, or a package cannot be installed.
    OutputError
        The folder cannot be written, or the disk is full.
    """
    if os.path.lexists(folder) and not (folder.is_dir() and not any(folder.iterdir())):
        raise InputError(f"{folder} is there already: name another folder, or remove it")
    if wheels is not None and not wheels.is_dir():
        raise InputError(f"--wheels {wheels}: there is no such folder")
    wanted = [_wanted(package) for package in packages]
    uv = shutil.which("uv")
    with _whole_or_nothing(folder):
        _run(_make(folder, python, uv), folder, "cannot be made")
        if share:
            _share(folder)
        _run(_install(folder, wanted, wheels, share, uv), folder, "cannot be completed")
        return check(folder)


@contextmanager
def _whole_or_nothing(folder: Path) -> Iterator[None]:
    """Remove what the block has made if it fails: the content of a folder, or it with the folders above it."""
    made = [place for place in (folder, *folder.parents) if not os.path.lexists(place)]
    try:
        yield
    except BaseException as error:
        with undisturbed():
            for path in folder.iterdir() if not made and folder.is_dir() else made[:1]:
                _remove(path)
            for place in made[1:]:
                with suppress(OSError):  # somebody else has put something there
                    place.rmdir()
        if isinstance(error, OSError):
            raise OutputError(f"{folder} cannot be written: {error.strerror}") from error
        raise


def _remove(path: Path) -> None:
    with suppress(OSError):  # there is no such path, or its removal fails as its making did, which is what to tell
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink()


def _wanted(package: str) -> str:
    """Return a package as pip takes it; a path is told from a name."""
    path = Path(package)
    if path.suffix == ".whl" or os.sep in package or path.is_dir():
        if not (os.path.isfile(path) or os.path.isdir(path)):  # a pipe or a device may never end
            raise InputError(f"{package}: there is no such wheel or folder")
        if path.is_dir() and not any((path / name).exists() for name in ("pyproject.toml", "setup.py")):
            raise InputError(f"{package} is no project: it has no pyproject.toml (--wheels names a folder of wheels)")
        return os.path.abspath(path)
    if not re.match(r"[A-Za-z0-9]", package):
        raise InputError(f"{package}: expected a package with a version range, a wheel, or the folder of a project")
    return package


def _make(folder: Path, python: str, uv: str | None) -> list[str]:
    if uv is not None:
        return [uv, "venv", "--quiet", "--python", python or sys.executable, str(folder)]
    return [_interpreter(python), "-I", "-m", "venv", *(["--without-pip"] if _has_pip() else []), str(folder)]


def _install(folder: Path, packages: Sequence[str], wheels: Path | None, share: bool, uv: str | None) -> list[str]:
    interpreter = str(interpreter_in(folder))
    if uv is not None:
        command = [uv, "pip", "install", "--quiet", "--python", interpreter]
    elif _has_pip():
        command = [sys.executable, "-I", "-m", "pip", "--python", interpreter, "install"]
    else:
        command = [interpreter, "-I", "-m", "pip", "install"]
    if uv is None:
        command += ["--quiet", "--disable-pip-version-check", "--no-input", "--retries", "1"]
    command += ["--no-deps"] if share else []
    command += ["--no-index", "--find-links", str(wheels)] if wheels is not None else []
    return [*command, *packages]


def _interpreter(python: str) -> str:
    found = shutil.which(python) if python else sys.executable
    if found is None:
        raise InputError(f"--python {python}: there is no such interpreter")
    return found


def _has_pip() -> bool:
    from importlib.util import find_spec

    return find_spec("pip") is not None


def _share(folder: Path) -> None:
    """Let an environment find libraries where this process finds NumPy; what it has itself comes first.

    Then come the controllers of this process, which lie elsewhere if they are installed for editing.
    """
    from importlib.util import find_spec

    found = (find_spec(name) for name in ("numpy", "formation_controllers"))
    places = dict.fromkeys(Path(spec.origin).parents[1] for spec in found if spec is not None and spec.origin)
    for packages in folder.glob("[Ll]ib/**/site-packages"):
        (packages / SHARED).write_text("".join(f"{place}\n" for place in places), encoding="utf-8")


def _run(command: Sequence[str], folder: Path, failed: str) -> None:
    """Run a command; if it fails, tell why in its own words."""
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            env={**os.environ, "COLUMNS": "10000", "NO_COLOR": "1"},  # a complaint is one line
        )
    except OSError as error:
        raise InputError(f"{folder} {failed}: {command[0]} cannot be started: {error.strerror}") from None
    if done.returncode == 0:
        return
    lines = [line.strip() for line in (done.stderr or done.stdout).splitlines() if line.strip()]
    complaints = [line for line in lines if re.match(rf"{_LABEL}|×|x |╰", line)] or lines
    if full := next((line for line in lines if _FULL in line), ""):
        raise OutputError(f"{folder} {failed}: {printable(full)}; make room") from OSError(errno.ENOSPC, _FULL)
    text = printable("; ".join(re.sub(f"^{_LABEL}", "", line) for line in complaints[-_LINES:]))
    hint = "; without a network, --wheels DIR takes packages from a folder" if _offline("\n".join(lines)) else ""
    raise InputError(f"{folder} {failed}: {text or f'{Path(command[0]).name} ended with {done.returncode}'}{hint}")


def _offline(text: str) -> bool:
    signs = ("NewConnectionError", "Failed to establish", "ConnectTimeout", "ProxyError", "dns error", "error sending")
    return any(sign in text for sign in signs)
