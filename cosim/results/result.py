"""The result of a run as plain arrays; an xarray dataset is a view of it, which is made when somebody asks for it.

The attributes have the names that they have in xarray: whatever only reads a result takes either.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError, nearest

if TYPE_CHECKING:
    import xarray as xr

Attributes: TypeAlias = Mapping[Any, Any]
"""Texts and numbers by name."""


@dataclass(frozen=True, eq=False)
class Variable:
    """An array with names.

    Attributes
    ----------
    dims : tuple of str
        Names of its dimensions.
    values : ndarray
        Numbers, or texts.
    attrs : dict
        Its attributes, such as ``units``.
    """

    dims: tuple[str, ...]
    values: NDArray[Any]
    attrs: Attributes = field(default_factory=dict)

    def at(self, dim: str, index: int | slice) -> Variable:
        """Return a part of it along a dimension; a view."""
        axis = self.dims.index(dim)
        dims = self.dims if isinstance(index, slice) else (*self.dims[:axis], *self.dims[axis + 1 :])
        return Variable(dims, self.values[(*(slice(None),) * axis, index)], self.attrs)

    def taken(self, dim: str, indices: Sequence[int]) -> Variable:
        """Return some of its entries along a dimension, in another order; a copy."""
        return Variable(self.dims, np.take(self.values, indices, self.dims.index(dim)), self.attrs)


@dataclass(frozen=True, eq=False)
class Result:
    """The result of a run.

    Attributes
    ----------
    data_vars : dict
        The recorded signals and those computed from them, by name.
    coords : dict
        The variables that describe others, by name: times, labels of components, and who is who.
    attrs : dict
        The provenance.
    """

    data_vars: Mapping[str, Variable]
    coords: Mapping[str, Variable]
    attrs: Attributes

    @classmethod
    def of(cls, result: xr.Dataset | Result) -> Result:
        """Return the arrays of a dataset; a result as it is."""
        if isinstance(result, Result):
            return result
        return cls(_variables(result.data_vars), _variables(result.coords), dict(result.attrs))

    @cached_property
    def dataset(self) -> xr.Dataset:
        """The result as an xarray dataset, which shares the arrays."""
        import xarray as xr  # slow to import, and not everybody asks for it

        variables, coordinates = (
            {name: (variable.dims, variable.values, dict(variable.attrs)) for name, variable in group.items()}
            for group in (self.data_vars, self.coords)
        )
        return xr.Dataset(variables, coordinates, dict(self.attrs))

    @cached_property
    def sizes(self) -> dict[str, int]:
        """The sizes of all dimensions."""
        return {
            dim: size
            for variable in (*self.data_vars.values(), *self.coords.values())
            for dim, size in zip(variable.dims, variable.values.shape, strict=True)
        }

    @cached_property
    def robots(self) -> tuple[str, ...]:
        """The followers' ids."""
        return tuple(str(robot) for robot in self["robot"].values)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how it is made again: without what was computed from it."""
        return Result, (self.data_vars, self.coords, self.attrs)

    def __getitem__(self, name: str) -> Variable:
        """Return a variable."""
        return self.data_vars[name] if name in self.data_vars else self.coords[name]

    def __contains__(self, name: str) -> bool:
        """Return whether there is such a variable."""
        return name in self.data_vars or name in self.coords

    def of_robot(self, name: str, robot: str) -> NDArray[Any]:
        """Return a follower's part of a variable."""
        variable = self[name]
        place: tuple[Any, ...] = (*(slice(None),) * variable.dims.index("robot"), self.row(robot))
        course: NDArray[Any] = variable.values[place]
        return course

    def of_robots(self, name: str) -> NDArray[Any]:
        """Return a variable (time, robots, ...) that all followers have."""
        return by_robot(self[name])

    def components(self, name: str) -> list[str]:
        """Return the names of a signal's components; one without a name of a signal that has none."""
        dims = [dim for dim in self[name].dims if dim not in ("time", "robot")]
        if not dims:
            return [""]
        if len(dims) == 1 and dims[0] in self:
            return [str(label) for label in self[dims[0]].values]
        return [str(number) for number in range(math.prod(self.sizes[dim] for dim in dims))]

    def row(self, robot: str) -> int:
        """Return the place of a follower along the dimension ``robot``; raises InputError if there is none."""
        if robot not in self._rows:
            raise InputError(f"the result has no follower {robot!r}: {nearest(robot, list(self._rows))}")
        return self._rows[robot]

    @cached_property
    def _rows(self) -> dict[str, int]:
        return {robot: row for row, robot in enumerate(self.robots)}

    def samples(self, start: float, stop: float) -> slice:
        """Return which samples are those from a time [s] to another, both included."""
        if (found := self._samples.get((start, stop))) is None:
            time = self["time"].values
            found = slice(int(time.searchsorted(start, "left")), int(time.searchsorted(stop, "right")))
            self._samples[start, stop] = found
        return found

    @cached_property
    def _samples(self) -> dict[tuple[float, float], slice]:
        return {}

    def between(self, start: float, stop: float) -> Result:
        """Return the samples from a time [s] to another, both included; views."""
        return self.within(self.samples(start, stop))

    def within(self, samples: slice) -> Result:
        """Return some of the samples; views."""
        data_vars, coords = (
            {name: one.at("time", samples) if "time" in one.dims else one for name, one in group.items()}
            for group in (self.data_vars, self.coords)
        )
        return Result(data_vars, coords, self.attrs)


def by_robot(variable: Variable) -> NDArray[Any]:
    """Return a variable that all followers have with time and followers first (T, N, ...)."""
    first = variable.dims.index("time"), variable.dims.index("robot")
    return variable.values if first == (0, 1) else np.moveaxis(variable.values, first, (0, 1))


def _variables(group: Mapping[Hashable, xr.DataArray]) -> dict[str, Variable]:
    return {str(name): Variable(tuple(map(str, one.dims)), one.values, dict(one.attrs)) for name, one in group.items()}
