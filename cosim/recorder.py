"""What is kept of a run: one preallocated array a signal, filled row by row."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Channel:
    """A recorded signal.

    Attributes
    ----------
    name : str
        Its name.
    dims, shape : tuple
        Dimensions and shape after ``time``.
    units, long_name : str
        How a reader is told what it is.
    singular_at_zero : str
        What is singular where it is zero, if anything is.
    singular_below : float
        Magnitude below which it is near that; zero if only changes of sign tell.
    """

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    units: str
    long_name: str
    singular_at_zero: str = ""
    singular_below: float = 0.0

    @property
    def attributes(self) -> dict[str, str | float]:
        """The attributes of the variable in a result."""
        told: dict[str, str | float] = {"units": self.units, "long_name": self.long_name}
        if self.singular_at_zero:
            told |= {"singular_at_zero": self.singular_at_zero, "singular_below": self.singular_below}
        return told

    @property
    def bytes_per_sample(self) -> int:
        """Memory of one sample."""
        return 8 * math.prod(self.shape)


class Recorder:
    """Arrays of all channels over the samples of a run; what is not recorded is NaN.

    Parameters
    ----------
    samples
        How many samples the whole run has.
    channels
        The signals.
    """

    def __init__(self, samples: int, channels: Sequence[Channel]) -> None:
        self.channels = {channel.name: channel for channel in channels}
        self._arrays = {channel.name: np.full((samples, *channel.shape), np.nan) for channel in channels}
        self.recorded = 0

    def row(self, name: str, sample: int) -> NDArray[np.float64]:
        """Return the place of one sample of a channel, to write into."""
        place: NDArray[np.float64] = self._arrays[name][sample]
        return place

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return the recorded part of every channel, by name."""
        return {name: array[: self.recorded] for name, array in self._arrays.items()}
