"""The records of a run: one preallocated array a result variable, filled row by row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.results.result_variable import ResultVariable


class Recorder:
    """All result variables over the samples of a run; a sample that is not recorded is NaN.

    Parameters
    ----------
    samples
        How many samples the whole run has.
    variables
        The variables of the result.

    Attributes
    ----------
    recorded : int
        How many samples are recorded; whoever fills the arrays counts them.
    """

    def __init__(self, samples: int, variables: Sequence[ResultVariable]) -> None:
        self.variables = {variable.name: variable for variable in variables}
        self.recorded = 0
        self._samples = samples
        self._arrays: dict[str, NDArray[np.float64]] = {}
        self._records: list[tuple[NDArray[np.int_], NDArray[np.void]]] = []

    def of(self, name: str) -> NDArray[np.float64]:
        """Return the array (samples, ...) of a variable, to write into."""
        return self._arrays.setdefault(name, np.full((self._samples, *self.variables[name].shape), np.nan))

    def keep(self, name: str, place: NDArray[np.float64]) -> None:
        """Take an array (samples, ...) into which a variable is written."""
        self._arrays[name] = place

    def place_of(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a place (samples, ...) for the values that an array has at the ticks."""
        return np.full((self._samples, *values.shape), np.nan)

    def records_of(self, rows: NDArray[np.int_], dtype: np.dtype[np.void]) -> NDArray[np.float64]:
        """Return a place (samples, numbers) for records: one field for each variable, one record for each row.

        Parameters
        ----------
        rows
            The rows of the variables that the records are of.
        dtype
            The type of a record. The place has the numbers of all records one after the other, as NumPy copies records
            field by field and numbers at once.
        """
        store = np.zeros((self._samples, len(rows)), dtype)
        self._records.append((rows, store))
        return store.view(np.float64).reshape(self._samples, -1)

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return the recorded part of every variable, by name."""
        arrays = {name: array[: self.recorded] for name, array in self._arrays.items()}
        for name in self.variables.keys() - arrays.keys():
            arrays[name] = np.full((self.recorded, *self.variables[name].shape), np.nan)
            for rows, store in self._records:
                if name in (store.dtype.names or ()):
                    arrays[name][:, rows] = store[name][: self.recorded]
        return {name: arrays[name] for name in self.variables}
