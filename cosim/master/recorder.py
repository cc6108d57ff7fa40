"""The records of a run: one preallocated array a result variable that somebody wants, filled row by row."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.results.expectations.recorded import DERIVED, DERIVED_FROM
from cosim.results.result_variable import ResultVariable
from cosim.storage import Storage, blocks


class Recorder:
    """The result variables that are wanted, over the samples of a run.

    Parameters
    ----------
    samples
        How many samples the whole run has.
    variables
        The variables of the result.
    wanted
        Names of the signals that somebody will read, those computed from recorded ones among them; None for all.
    memory
        Arrays of an earlier run, whose records are overwritten; gets those of this one.
    allocate
        Returns a new array of a shape and a type.

    Attributes
    ----------
    recorded : int
        How many samples are recorded; whoever fills the arrays counts them.
    """

    def __init__(
        self,
        samples: int,
        variables: Sequence[ResultVariable],
        wanted: Collection[str] | None = None,
        memory: list[NDArray[Any]] | None = None,
        allocate: Callable[[tuple[int, ...], np.dtype[Any]], NDArray[Any]] = np.empty,
    ) -> None:
        self.variables = {variable.name: variable for variable in variables}
        self.wanted = wanted
        self.recorded = 0
        self._samples = samples
        self._allocate = allocate
        self._lent = memory is not None
        self._memory: list[NDArray[Any]] = [] if memory is None else memory
        self._used = 0
        self._ticks: slice | None = None
        self._arrays: dict[str, NDArray[np.float64]] = {}
        self._stores: list[tuple[NDArray[np.int_], NDArray[np.void]]] = []

    def wants(self, name: str) -> bool:
        """Return whether somebody will read a signal, recorded or computed."""
        return self.wanted is None or name in self.wanted

    def records(self, name: str) -> bool:
        """Return whether a variable of the run is recorded: it is wanted, or one that is wanted is computed from it."""
        return name in self.variables and (self.wants(name) or (name in DERIVED_FROM and any(map(self.wants, DERIVED))))

    def of(self, name: str) -> NDArray[np.float64]:
        """Return the array (samples, ...) of a variable, to write into."""
        if name not in self._arrays:
            self._arrays[name] = self._place(self.variables[name].shape, np.dtype(np.float64))
        return self._arrays[name]

    def keep(self, name: str, place: NDArray[np.float64]) -> None:
        """Take an array (samples, ...) into which a variable is written."""
        self._arrays[name] = place

    def place_of(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a place (samples, ...) for the values that an array has at the ticks."""
        return self._place(values.shape, values.dtype)

    def room_for(self, shape: tuple[int, ...]) -> NDArray[np.float64]:
        """Return an array (..., recorded samples) for what is computed of the records, to write into."""
        if not self._lent:
            return self._allocate((*shape, self.recorded), np.dtype(np.float64))
        room: NDArray[np.float64] = self._place(shape, np.dtype(np.float64)).reshape(-1)
        return room[: math.prod(shape) * self.recorded].reshape(*shape, self.recorded)

    def records_of(
        self, rows: NDArray[np.int_], dtype: np.dtype[np.void]
    ) -> tuple[NDArray[np.float64], NDArray[np.int_]]:
        """Return a place (samples, numbers) for records: one field for each variable, one record for each row.

        Parameters
        ----------
        rows
            The rows of the variables that the records are of.
        dtype
            The type of a record.

        Returns
        -------
        place : ndarray
            For the numbers of the fields that are recorded, record after record: NumPy copies records field by field
            and numbers at once.
        numbers : ndarray
            Which numbers of all records, one after the other, these are.
        """
        places = np.arange(len(rows) * dtype.itemsize // 8).view(_in_whole_numbers(dtype)).reshape(len(rows))
        names = [name for name in dtype.names or () if self.records(name)]
        if not names:
            return np.empty((self._samples, 0)), np.empty(0, dtype=np.int_)
        kept = np.dtype([(name, dtype[name]) for name in names])
        store = self._place((len(rows),), kept)
        self._stores.append((rows, store))
        numbers = np.concatenate([places[name].reshape(len(rows), -1) for name in names], axis=1).ravel()
        return store.view(np.float64).reshape(self._samples, -1), numbers

    def _place(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
        """Return an array, that of an earlier run if it fits: runs of a scenario ask for the same ones in turn."""
        shape, used = (self._samples, *shape), self._used
        self._used += 1
        if used == len(self._memory) or (self._memory[used].shape, self._memory[used].dtype) != (shape, dtype):
            self._memory[used:] = [self._allocate(shape, dtype)]
        return self._memory[used]

    @property
    def places(self) -> tuple[NDArray[Any], ...]:
        """The arrays into which ticks are recorded."""
        return tuple(self._memory[: self._used])

    def numbers(self, first: int, last: int) -> list[NDArray[np.float64]]:
        """Return the numbers of ticks, from one to before another, of each place: views (ticks, numbers)."""
        shapes = [(last - first, math.prod(place.shape[1:])) for place in self.places]
        return [p[first:last].reshape(shape).view(np.float64) for p, shape in zip(self.places, shapes, strict=True)]

    @property
    def ticks(self) -> slice:
        """The recorded ticks."""
        return slice(0, self.recorded, 1) if self._ticks is None else self._ticks

    def part(self, ticks: slice) -> Recorder:
        """Return the records of some of the recorded ticks; views if possible."""
        made = copy(self)
        made._ticks = slice(ticks.start, ticks.stop, ticks.step or 1)
        made.recorded = len(range(ticks.start, ticks.stop, ticks.step or 1))
        made._memory, made._lent, made._used, made._allocate = [], False, 0, np.empty
        made._arrays = {name: _some(array, ticks) for name, array in self._arrays.items()}
        made._stores = [(rows, _some(store, ticks)) for rows, store in self._stores]
        return made

    def arrays(self, storage: Storage | None = None) -> dict[str, NDArray[np.float64]]:
        """Return the recorded part of every variable that is recorded, by name; views if possible."""
        kept = storage or Storage()
        return {name: self._recorded_part(name, kept) for name in self.variables if self.records(name)}

    def _recorded_part(self, name: str, storage: Storage) -> NDArray[np.float64]:
        if name in self._arrays:
            return self._arrays[name][: self.recorded]
        stores = [
            (rows, store[name][: self.recorded]) for rows, store in self._stores if name in (store.dtype.names or ())
        ]
        shape = (self.recorded, *self.variables[name].shape)
        if len(stores) == 1 and stores[0][1].shape == shape:
            return stores[0][1]
        found = storage.empty(shape)
        for block in blocks(self.recorded, math.prod(shape[1:])):
            found[block] = np.nan
            for rows, values in stores:
                found[block, rows] = values[block]
        return found


def _some(values: NDArray[Any], ticks: slice) -> NDArray[Any]:
    """Return some samples of an array, in one piece if it is: nothing is compiled anew for arrays of another form."""
    part = values[ticks]
    return np.ascontiguousarray(part) if values.flags.c_contiguous else part


def _in_whole_numbers(dtype: np.dtype[np.void]) -> np.dtype[np.void]:
    """Return a type of records of numbers with whole numbers in their places."""
    return np.dtype([(name, np.int_, dtype[name].shape) for name in dtype.names or ()])
