"""The panels of a figure that show courses over time, with the bands of expectations.

All panels are drawn in one Axes that covers the figure, in inches: an Axes for each would take most of the time, for
its ticks and labels are objects of many parts. Locators and formatters of Matplotlib find the numbers at the axes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.font_manager import FontProperties
from matplotlib.ticker import MaxNLocator, ScalarFormatter
from numpy.typing import NDArray

from cosim.errors import printable
from cosim.results.colours import BAD, GOOD
from cosim.results.expectations.shown import Band
from cosim.results.figure_style import LEADER, Colour
from cosim.results.panels import Panel
from cosim.results.thinned import COLUMNS, thinned

Floats: TypeAlias = NDArray[np.float64]

MOST_LINES = 60
"""Followers whose courses are lines; of more, a panel shows how they are spread."""
SPREAD = ((0.0, 1.0), (0.1, 0.9))
"""The parts of many followers that are shaded, besides their median."""
MANY = "#4477AA"
"""The colour of many followers together."""
_MARGIN, _ROOM = 0.06, 1.5
"""Parts of the height of the courses: free space, and the most by which a panel is extended to show a limit."""
_WIDTH = 0.9
_SHADE = 0.13
"""Opacity of a band."""
_TITLE_SIZE, _NUMBER_SIZE = 9, 8
_LETTERS = 12
"""Of a title, in an inch."""
_MOST_DIGITS = 7
"""Of a number beside a panel, for which there is room."""


@dataclass(frozen=True)
class Place:
    """Where a panel is drawn: its upper left corner and its size [in], and whether the times stand below it."""

    left: float
    top: float
    width: float
    height: float
    numbered: bool


@dataclass(frozen=True)
class _Pane:
    """A panel in its place, with the times and numbers at its ends."""

    panel: Panel
    bands: tuple[Band, ...]
    place: Place
    times: tuple[float, float]
    numbers: tuple[float, float]

    def x(self, time: Floats | float) -> Floats:
        start, stop = self.times
        return np.asarray(self.place.left + (np.asarray(time) - start) * (self.place.width / (stop - start)))

    def y(self, number: Floats | float) -> Floats:
        low, high = self.numbers
        bottom = self.place.top + self.place.height
        return np.asarray(bottom - (np.asarray(number) - low) * (self.place.height / (high - low)))

    def line(self, time: Floats, numbers: Floats) -> Floats:
        """Return a course as points (T, 2) of the figure."""
        return np.column_stack([self.x(time), self.y(numbers)])


def draw_panels(
    axes: Axes,
    shown: Sequence[tuple[Panel, Place]],
    times: tuple[float, float],
    colours: Sequence[Colour],
    bands: Sequence[Band],
    failed: float | None = None,
) -> None:
    """Draw panels in their places, over the same times [s], with the bands of their signals and when the run failed."""
    panes = []
    for panel, place in shown:
        own = tuple(one for one in bands if one.signal == panel.signal and one.component in ("", panel.component))
        panes.append(_Pane(panel, own, place, times, view(panel, own)))
    _draw_frames(axes, panes)
    _draw_bands(axes, panes)
    _draw_leaders(axes, panes)
    if failed is not None:
        ends = [
            [(float(pane.x(failed)), pane.place.top + part * pane.place.height) for part in (0, 1)] for pane in panes
        ]
        axes.add_collection(LineCollection(ends, colors=BAD, linestyles=":", linewidths=1.2), autolim=False)
    _draw_lines(axes, [pane for pane in panes if len(colours) <= MOST_LINES], colours)
    _draw_spreads(axes, [pane for pane in panes if len(colours) > MOST_LINES])


def view(panel: Panel, bands: Sequence[Band]) -> tuple[float, float]:
    """Return the range of numbers that a panel shows: its courses, and limits that are not far from these."""
    numbers = [one[np.isfinite(one)] for one in (panel.courses, panel.leader) if one is not None]
    low = min((float(part.min()) for part in numbers if len(part)), default=0.0)
    high = max((float(part.max()) for part in numbers if len(part)), default=1.0)
    room = _ROOM * (high - low)
    for limit in [panel.factor * limit for band in bands for limit in (band.lower, band.upper)]:
        if math.isfinite(limit) and low - room <= limit <= high + room:
            low, high = min(low, limit), max(high, limit)
    margin = max(_MARGIN * (high - low), 1e-9 * max(abs(low), abs(high))) or 1.0
    return low - margin, high + margin


# Frames and numbers -----------------------------------------------------------------------------------------


def _draw_frames(axes: Axes, panes: Sequence[_Pane]) -> None:
    """Draw titles, axes, grid and numbers."""
    title, small = FontProperties(size=_TITLE_SIZE), FontProperties(size=_NUMBER_SIZE)
    frames, grid = [], []
    at_times = _ticks(*panes[0].times, 6) if panes else []
    names_of_times, offset_of_times = _numbers(at_times)
    time = f"time [s] {offset_of_times}".rstrip()
    for pane in panes:
        place = pane.place
        right, bottom = place.left + place.width, place.top + place.height
        unit = f" [{pane.panel.unit}]" if pane.panel.unit else ""
        frames.append([(place.left, place.top), (place.left, bottom), (right, bottom)])
        grid += [[(x, place.top), (x, bottom)] for x in pane.x(np.array(at_times)).tolist()]
        for x, name in zip(pane.x(np.array(at_times)).tolist(), names_of_times if place.numbered else (), strict=False):
            axes.text(x, bottom + 0.05, name, ha="center", va="top", fontproperties=small)
        if place.numbered:
            middle = place.left + place.width / 2
            axes.text(middle, bottom + 0.2, time, ha="center", va="top", fontproperties=small)
        if not pane.panel.courses.size:
            note, x, y = "not recorded by this controller", place.left + place.width / 2, place.top + place.height / 2
            axes.text(x, y, note, ha="center", va="center", fontproperties=title)
        else:
            at = _ticks(*pane.numbers, 5)
            names, offset = _numbers(at)
            heights = pane.y(np.array(at)).tolist()
            grid += [[(place.left, y), (right, y)] for y in heights]
            for y, name in zip(heights, names, strict=True):
                axes.text(place.left - 0.05, y, name, ha="right", va="center", fontproperties=small)
            if offset:
                axes.text(right, place.top - 0.04, offset, ha="right", va="bottom", fontproperties=small)
        name, room = printable(pane.panel.title), int(place.width * _LETTERS) - len(unit)
        text = f"{name if len(name) <= room else f'{name[: room - 3]}...'}{unit}"
        axes.text(place.left, place.top - 0.04, text, ha="left", va="bottom", fontproperties=title, parse_math=False)
    axes.add_collection(LineCollection(grid, colors="0.88", linewidths=0.7, zorder=0.1), autolim=False)
    axes.add_collection(LineCollection(frames, colors="0.2", linewidths=0.8, zorder=0.9), autolim=False)


def _ticks(low: float, high: float, most: int) -> list[float]:
    """Return at most as many round numbers, and one more, from one to another."""
    found = MaxNLocator(most, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
    return [float(tick) for tick in found if low <= tick <= high]


def _numbers(ticks: Sequence[float]) -> tuple[list[str], str]:
    """Return the numbers as they are written at ticks, and what all of them are to be multiplied by or added to."""
    if not ticks:
        return [], ""
    for offset in (False, True):
        formatter = ScalarFormatter(useOffset=offset)
        formatter.set_powerlimits((-3, 5))
        formatter.create_dummy_axis()
        formatter.axis.set_view_interval(ticks[0], ticks[-1])  # type: ignore[union-attr]
        names = formatter.format_ticks(list(ticks))
        if all(len(name) <= _MOST_DIGITS for name in names):
            break
    return names, formatter.get_offset()


# Courses and bands ------------------------------------------------------------------------------------------


def _draw_bands(axes: Axes, panes: Sequence[_Pane]) -> None:
    """Shade where values belong over a window, or where they must not be, and draw the limits."""
    shades, limits, colours_of_shades, colours_of_limits = [], [], [], []
    for pane in panes:
        low, high = pane.numbers
        narrowest = 0.004 * (pane.times[1] - pane.times[0])
        for band in pane.bands:
            lower, upper = pane.panel.factor * band.lower, pane.panel.factor * band.upper
            if not (math.isfinite(lower) or math.isfinite(upper)):
                continue
            colour = GOOD if band.inside else BAD
            ends = np.clip([band.start, max(band.stop, band.start + narrowest)], *pane.times)
            left, right = pane.x(ends).tolist()
            if left >= right:  # the run ended before
                continue
            bottom, top = pane.y(np.array([max(lower, low), min(upper, high)])).tolist()
            if bottom > top:
                shades.append([(left, bottom), (right, bottom), (right, top), (left, top)])
                colours_of_shades.append(to_rgba(colour, _SHADE))
            for limit in (lower, upper):
                if low <= limit <= high:
                    y = float(pane.y(limit))
                    limits.append([(left, y), (right, y)])
                    colours_of_limits.append(colour)
    axes.add_collection(PolyCollection(shades, facecolors=colours_of_shades, linewidths=0, zorder=0.5), autolim=False)
    axes.add_collection(LineCollection(limits, colors=colours_of_limits, linewidths=1.0, zorder=1.5), autolim=False)


def _draw_leaders(axes: Axes, panes: Sequence[_Pane]) -> None:
    lines = []
    for pane in panes:
        if pane.panel.leader is not None:
            shown = thinned(pane.panel.leader)
            lines.append(pane.line(pane.panel.time[shown], pane.panel.leader[shown]))
    dashed = LineCollection(lines, colors=LEADER, linestyles="--", linewidths=_WIDTH, zorder=2.1)
    axes.add_collection(dashed, autolim=False)


def _draw_lines(axes: Axes, panes: Sequence[_Pane], colours: Sequence[Colour]) -> None:
    lines, drawn = [], []
    for pane in panes:
        for course, colour in zip(pane.panel.courses.T, colours, strict=False):
            shown = thinned(course)
            lines.append(pane.line(pane.panel.time[shown], course[shown]))
            drawn.append(colour)
    if panes and lines and len(lines[0]) == 1:  # a single sample is no line
        points = np.concatenate(lines)
        axes.scatter(points[:, 0], points[:, 1], s=9, c=drawn)
    axes.add_collection(LineCollection(lines, colors=drawn, linewidths=_WIDTH, zorder=2), autolim=False)


def _draw_spreads(axes: Axes, panes: Sequence[_Pane]) -> None:
    """Draw the median of many followers, where most of them are, and where all are."""
    for pane in panes:
        if not pane.panel.courses.size:
            continue
        shown = np.unique(np.linspace(0, len(pane.panel.time) - 1, COLUMNS // 2).round().astype(int))
        x, spread = pane.x(pane.panel.time[shown]), _Spread.of(pane.panel.courses[shown])
        for low, high in SPREAD:
            lower, upper = pane.y(spread.quantile(low)), pane.y(spread.quantile(high))
            axes.fill_between(x, lower, upper, color=MANY, alpha=0.3, linewidth=0)
        axes.plot(x, pane.y(spread.quantile(0.5)), color=MANY, linewidth=1.2)


@dataclass(frozen=True)
class _Spread:
    """The numbers of many followers at each sample, in order (T, N) with NaN last, and how many are numbers (T,)."""

    ordered: Floats
    numbers: NDArray[np.int_]

    @classmethod
    def of(cls, courses: Floats) -> Self:
        return cls(np.sort(courses, axis=1), np.isfinite(courses).sum(axis=1))

    def quantile(self, part: float) -> Floats:
        """Return the number (T,) below which a part of the others lies."""
        place = (part * np.maximum(self.numbers - 1, 0)).round().astype(int)[:, np.newaxis]
        return np.where(self.numbers > 0, np.take_along_axis(self.ordered, place, axis=1)[:, 0], np.nan)
