"""The communication points of a run: time is a whole number of ticks, and rounding is judged here alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

ROUNDING = 1e-9
"""Largest difference between a computed time [s] and the decimal number that is meant, and between a computed number of
steps and the whole number that is meant, as part of it."""
NEVER = 2**62
"""The tick of an infinite time."""


def in_seconds(time: float) -> str:
    """Return a time [s] as sentences show it: with two decimals, or more where it has more."""
    text = f"{time:.2f}"
    return f"{text if abs(float(text) - time) <= ROUNDING else f'{time:.9f}'.rstrip('0')} s"


@dataclass(frozen=True)
class Clock:
    """Communication points from 0 to the horizon, one a tick.

    Attributes
    ----------
    step : float
        Time from one tick to the next [s].
    ticks : int
        The tick of the horizon.
    """

    step: float
    ticks: int

    @property
    def horizon(self) -> float:
        """The last communication point [s]."""
        return self.ticks * self.step

    @property
    def times(self) -> NDArray[np.float64]:
        """All communication points (ticks + 1,) [s]: each is its tick times the step, never a running sum."""
        return self.times_in(slice(0, self.ticks + 1))

    def times_in(self, block: slice) -> NDArray[np.float64]:
        """Return some of the communication points [s], from one tick to before another."""
        times: NDArray[np.float64] = self.step * np.arange(block.start, block.stop, block.step or 1, dtype=np.float64)
        return times

    def off_tick(self, time: float) -> str:
        """Return why no tick is at a time [s], the subject; empty if there is one, maybe after the horizon."""
        if not math.isfinite(time / self.step):
            return f"is too long for steps of {self.step:.12g} s"
        if whole(time / self.step) is not None:
            return ""
        before = math.floor(time / self.step)
        return (
            f"falls between two ticks, which are {self.step:.12g} s apart: write {before * self.step:.12g} s "
            f"or {(before + 1) * self.step:.12g} s"
        )

    def meant(self, time: float) -> float:
        """Return the time of the tick that a time [s] is meant to be, as 0.6666666667 min is; any other time stays."""
        tick = whole(time / self.step)
        return time if tick is None or abs(time - tick * self.step) <= ROUNDING else tick * self.step

    def samples_within(self, start: float, stop: float) -> int:
        """Return how many communication points lie in a window [s], both of its ends included."""
        first = math.ceil((start - ROUNDING) / self.step)
        last = min(math.floor((stop + ROUNDING) / self.step), self.ticks)
        return last - first + 1


def tick_at(time: float, step: float) -> int:
    """Return the first tick at or after a time [s]; `NEVER` for an infinite time."""
    if not math.isfinite(time):
        return NEVER
    meant = whole(time / step)
    return math.ceil(time / step) if meant is None else meant


def whole(number: float) -> int | None:
    """Return the whole number that a computed one is meant to be; None if it is meant to be none."""
    if not math.isfinite(number):
        return None
    nearest = round(number)
    return nearest if abs(number - nearest) <= ROUNDING * max(abs(nearest), 1) else None


def acting(times: NDArray[np.float64], start: float, stop: float) -> NDArray[np.bool_]:
    """Return the mask of communication points [s] in a window: its start is included, its end excluded."""
    return (times >= start - ROUNDING) & (times < stop - ROUNDING)
