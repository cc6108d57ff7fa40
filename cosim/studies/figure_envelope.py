"""The picture of the courses of all runs: paths seen from above, and signals over time, with their bands."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from cosim.errors import printable
from cosim.scenario.scenario import LEADER
from cosim.studies.bundles import Bundle
from cosim.studies.conduct import StudyOutcome
from cosim.studies.figure_style import COLOURS, font, png

WITHIN = 0.9
"""The share of the runs that is in the inner band."""
_OUTER, _INNER = 0.15, 0.35
"""Opacities."""
_LEADERS = "black"
_AROUND = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
_DIRECTIONS = np.stack([np.cos(_AROUND), np.sin(_AROUND)])
"""Directions (2, 64) in which an outline has its farthest point."""
_MOST_BUNDLES, _MOST_ROBOTS, _ACROSS = 6, 4, 2
_WIDTH, _PATHS, _OVER_TIME, _TITLE = 9.0, 4.6, 2.3, 0.7
"""Width of the figure; heights of a picture of paths, of a row of panels over time, and of the title [in]."""


def picture(outcome: StudyOutcome) -> bytes:
    """Return the picture as PNG; see `draw`."""
    return png(draw(outcome))


def draw(outcome: StudyOutcome) -> Figure:
    """Return the figure: one below the other what each envelope shows of each case."""
    bundles = outcome.bundles[:_MOST_BUNDLES]
    heights = [_height(bundle) for bundle in bundles]
    with font():
        figure = Figure(figsize=(_WIDTH, sum(heights) + _TITLE), layout="constrained")
        told = textwrap.wrap(printable(f"{outcome.study.name}: {outcome.study.title}"), 110)
        if len(outcome.bundles) > len(bundles):
            told.append(f"the first {len(bundles)} of {len(outcome.bundles)} pictures")
        figure.suptitle("\n".join(told), parse_math=False)
        parts = figure.subfigures(max(len(bundles), 1), 1, squeeze=False, height_ratios=heights or None)
        for part, bundle in zip(parts[:, 0], bundles, strict=False):
            part.suptitle(printable(_heading(bundle)), fontsize="medium", parse_math=False)
            (_draw_paths if bundle.envelope.of_paths else _draw_over_time)(part, bundle)
    return figure


def _height(bundle: Bundle) -> float:
    rows = -(-min(len(bundle.robots), _MOST_ROBOTS) // _ACROSS)
    return _PATHS if bundle.envelope.of_paths else _OVER_TIME * rows + 0.5


def _heading(bundle: Bundle) -> str:
    drawn = len(bundle.values)
    runs = f"{drawn} {bundle.of}" if drawn == bundle.ended else f"{drawn} of {bundle.ended} {bundle.of}"
    parts = [bundle.title] if bundle.title else []
    parts.append(f"light: all of {runs}; dark: {100 * WITHIN:g} % of them at each instant; line: median")
    if bundle.broken:
        parts.append(f"{bundle.broken} broken {bundle.of} are left out")
    if len(bundle.robots) > _MOST_ROBOTS and not bundle.envelope.of_paths:
        parts.append(f"{_MOST_ROBOTS} of {len(bundle.robots)} robots: those that differ most from run to run")
    return "; ".join(parts)


def _drawn(bundle: Bundle) -> NDArray[np.float64]:
    """Return the values (runs, R, T, entries), with straight lines between the instants that a run has."""
    values, time = bundle.values.astype(np.float64), bundle.envelope.times
    gaps = np.isnan(values)
    for run, robot, entry in np.argwhere(gaps.any(axis=2) & ~gaps.all(axis=2)):
        course, lacks = values[run, robot, :, entry], gaps[run, robot, :, entry]
        course[lacks] = np.interp(time[lacks], time[~lacks], course[~lacks], left=np.nan, right=np.nan)
    return values


# Paths --------------------------------------------------------------------------------------------------------


def _draw_paths(part: SubFigure, bundle: Bundle) -> None:
    panel = part.subplots()
    colours, drawn = _colours(bundle.robots), _drawn(bundle)
    for row, robot in enumerate(bundle.robots):
        places = drawn[:, row]  # (runs, T, 2)
        colour = colours[robot]
        for share, opacity in ((1.0, _OUTER), (WITHIN, _INNER)):
            panel.add_patch(PathPatch(swept(places, share), facecolor=colour, alpha=opacity, linewidth=0))
        middle = _median(places)
        panel.plot(*middle.T, color=colour, linewidth=1.2, label=printable(robot))
        panel.plot(*middle[:1].T, "o", color=colour, markersize=4)
        if bundle.worst is not None and robot != LEADER:
            told = f"run {bundle.number}, the worst" if row == len(bundle.robots) - 1 else None
            panel.plot(*places[bundle.worst].T, color="#333333", linestyle=(0, (1, 1.2)), linewidth=1.0, label=told)
    panel.autoscale_view()
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_xlabel("x [m]")
    panel.set_ylabel("y [m]")
    panel.grid(alpha=0.3)
    panel.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))


def swept(places: NDArray[np.float64], share: float) -> Path:
    """Return the outline that a share of the runs is in at each instant, from one instant to the next.

    At each instant these are the runs nearest to the median. Around them and those of the next instant there is a
    polygon without a dent; all polygons are counter-clockwise, so that filled as one path they are one area.

    Parameters
    ----------
    places
        Positions (runs, T, 2); NaN where a run has ended.
    """
    clouds = [_nearest(cloud, share) for cloud in places.swapaxes(0, 1)]
    outlines = [_outline(cloud) for cloud in clouds if len(cloud)]
    polygons = [_outline(np.concatenate(pair)) for pair in pairwise(outlines)]
    whole = [Path(np.concatenate([one, one[:1]]), closed=True) for one in polygons]
    return Path.make_compound_path(*whole) if whole else Path(np.empty((0, 2)))


def _outline(cloud: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners of the least polygon without a dent around some points, counter-clockwise."""
    rough = cloud[np.argmax(cloud @ _DIRECTIONS, axis=0)]  # most of the corners, so that few points are left to look at
    along = np.roll(rough, -1, axis=0) - rough
    outside = along[:, 0] * (cloud[:, 1:] - rough[:, 1]) < along[:, 1] * (cloud[:, :1] - rough[:, 0])
    corners = sorted(set(map(tuple, np.concatenate([rough, cloud[outside.any(axis=1)]]).tolist())))
    return np.array([*_half(corners)[:-1], *_half(corners[::-1])[:-1]] or corners)


def _half(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the corners of the polygon around sorted points, from the first to the last one."""
    kept: list[tuple[float, float]] = []
    for x, y in points:
        while len(kept) > 1 and (kept[-1][0] - kept[-2][0]) * (y - kept[-2][1]) <= (kept[-1][1] - kept[-2][1]) * (
            x - kept[-2][0]
        ):
            kept.pop()
        kept.append((x, y))
    return kept


def _nearest(cloud: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Return the share of positions (runs, 2) that is nearest to their median."""
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    if not len(cloud):
        return cloud
    distances = np.hypot(*(cloud - np.median(cloud, axis=0)).T)
    return cloud[np.argsort(distances, kind="stable")[: int(np.ceil(share * len(cloud)))]]


def _median(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the median (T, ...) of the runs that are still there."""
    middle = np.full(places.shape[1:], np.nan)
    there = ~np.isnan(places).all(axis=0)
    middle[there] = np.nanmedian(places[:, there], axis=0)
    return middle


# Over time ----------------------------------------------------------------------------------------------------


def _draw_over_time(part: SubFigure, bundle: Bundle) -> None:
    values = _drawn(bundle)[..., 0]  # (runs, R, T)
    there = np.isfinite(values).any(axis=(0, 1))
    time, values = bundle.envelope.times[there], values[..., there]
    low, high = _quantiles(values)
    shown = _most_different(low, high)
    rows = -(-len(shown) // _ACROSS)
    panels = part.subplots(rows, min(len(shown), _ACROSS), sharex=True, sharey=True, squeeze=False)
    for panel in panels.flat[len(shown) :]:
        panel.axis("off")
    for panel, row in zip(panels.flat, shown, strict=False):
        _draw_band(panel, bundle, time, values[:, row], low[row], high[row])
        panel.set_title(printable(bundle.robots[row]), fontsize="small", loc="left", parse_math=False)
    for panel in panels[:, 0]:
        panel.set_ylabel(printable(bundle.envelope.text), parse_math=False)
    for panel in panels[-1]:
        panel.set_xlabel("time [s]")
    if bundle.worst is not None:
        panels[0, -1].legend(fontsize="small", loc="best")


def _draw_band(
    panel: Axes,
    bundle: Bundle,
    time: NDArray[np.float64],
    values: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> None:
    colour = COLOURS[0]
    panel.fill_between(time, np.nanmin(values, axis=0), np.nanmax(values, axis=0), color=colour, alpha=_OUTER, lw=0)
    panel.fill_between(time, low, high, color=colour, alpha=_INNER, linewidth=0)
    panel.plot(time, _median(values), color=colour, linewidth=1.2)
    if bundle.worst is not None:
        told = f"run {bundle.number}, the worst"
        panel.plot(time, values[bundle.worst], color="#333333", linestyle=(0, (1, 1.2)), linewidth=1.0, label=told)
    panel.grid(alpha=0.3)


def _quantiles(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the ends of the inner band, each (R, T), of values (runs, R, T)."""
    outside = (1.0 - WITHIN) / 2.0
    return np.nanquantile(values, [outside, 1.0 - outside], axis=0, method="inverted_cdf")


def _most_different(low: NDArray[np.float64], high: NDArray[np.float64]) -> Sequence[int]:
    """Return the rows of the robots with the widest bands, in their order."""
    widths = np.nanmax(high - low, axis=1)
    return sorted(np.argsort(-widths, kind="stable")[:_MOST_ROBOTS].tolist())


def _colours(robots: Sequence[str]) -> dict[str, str]:
    followers = [robot for robot in robots if robot != LEADER]
    return {LEADER: _LEADERS} | {robot: COLOURS[at % len(COLOURS)] for at, robot in enumerate(followers)}
