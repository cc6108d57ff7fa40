"""The records of a run: one preallocated array a result variable, filled row by row."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.errors import Failure
from cosim.master.observer import Watched
from cosim.results.result_variable import ResultVariable


class Recorder:
    """An observer that keeps all result variables over the samples of a run; a sample that is not recorded is NaN.

    Parameters
    ----------
    samples
        How many samples the whole run has.
    variables
        The variables of the result.

    Attributes
    ----------
    recorded : int
        How many samples are recorded.
    """

    def __init__(self, samples: int, variables: Sequence[ResultVariable]) -> None:
        self.variables = {variable.name: variable for variable in variables}
        self.recorded = 0
        self._samples = samples
        self._arrays: dict[str, NDArray[np.float64]] = {}
        self._records: list[tuple[NDArray[np.int_], NDArray[np.void]]] = []
        self._arrays_to_copy: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
        self._telemetry: list[tuple[NDArray[np.float64], Callable[[float], NDArray[np.float64]]]] = []
        self._step = 0.0

    def of(self, name: str) -> NDArray[np.float64]:
        """Return the array (samples, ...) of a variable, to write into."""
        return self._arrays.setdefault(name, np.full((self._samples, *self.variables[name].shape), np.nan))

    def keep(self, name: str, place: NDArray[np.float64]) -> None:
        """Take an array (samples, ...) into which a variable is written."""
        self._arrays[name] = place

    def follow(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Copy an array at each tick from now on; return the place (samples, ...) of the copies."""
        place = np.full((self._samples, *values.shape), np.nan)
        self._arrays_to_copy.append((place, values))
        return place

    def ask(
        self, rows: NDArray[np.int_], dtype: np.dtype[np.void], telemetry: Callable[[float], NDArray[np.float64]]
    ) -> None:
        """Ask at each tick for records of numbers: one field for each variable, one record for each row.

        Parameters
        ----------
        rows
            The rows of the variables that the records fill.
        dtype
            The type of a record.
        telemetry
            Returns at a time [s] the numbers of all records one after the other, as NumPy copies records field by field
            and numbers at once.
        """
        store = np.zeros((self._samples, len(rows)), dtype)
        self._records.append((rows, store))
        self._telemetry.append((store.view(np.float64).reshape(self._samples, -1), telemetry))

    def started(self, run: Watched) -> None:
        """Keep the communication step."""
        self._step = run.clock.step

    def ticked(self, tick: int) -> None:
        """Record a tick."""
        for place, values in self._arrays_to_copy:
            place[tick] = values
        for store, telemetry in self._telemetry:
            store[tick] = telemetry(tick * self._step)
        self.recorded = tick + 1

    def ended(self, failure: Failure | None) -> None:
        """Do nothing: the records stay."""

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return the recorded part of every variable, by name."""
        arrays = {name: array[: self.recorded] for name, array in self._arrays.items()}
        for name in self.variables.keys() - arrays.keys():
            arrays[name] = np.full((self.recorded, *self.variables[name].shape), np.nan)
            for rows, store in self._records:
                if name in (store.dtype.names or ()):
                    arrays[name][:, rows] = store[name][: self.recorded]
        return {name: arrays[name] for name in self.variables}
