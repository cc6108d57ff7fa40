"""The C compiler of this machine, and the shared library that it makes of an FMU's sources."""

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from plants.errors import BuildError, NoCompiler

# No contraction to fused multiply-add: the same numbers on every machine.
FLAGS = (
    "-std=c11",
    "-O2",
    "-ffp-contract=off",
    "-fvisibility=hidden",
    "-shared",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
)

_INSTALL = """\
there is no C compiler: neither $CC nor cc, gcc or clang was found. Install one:
  Debian, Ubuntu  sudo apt install gcc libc6-dev
  Fedora          sudo dnf install gcc
  macOS           xcode-select --install
  Windows         winget install LLVM.LLVM, or MinGW-w64 from https://www.mingw-w64.org, and add it to PATH"""


@dataclass(frozen=True)
class Platform:
    """Where FMI 2.0 wants a binary (section 2.3), and how it is linked."""

    folder: str
    suffix: str
    flags: tuple[str, ...]
    libraries: tuple[str, ...]


PLATFORMS = {
    "linux": Platform("linux64", ".so", ("-fPIC", "-Wl,--no-undefined"), ("-lm",)),
    "darwin": Platform("darwin64", ".dylib", ("-fPIC",), ("-lm",)),
    "win32": Platform("win64", ".dll", (), ()),
}


@dataclass(frozen=True)
class Compiler:
    """A C compiler: the command, and its version line, which tells one compiler from another."""

    command: tuple[str, ...]
    version: str


def host() -> Platform:
    """Return the platform of this machine."""
    if sys.platform not in PLATFORMS or sys.maxsize <= 2**32:
        known = ", ".join(PLATFORMS)
        raise BuildError(f"cannot build for {sys.platform}: only for {known}, with 64 bits")
    return PLATFORMS[sys.platform]


def find_compiler() -> Compiler:
    """Return the compiler that $CC names, or else the first of cc, gcc and clang.

    Raises
    ------
    NoCompiler
        There is none; the message says what to install. Or $CC names one that is not there.
    """
    named = shlex.split(os.environ.get("CC", ""))
    for command in [named] if named else [["cc"], ["gcc"], ["clang"]]:
        path = shutil.which(command[0])
        if path is not None:
            full = (path, *command[1:])
            return Compiler(full, _run([*full, "--version"]).stdout.partition("\n")[0])
    if named:
        raise NoCompiler(f"the C compiler that $CC names, {named[0]!r}, was not found: correct CC or unset it")
    raise NoCompiler(_INSTALL)


def compile_library(
    compiler: Compiler, platform: Platform, root: Path, sources: Sequence[str], name: str, flags: Sequence[str] = ()
) -> Path:
    """Compile an FMU's sources to the shared library of one platform.

    Parameters
    ----------
    compiler, platform
        What compiles, and for what.
    root
        The folder that holds the FMU's content.
    sources
        Paths of the C files, relative to `root`.
    name
        The model's identifier.
    flags
        Further flags.

    Returns
    -------
    Path
        The library, in the folder of `root` where FMI wants it.

    Raises
    ------
    BuildError
        The compiler failed; its message is shown.
    """
    library = f"binaries/{platform.folder}/{name}{platform.suffix}"
    (root / library).parent.mkdir(parents=True, exist_ok=True)
    # Relative paths and this folder: nothing of this machine enters the binary.
    arguments = [*FLAGS, *platform.flags, *flags, "-o", library, *sources, *platform.libraries]
    result = _run([*compiler.command, *arguments], cwd=root)
    if result.returncode != 0:
        message = (result.stderr or result.stdout).strip()
        raise BuildError(
            f"the C compiler {shlex.join(compiler.command)} failed (status {result.returncode}):\n{message}"
        )
    return root / library


def _run(command: Sequence[str], cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(command, cwd=cwd, capture_output=True, text=True, errors="replace", check=False)
    except OSError as error:
        raise BuildError(f"the C compiler {command[0]} could not be run: {error}") from error
