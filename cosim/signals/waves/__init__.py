"""Signals that are added to the inputs of a plant, over time: each kind of wave is a module of this folder."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cosim.clock import Clock
from cosim.errors import InputError
from cosim.kinds_by_element import kinds_in
from cosim.scenario.scenario import InputSource, WaveSource
from cosim.signals.random import random_stream
from cosim.signals.waves.wave import Sampling, Wave
from cosim.storage import blocks
from plants import units

__all__ = ["WAVES", "Wave", "add_samples", "understood"]

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


def add_samples(
    total: NDArray[np.float64], source: InputSource, unit: units.Unit, clock: Clock, seed: int, robot: str
) -> None:
    """Add an input's waves at the communication points to a course.

    A wave with a window is zero before its start and from its end on: the start is included, the end excluded.

    Parameters
    ----------
    total
        The course (ticks + 1,), in `unit`.
    source
        The input and its waves.
    unit
        The unit of the plant's input.
    clock
        The communication points.
    seed, robot
        With the input's name and the wave's place in it, or the number that the wave states, they name the stream of
        random numbers: a random wave is the same whatever other robots and inputs there are, and however long the run
        is.

    Raises
    ------
    InputError
        A value's unit does not fit, a table cannot be used, a cutoff is out of range, or the sum is too large a number.
    """
    places = (int(written.get("stream", str(place))) for place, written in enumerate(source.waves))
    waves = [
        (understood(written), random_stream(seed, robot, f"input.{source.name}.{place}"))
        for written, place in zip(source.waves, places, strict=True)
    ]
    finite = True
    for block in blocks(len(total)):
        own = np.zeros(block.stop - block.start)
        with np.errstate(over="ignore", invalid="ignore"):
            for wave, stream in waves:
                own += wave.samples(Sampling(clock.times_in(block), clock.step, unit, stream))
            finite = finite and bool(np.isfinite(own).all())
            total[block] += own
    if not finite:
        raise InputError(
            f"the signals of the input {source.name!r} add up to more than can be computed with", source.where
        )
