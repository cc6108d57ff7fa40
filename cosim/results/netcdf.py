"""A result as a file of netCDF-4, written through HDF5 directly.

A netCDF-4 file is an HDF5 file in which each dimension is a *dimension scale*: the array of its labels, or an array
without meaning if it has none. Every variable refers to its dimensions' scales and lists their numbers. The attribute
``coordinates`` of a variable names the variables that describe it; coordinates that describe no variable stand in that
of the file. Every attribute is as xarray writes it, so that xarray reads the same dataset.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from cosim.results.result import Attributes, Result, Variable
from cosim.storage import blocks, take

_NO_LABELS = "This is a netCDF dimension but not a netCDF variable.%10d"
"""The name of a scale without labels, with the dimension's size; readers know it by this sentence."""
_ROOM = 2**20
"""Bytes, more than the library needs for what it keeps of its own in a file of a few hundred variables."""
_TEXT = h5py.string_dtype()
_MADE_BY = np.bytes_(f"version=2,h5py={h5py.__version__},hdf5={h5py.version.hdf5_version}")


def netcdf(result: Result, place: FileIO) -> None:
    """Write the file of a result.

    Numbers are stored as they are: to compress them takes ten times as long as to write them, and saves a third.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    with _Sturdy(place, 0, _upper_limit(result)).opened("w") as file:
        _fill(file, result)


def _fill(file: h5py.File, result: Result) -> None:
    numbers = {dim: number for number, dim in enumerate(result.sizes)}
    described, of_the_file = _coordinates(result)
    scales = {dim: _write_scale(file, dim, result.coords.get(dim), size) for dim, size in result.sizes.items()}
    courses: list[tuple[h5py.Dataset, NDArray[Any]]] = []
    for name, variable in (*result.data_vars.items(), *result.coords.items()):
        dataset = scales[name] if name in scales else _write(file, name, variable)
        if _is_course(variable):
            courses.append((dataset, variable.values))
        if variable.dims:
            dataset.attrs["_Netcdf4Coordinates"] = np.array([numbers[dim] for dim in variable.dims], np.int32)
        if described.get(name):
            dataset.attrs["coordinates"] = described[name]
        for axis, dim in enumerate(variable.dims if name not in scales else ()):
            dataset.dims[axis].attach_scale(scales[dim])
    for dim, scale in scales.items():
        scale.attrs["_Netcdf4Dimid"] = np.int32(numbers[dim])
    _set(file, result.attrs)
    if of_the_file:
        file.attrs["coordinates"] = of_the_file
    file.attrs["_NCProperties"] = _MADE_BY
    for block in blocks(result.sizes.get("time", 0), max((values[:1].size for _, values in courses), default=1)):
        for dataset, values in courses:
            dataset[block] = values[block]


def annotate(place: FileIO, attributes: Mapping[str, str]) -> None:
    """Add attributes to a file; those of these names are replaced.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    room = _ROOM + 2 * sum(len(text.encode()) for text in attributes.values())
    with _Sturdy(place, place.seek(0, os.SEEK_END), room).opened("r+") as file:
        file.attrs.update(attributes)


def attributes_of(path: Path) -> dict[str, Any]:
    """Return the attributes of a file as a whole; nothing else of it is read."""
    with h5py.File(path, "r") as file:
        return dict(file.attrs)


def _write_scale(file: h5py.File, dim: str, labels: Variable | None, size: int) -> h5py.Dataset:
    """Write the scale of a dimension."""
    if labels is not None:
        scale = _write(file, dim, labels)
        scale.make_scale(dim)
    else:
        scale = file.create_dataset(dim, (size,), ">f4", **_growing((size,)))
        scale.make_scale(_NO_LABELS % size)
    return scale


def _write(file: h5py.File, name: str, variable: Variable) -> h5py.Dataset:
    """Write values and attributes of a variable."""
    values = variable.values
    text = values.dtype.kind in "OU"
    if not text and values.dtype.kind not in "fiu":
        raise TypeError(f"the variable {name!r} holds {values.dtype}: a result holds numbers or texts")
    dataset = file.create_dataset(name, values.shape, _TEXT if text else values.dtype, **_growing(values.shape))
    if values.size and not _is_course(variable):
        dataset[...] = values.astype(object) if text else values
    if values.dtype.kind == "f":
        dataset.attrs["_FillValue"] = np.full(1, np.nan, values.dtype)
    _set(dataset, variable.attrs)
    return dataset


def _is_course(variable: Variable) -> bool:
    """Return whether a variable is written part by part."""
    return variable.dims[:1] == ("time",) and variable.values.dtype.kind == "f" and variable.values.size > 0


def _growing(shape: tuple[int, ...]) -> dict[str, Any]:
    """Return how an array is stored that has a dimension of size 0, which in netCDF is one that can grow."""
    if 0 not in shape:
        return {}
    return {"maxshape": tuple(size or None for size in shape), "chunks": tuple(size or 1 for size in shape)}


def _set(place: h5py.HLObject, attributes: Attributes) -> None:
    for name, value in attributes.items():
        place.attrs[name] = value if isinstance(value, str) else np.atleast_1d(value)


def _coordinates(result: Result) -> tuple[dict[str, str], str]:
    """Return the attribute ``coordinates`` of each variable, and that of the file."""
    describing = {name: set(one.dims) for name, one in result.coords.items() if name not in result.sizes}
    described = {
        name: sorted(other for other, dims in describing.items() if dims <= set(variable.dims))
        for name, variable in result.data_vars.items()
    }
    used = {other for others in described.values() for other in others}
    return {name: " ".join(others) for name, others in described.items()}, " ".join(sorted(describing.keys() - used))


def _upper_limit(result: Result) -> int:
    """Return how many bytes the file of a result has at most, but for texts that are mostly of other alphabets."""
    variables = (*result.data_vars.values(), *result.coords.values())
    attributes = [result.attrs, *(variable.attrs for variable in variables)]
    texts = sum(len(value) for group in attributes for value in group.values() if isinstance(value, str))
    return _ROOM + 2 * texts + sum(2**13 + variable.values.nbytes for variable in variables)


class _Sturdy:
    """A file for the HDF5 library, which does not survive a write that fails.

    Its space is taken first. Should a write fail in spite of that, it and all later ones are ignored, and the fault is
    raised once the library has closed the file.

    Parameters
    ----------
    file
        The file.
    size
        Bytes of its content so far.
    room
        Bytes of space that are taken for what will be written.
    """

    def __init__(self, file: FileIO, size: int, room: int) -> None:
        take(file, size + room)
        self._file, self._size, self._at = file, size, 0
        self._fault: OSError | None = None

    @contextmanager
    def opened(self, mode: str) -> Iterator[h5py.File]:
        """Let the library write in the block; raise the fault, if any, at its end."""
        try:
            with h5py.File(self, mode, track_order=True) as file:  # by which the netCDF library orders the variables
                yield file
        except Exception:
            if self._fault is None:
                raise
        if self._fault is not None:
            raise self._fault
        self._file.truncate(self._size)

    # What the library calls

    def read(self, size: int) -> bytes:
        buffer = bytearray(size)
        return bytes(buffer[: self.readinto(memoryview(buffer))])

    def readinto(self, buffer: memoryview) -> int:
        view, done = memoryview(buffer)[: max(self._size - self._at, 0)], 0
        self._file.seek(self._at)
        while done < len(view) and (count := self._file.readinto(view[done:])):
            done += count
        self._at += done
        return done

    def write(self, data: memoryview) -> int:
        view, done = memoryview(data), 0
        try:
            self._file.seek(self._at)
            while done < len(view) and self._fault is None:
                done += self._file.write(view[done:])
        except OSError as error:
            self._fault = error
        self._at += len(view)
        self._size = max(self._size, self._at)
        return len(view)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def truncate(self, size: int) -> int:
        self._size = size
        return size

    def flush(self) -> None:
        """Do nothing: nothing is kept back."""
