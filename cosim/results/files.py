"""The result of a run in a file, written whole or not at all, and read again."""

from __future__ import annotations

import errno
import os
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import TYPE_CHECKING

from cosim.errors import InputError, OutputError
from cosim.results.form import in_form
from cosim.results.netcdf import annotate as netcdf_attributes
from cosim.results.netcdf import netcdf
from cosim.results.result import Result
from cosim.results.trial_reading import harm_of
from cosim.storage import take, write_all
from plants import scratch

if TYPE_CHECKING:
    import xarray as xr

_PIECE = 2**20
"""Bytes of a file that are copied at once."""
_HDF5 = b"\x89HDF\r\n\x1a\n"
"""First bytes of a netCDF file of version 4."""


def save(result: xr.Dataset | Result, path: Path) -> None:
    """Write a result as NetCDF, whole or not at all: an older file stays until the new one is complete.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    with replacing(path) as file:
        netcdf(Result.of(result), file)


def annotate(path: Path, **attributes: str) -> None:
    """Add attributes to a result in a file, whole or not at all.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    try:
        earlier = path.open("rb")
    except OSError as error:
        raise OutputError(f"{path} cannot be completed: {error.strerror}") from None
    with earlier, replacing(path) as file:
        take(file, os.fstat(earlier.fileno()).st_size)
        file.seek(0)
        while piece := earlier.read(_PIECE):
            write_all(file, piece)
        netcdf_attributes(file, attributes)


def writable_folder(folder: Path, option: str) -> Path:
    """Make the folder that an option names and try it, before anything is computed.

    Raises
    ------
    OutputError
        Nothing can be written there.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise OutputError(
            f"results cannot be written to {folder}: {_why(folder, error)}; choose another {option}"
        ) from None
    return folder


def _why(folder: Path, error: OSError) -> str:
    """Return why a folder cannot be written to: of one that is not there, which folder above it refuses it."""
    there = next((place for place in (folder, *folder.absolute().parents) if os.path.lexists(place)), folder)
    if there == folder:
        return str(error.strerror)
    if not there.is_dir():
        return f"{there} is no folder"
    reason = "" if error.errno == errno.ENOENT else f" ({error.strerror})"  # as of /proc, which is there
    return f"no folder can be made in {there}{reason}"


def writable_file(path: Path, option: str) -> None:
    """Try the folder of a file that an option names, as `writable_folder`, unless it is a pipe or the like."""
    if not is_stream(path):
        writable_folder(path.parent, option)


def write(path: Path, data: bytes | memoryview) -> None:
    """Write a file whole or not at all.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    with replacing(path) as file:
        write_all(file, data)


@contextmanager
def replacing(path: Path) -> Iterator[FileIO]:
    """Yield a file to be written, which takes the place of another one at the end of the block.

    A symbolic link stays, and so does a pipe or a device: what is written goes there.

    Raises
    ------
    OutputError
        It cannot be written; the other file is left as it is.
    """
    try:
        if is_stream(path):
            with tempfile.TemporaryFile(buffering=0) as file:
                yield file
                file.seek(0)
                _append(path, file)
            return
        target = Path(os.path.realpath(path))
        with scratch.folder(target.parent, ".formation-") as folder:  # which a killed process leaves behind
            partial = folder / target.name
            with partial.open("w+b", buffering=0) as file:
                yield file
            os.chmod(partial, 0o666 & ~_umask())
            os.replace(partial, target)
    except OSError as error:
        if error.errno is None:  # of a library
            raise
        raise OutputError(f"{path} cannot be written: {error.strerror}") from None


def is_stream(path: Path) -> bool:
    """Return whether a path is no file that can be replaced, such as ``/dev/stdout``, ``/dev/null`` or a pipe."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    opened = path.parent.name == "fd" or str(path) in ("/dev/stdout", "/dev/stderr")  # by this process, by a shell
    return stat.S_ISCHR(mode) or stat.S_ISFIFO(mode) or (stat.S_ISREG(mode) and opened)


def _append(path: Path, file: FileIO) -> None:
    with path.open("ab", buffering=0) as stream:
        while piece := file.read(_PIECE):
            write_all(stream, piece)


def _umask() -> int:
    os.umask(mask := os.umask(0))
    return mask


def load(path: str | Path) -> xr.Dataset:
    """Read a result that `save` has written."""
    import xarray as xr

    result = xr.load_dataset(path, engine="h5netcdf", phony_dims="access")  # of a file without names, else a warning
    result.encoding.pop("unlimited_dims", None)  # set for a variable without entries; a part of it could not be saved
    return result


def load_run(path: Path) -> Result:
    """Read the result of a run as `load_result` does, and refuse what has not its form."""
    result = Result.of(load_result(path))
    try:
        return in_form(result)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def load_result(path: str | Path) -> xr.Dataset:
    """Read the result of a run.

    Parameters
    ----------
    path
        Its file ``result.nc``, or the folder of the run.

    Raises
    ------
    InputError
        There is none, or it cannot be read.
    """
    path = Path(path)
    file = path / "result.nc" if os.path.isdir(path) else path
    if not os.path.isfile(file):
        what = f"the folder {path} holds no result.nc" if os.path.isdir(path) else f"there is no file {path}"
        raise InputError(f"{what}; expected the result of a run, runs/NAME/result.nc, or its folder")
    if harm := harm_of(file):
        raise InputError(f"{file} cannot be read as the result of a run: {harm}")
    with _quiet_ends():
        try:
            return load(file)
        except Exception as error:  # the libraries raise many kinds
            said = f"{type(error).__name__}: {error}"
    with suppress(OSError), file.open("rb") as stream:
        if stream.read(len(_HDF5)) != _HDF5:
            raise InputError(f"{file} is no netCDF file; expected the result of a run, result.nc")
    raise InputError(f"{file} cannot be read as the result of a run: {said}")


@contextmanager
def _quiet_ends() -> Iterator[None]:
    """Let objects that cannot be closed print no traceback: those of a library that has failed already."""
    before, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        yield
    finally:
        sys.unraisablehook = before
