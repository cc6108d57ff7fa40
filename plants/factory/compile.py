"""C compilers, this machine's own and zig for all platforms, and the shared library made of an FMU's sources."""

import errno
import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from plants.errors import BuildError, NoCompiler
from plants.factory import store
from plants.factory.platforms import Platform, host

# The same numbers on every machine, whatever flags $CC has: no shortcuts of arithmetic, no contraction to fused
# multiply-adds. And no -flto: gcc 12 then forgets the latter.
FLAGS = (
    "-std=c11",
    "-O3",
    "-fno-fast-math",
    "-fno-unsafe-math-optimizations",
    "-ffp-contract=off",
    "-fno-lto",
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
  Windows         winget install LLVM.LLVM, or MinGW-w64 from https://www.mingw-w64.org, and add it to PATH
  anywhere        pip install "formation-cosim[cross]", which brings one"""


@dataclass(frozen=True)
class Compiler:
    """A C compiler: the command, and the line by which it states its version."""

    command: tuple[str, ...]
    version: str


def installed(package: str) -> bool:
    """Tell whether a Python package is there."""
    return importlib.util.find_spec(package) is not None


def find_compiler() -> Compiler:
    """Return the compiler that $CC names, or else the first of cc, gcc and clang, or else zig.

    Raises
    ------
    NoCompiler
        There is none, and the message names packages to install; or $CC names one that is not there.
    """
    named = shlex.split(os.environ.get("CC", ""))
    for command in [named] if named else [["cc"], ["gcc"], ["clang"]]:
        path = shutil.which(command[0])
        if path is not None:
            full = (path, *command[1:])
            return Compiler(full, _run([*full, "--version"]).stdout.partition("\n")[0])
    if named:
        raise NoCompiler(f"the C compiler that $CC names, {named[0]!r}, was not found: correct CC or unset it")
    if not installed("ziglang"):
        raise NoCompiler(_INSTALL)
    return cross_compiler(host())


def cross_compiler(platform: Platform) -> Compiler:
    """Return zig's C compiler, from the Python package ziglang, for any platform.

    Raises
    ------
    NoCompiler
        The package is not installed.
    """
    if not installed("ziglang"):
        raise NoCompiler(
            f"a binary for {platform.name} needs the Python package ziglang, which compiles for all platforms:"
            ' pip install "formation-cosim[cross]"'
        )
    command = (sys.executable, "-m", "ziglang", "cc", "-target", platform.target, "-s")
    return Compiler(command, f"ziglang {store.version('ziglang')}")


def compile_library(
    compiler: Compiler, platform: Platform, root: Path, sources: Sequence[str], name: str, flags: Sequence[str] = ()
) -> bytes:
    """Compile an FMU's sources, as one translation unit, to the shared library of one platform.

    Parameters
    ----------
    compiler, platform
        The compiler, and the platform of the library.
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
    bytes
        The library.

    Raises
    ------
    BuildError
        The compiler failed; its message is shown.
    """
    with tempfile.TemporaryDirectory(dir=root) as scratch:
        # Relative paths from this folder: nothing of this machine enters the binary.
        paths = [Path(os.path.relpath(root / source, scratch)).as_posix() for source in sources]
        library, unit = name + platform.suffix, "unit.c"
        (Path(scratch) / unit).write_text("".join(f'#include "{path}"\n' for path in paths), encoding="utf-8")
        arguments = [*FLAGS, *platform.flags, *flags, "-o", library, unit, *platform.libraries]
        result = _run([*compiler.command, *arguments], cwd=Path(scratch))
        if result.returncode != 0:
            message = (result.stderr or result.stdout).strip()
            raise BuildError(
                f"the C compiler {shlex.join(compiler.command)} failed (status {result.returncode}):\n{message}"
            ) from _lack(message)
        return (Path(scratch) / library).read_bytes()


def _lack(message: str) -> OSError | None:
    """Return the error of the system by which a compiler failed, if its message names one that is a lack."""
    lacks = errno.ENOSPC, errno.EDQUOT, errno.ENOMEM, errno.EAGAIN
    return next((OSError(code, os.strerror(code)) for code in lacks if os.strerror(code) in message), None)


def _run(command: Sequence[str], cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    # A compiler that is killed leaves its temporary files: there they go with those of the build.
    variables = os.environ | ({} if cwd is None else dict.fromkeys(("TMPDIR", "TMP", "TEMP"), str(cwd)))
    try:
        return subprocess.run(
            command, cwd=cwd, env=variables, capture_output=True, text=True, errors="replace", check=False
        )
    except OSError as error:
        raise BuildError(f"the C compiler {command[0]} could not be run: {error}") from error
