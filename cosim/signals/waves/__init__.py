"""Signals that are added to the inputs of a plant, over time: each kind of wave is a module of this folder."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.kinds_by_element import kinds_in
from cosim.scenario.scenario import InputSource, WaveSource
from cosim.signals.random import random_stream
from cosim.signals.waves.wave import Sampling, Wave
from plants import units

__all__ = ["WAVES", "Wave", "input_samples", "understood"]

WAVES: Mapping[str, type[Wave]] = kinds_in(__name__, __path__, Wave)
"""The kinds of waves, by the element's name."""


def understood(written: WaveSource) -> Wave:
    """Return a wave with its attributes read.

    Raises
    ------
    InputError
        A value makes no sense, with the place in the scenario.
    """
    return WAVES[written.kind](written)


def input_samples(
    source: InputSource, unit: units.Unit, times: NDArray[np.float64], step: float, seed: int, robot: str
) -> NDArray[np.float64]:
    """Return the sum of an input's waves at the communication points.

    A wave with a window is zero before its start and from its end on: the start is included, the end excluded.

    Parameters
    ----------
    source
        The input and its waves.
    unit
        The unit of the result: the unit of the plant's input.
    times
        The communication points (T,) [s], from 0 on in steps of `step`.
    step
        Communication step [s].
    seed, robot
        With the input's name and the wave's position in it they name the stream of random numbers: a random wave is
        the same whatever other robots and inputs there are, and however long the run is.

    Returns
    -------
    ndarray
        Shape (T,), in `unit`.

    Raises
    ------
    InputError
        A value's unit does not fit, a table cannot be used, a cutoff is out of range, or the sum is too large a number.
    """
    total = np.zeros(len(times))
    with np.errstate(over="ignore", invalid="ignore"):
        for index, written in enumerate(source.waves):
            stream = partial(random_stream, seed, robot, f"input.{source.name}.{index}")
            total += understood(written).samples(Sampling(times, step, unit, stream))
    if not np.isfinite(total).all():
        raise InputError(
            f"the signals of the input {source.name!r} add up to more than can be computed with", source.where
        )
    return total
