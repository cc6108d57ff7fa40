"""The platforms that an FMU can hold binaries for, and where each version of FMI wants them."""

import platform
import struct
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from plants.errors import BuildError


@dataclass(frozen=True)
class Platform:
    """A platform.

    Parameters
    ----------
    name
        As users write it.
    fmi2, fmi3
        Folder in ``binaries/`` (FMI 2.0.4, section 2.3, and FMI 3.0, section 2.5.1.4).
    target
        The target's name in zig. On Linux with the oldest C library to support.
    suffix
        Of a shared library.
    flags, libraries
        For the compiler, before and after the sources.
    """

    name: str
    fmi2: str
    fmi3: str
    target: str
    suffix: str
    flags: tuple[str, ...]
    libraries: tuple[str, ...]

    def folder(self, fmi: str) -> str:
        """Return the folder in ``binaries/`` for a version of FMI."""
        return self.fmi2 if fmi == "2.0" else self.fmi3


_LINUX = (".so", ("-fPIC", "-Wl,--no-undefined"), ("-lm",))
_MACOS = (".dylib", ("-fPIC",), ("-lm",))
_WINDOWS: tuple[str, tuple[str, ...], tuple[str, ...]] = (".dll", (), ())

# FMI 2.0 knows no processors but Intel's. On others, tools (FMPy among them) look into the folder of the same system.
PLATFORMS = {
    platform.name: platform
    for platform in (
        Platform("linux-x86_64", "linux64", "x86_64-linux", "x86_64-linux-gnu.2.17", *_LINUX),
        Platform("linux-aarch64", "linux64", "aarch64-linux", "aarch64-linux-gnu.2.17", *_LINUX),
        Platform("windows-x86_64", "win64", "x86_64-windows", "x86_64-windows-gnu", *_WINDOWS),
        Platform("macos-x86_64", "darwin64", "x86_64-darwin", "x86_64-macos", *_MACOS),
        Platform("macos-arm64", "darwin64", "aarch64-darwin", "aarch64-macos", *_MACOS),
    )
}

_SYSTEMS = {"linux": "linux", "win32": "windows", "darwin": "macos"}
_MACHINES = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}


def host() -> Platform:
    """Return the platform of this machine.

    Raises
    ------
    BuildError
        The platform is not known.
    """
    machine = _MACHINES.get(platform.machine().lower())
    name = f"{_SYSTEMS.get(sys.platform)}-{'arm64' if sys.platform == 'darwin' and machine == 'aarch64' else machine}"
    if name not in PLATFORMS or sys.maxsize <= 2**32:
        raise BuildError(
            f"cannot build for this machine, {sys.platform} on {platform.machine()}: only for {', '.join(PLATFORMS)}"
        )
    return PLATFORMS[name]


def choose(names: str | Iterable[str], fmi: str) -> tuple[Platform, ...]:
    """Return platforms by name, in the order of the table.

    Parameters
    ----------
    names
        Names of platforms, or one name. ``all`` is every platform that one FMU can hold.
    fmi
        Version of FMI.

    Raises
    ------
    BuildError
        A name is not known, or an FMU of this version cannot hold them together.
    """
    wanted = {names} if isinstance(names, str) else set(names)
    for name in sorted(wanted - {"all", *PLATFORMS}):
        raise BuildError(f"the platform {name!r} is not known; choose from {', '.join(PLATFORMS)}, or all")
    if not wanted:
        raise BuildError(f"no platform is named; choose from {', '.join(PLATFORMS)}, or all")
    if "all" in wanted:
        wanted |= set(PLATFORMS) - ({"linux-aarch64"} if fmi == "2.0" else set())
    chosen = tuple(p for p in PLATFORMS.values() if p.name in wanted)
    if fmi == "2.0" and {"linux-x86_64", "linux-aarch64"} <= {p.name for p in chosen}:
        raise BuildError(
            "FMI 2.0 has one folder, linux64, for both linux-x86_64 and linux-aarch64:"
            " build two FMUs, or one for FMI 3.0"
        )
    return chosen


def universal(libraries: Sequence[bytes]) -> bytes:
    """Join libraries of macOS for several processors to one universal binary.

    The format is in Apple's <mach-o/fat.h>: a header in big-endian numbers, then the libraries, aligned to 2^14.
    """
    align = 14
    header, body = struct.pack(">II", 0xCAFEBABE, len(libraries)), b""
    offset = 1 << align
    for library in libraries:
        processor, subtype = struct.unpack_from("<II", library, 4)
        header += struct.pack(">IIIII", processor, subtype, offset, len(library), align)
        padding = -len(library) % (1 << align)
        body += library + bytes(padding)
        offset += len(library) + padding
    return header.ljust(1 << align, b"\0") + body
