"""Numbers of a recording over its own time, and their values at the ticks of a scenario."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.clock import ROUNDING
from cosim.errors import Picklable
from cosim.moments import SECOND, nanoseconds_of
from cosim.recordings.mapping import Place

Floats: TypeAlias = NDArray[np.float64]
NO_UNIT = "-"
_LONGER = 1.5
"""How many times as long as the usual one an interval is that counts as a gap."""
_MOSTLY = 0.9
"""Part of the numbers of a column between which so many cells are empty, where a table has rows of several topics."""


@dataclass(frozen=True, eq=False)
class Series:
    """A number over time.

    Attributes
    ----------
    time : ndarray (T,)
        Times: of a bag whole nanoseconds, of a table seconds.
    values : ndarray (T,)
        Its values.
    unit : str
        The unit in which it is recorded; `NO_UNIT` of a column without one; empty of messages, which state none.
    """

    time: NDArray[np.int64] | Floats = field(repr=False)
    values: Floats = field(repr=False)
    unit: str = ""

    @property
    def first(self) -> int | None:
        """The first time with a value [ns]; None if there is none."""
        return self._nanoseconds(np.min)

    @property
    def last(self) -> int | None:
        """The last time with a value [ns]; None if there is none."""
        return self._nanoseconds(np.max)

    def _nanoseconds(self, extreme: Callable[[NDArray[Any]], Any]) -> int | None:
        given = self.time[np.isfinite(self.values)]
        if not len(given):
            return None
        return int(extreme(given)) if given.dtype.kind == "i" else nanoseconds_of(float(extreme(given)))

    def since(self, start: int) -> Floats:
        """Return the times as seconds since one [ns]."""
        if self.time.dtype.kind == "i":
            return np.asarray((self.time - start) / SECOND)
        return np.asarray(self.time - start / SECOND)


@dataclass(frozen=True, eq=False)
class Sampled:
    """A number at the ticks of a scenario.

    Attributes
    ----------
    values : ndarray (ticks + 1,)
        Its values; NaN where it is missing.
    samples : int
        How many samples of it the recording has between the first tick and the last.
    not_numbers : int
        How many of its samples are no numbers, which are left out.
    disordered : int
        How many samples came before an earlier one, or twice.
    longest_gap : float
        The longest time between samples [s] within the scenario's.
    bridged : int
        At how many ticks it is interpolated across an interval that is longer than usual, or held at either end.
    """

    values: Floats = field(repr=False)
    samples: int = 0
    not_numbers: int = 0
    disordered: int = 0
    longest_gap: float = 0.0
    bridged: int = 0


@dataclass(frozen=True, eq=False)
class Numbers:
    """What was found in a recording.

    Attributes
    ----------
    series : dict
        The numbers that are there, by their places.
    names : list of str
        Everything that the recording has: topics, or columns.
    notes : tuple of str
        What of it is left out, each a sentence.
    """

    series: Mapping[Place, Series]
    names: Sequence[str]
    notes: Sequence[str] = ()


class ClockGoesBack(Picklable, ValueError):
    """The time of a recording goes back by more than a gap: it holds several drives, or a clock was set."""

    def __init__(self, time: float, by: float) -> None:
        self.time, self.by = time, by
        super().__init__()


def sampled(time: Floats, values: Floats, ticks: Floats, longest_gap: float, *, angle: bool = False) -> Sampled:
    """Return a number at the ticks of a scenario, by straight lines between its samples.

    A sample that falls on a tick, to a nanosecond, is taken as it is. Before the first sample and after the last, their
    values are held for one usual interval at most, as no recording begins and ends on a tick; not if more samples there
    are no numbers than mostly lie between two that are, as in a table whose last line is cut off.

    Parameters
    ----------
    time, values
        The samples (T,), times in seconds of the scenario.
    ticks
        Times of the ticks [s].
    longest_gap
        The longest time [s] between two samples across which there is a line.
    angle
        Whether it is an angle [rad] that jumps by whole turns: from one sample to the next it turns the shortest way.

    Raises
    ------
    ClockGoesBack
        The time goes back by more than the longest gap.
    """
    numbers = np.isfinite(values)
    not_numbers = int(len(values) - numbers.sum())
    places = np.flatnonzero(numbers)
    time, values = time[numbers], values[numbers]
    back = np.maximum.accumulate(time) - time if len(time) else time
    if len(time) and back.max() > longest_gap:
        at = int(np.argmax(back > longest_gap))
        raise ClockGoesBack(float(time[at]), float(back[at]))
    if disordered := int((np.diff(time) <= 0.0).sum()):
        order = np.argsort(time, kind="stable")
        time, values = time[order], values[order]
        last = np.append(np.diff(time) > 0.0, True)  # of those at the same time
        time, values = time[last], values[last]
    found = np.full(len(ticks), np.nan)
    within = (time >= ticks[0] - ROUNDING) & (time <= ticks[-1] + ROUNDING)
    if not within.any() and len(time) < 2:
        return Sampled(found, 0, not_numbers, disordered)
    if angle:
        values = np.unwrap(values)
    after = np.searchsorted(time, ticks - ROUNDING)
    known = after < len(time)
    exact = known & (time[np.minimum(after, len(time) - 1)] <= ticks + ROUNDING)
    found[exact] = values[after[exact]]
    between = known & ~exact & (after > 0)
    right = after[between]
    left = right - 1
    width = time[right] - time[left]
    bridged = width <= longest_gap + ROUNDING
    part = (ticks[between] - time[left]) / width
    found[between] = np.where(bridged, values[left] + part * (values[right] - values[left]), np.nan)
    intervals = np.diff(time[within])
    usual = float(np.median(intervals)) if len(intervals) else 0.0
    held = np.zeros(len(ticks), bool)
    mostly = np.quantile(np.diff(places) - 1, _MOSTLY) if len(places) > 1 else 0
    ends = (0, time[0] - ticks, places[0]), (-1, ticks - time[-1], len(numbers) - 1 - places[-1])
    for end, late, lacking in ends:
        if lacking > mostly:
            continue
        near = (late > ROUNDING) & (late <= min(usual, longest_gap) + ROUNDING)
        found[near] = values[end]
        held |= near
    return Sampled(
        values=found,
        samples=int(within.sum()),
        not_numbers=not_numbers,
        disordered=disordered,
        longest_gap=float(intervals.max()) if len(intervals) else 0.0,
        bridged=int((bridged & (width > _LONGER * usual)).sum() + held.sum()),
    )
