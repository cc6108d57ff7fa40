"""A result as a file of netCDF-4, written through HDF5 directly.

A netCDF-4 file is an HDF5 file in which each dimension is a *dimension scale*: the array of its labels, or an array
without meaning if it has none. Every variable refers to its dimensions' scales and lists their numbers. The attribute
``coordinates`` of a variable names the variables that describe it; coordinates that describe no variable stand in that
of the file. Every attribute is as xarray writes it, so that xarray reads the same dataset.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from cosim.results.result import Attributes, Result, Variable

_NO_LABELS = "This is a netCDF dimension but not a netCDF variable.%10d"
"""The name of a scale without labels, with the dimension's size; readers know it by this sentence."""
_TEXT = h5py.string_dtype()
_MADE_BY = np.bytes_(f"version=2,h5py={h5py.__version__},hdf5={h5py.version.hdf5_version}")


def netcdf(result: Result) -> memoryview:
    """Return the content of the file of a result.

    Numbers are stored as they are: to compress them takes ten times as long as to write them, and saves a third.
    """
    buffer = io.BytesIO()
    numbers = {dim: number for number, dim in enumerate(result.sizes)}
    described, of_the_file = _coordinates(result)
    with h5py.File(buffer, "w", track_order=True) as file:  # by which the netCDF library orders the variables
        scales = {dim: _write_scale(file, dim, result.coords.get(dim), size) for dim, size in result.sizes.items()}
        for name, variable in (*result.data_vars.items(), *result.coords.items()):
            dataset = scales[name] if name in scales else _write(file, name, variable)
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
    return buffer.getbuffer()


def annotated(content: bytes, attributes: Mapping[str, str]) -> memoryview:
    """Return the content of a file with more attributes; those of these names are replaced."""
    buffer = io.BytesIO(content)
    with h5py.File(buffer, "r+") as file:
        file.attrs.update(attributes)
    return buffer.getbuffer()


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
    if values.size:
        dataset[...] = values.astype(object) if text else values
    if values.dtype.kind == "f":
        dataset.attrs["_FillValue"] = np.full(1, np.nan, values.dtype)
    _set(dataset, variable.attrs)
    return dataset


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
