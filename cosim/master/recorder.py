"""The records of a run: one preallocated array a signal, filled row by row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.results.channel import Channel


class Recorder:
    """Arrays of all channels over the samples of a run; samples that are not recorded are NaN.

    Parameters
    ----------
    samples
        How many samples the whole run has.
    channels
        The signals.

    Attributes
    ----------
    recorded : int
        How many samples are recorded.
    """

    def __init__(self, samples: int, channels: Sequence[Channel]) -> None:
        self.channels = {channel.name: channel for channel in channels}
        self.recorded = 0
        self._samples = samples
        self._arrays: dict[str, NDArray[np.float64]] = {}
        self._records: list[tuple[NDArray[np.int_], NDArray[np.void]]] = []

    def of(self, name: str) -> NDArray[np.float64]:
        """Return the place of a channel (samples, ...), to write into."""
        return self._arrays.setdefault(name, np.full((self._samples, *self.channels[name].shape), np.nan))

    def keep(self, name: str, place: NDArray[np.float64]) -> None:
        """Take an array (samples, ...) into which a channel is written."""
        self._arrays[name] = place

    def records(self, rows: NDArray[np.int_], dtype: np.dtype[np.void]) -> NDArray[np.float64]:
        """Return a place for records of numbers, one field a channel and one record a row, to write into.

        It has one row a sample, with the numbers of all records one after the other, as NumPy copies records field by
        field and numbers at once.
        """
        store = np.zeros((self._samples, len(rows)), dtype)
        self._records.append((rows, store))
        return store.view(np.float64).reshape(self._samples, -1)

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return the recorded part of every channel, by name."""
        arrays = {name: array[: self.recorded] for name, array in self._arrays.items()}
        for name in self.channels.keys() - arrays.keys():
            arrays[name] = np.full((self.recorded, *self.channels[name].shape), np.nan)
            for rows, store in self._records:
                if name in (store.dtype.names or ()):
                    arrays[name][:, rows] = store[name][: self.recorded]
        return {name: arrays[name] for name in self.channels}
