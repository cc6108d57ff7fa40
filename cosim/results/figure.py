"""The panels of the paper's Figure 6, drawn from a result."""

from __future__ import annotations

import io
import textwrap
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.transforms import ScaledTranslation
from numpy.typing import NDArray

from cosim.errors import InputError, printable
from cosim.results.drawable_part import drawable
from cosim.results.files import write
from cosim.results.panels import panels, representative
from cosim.results.provenance import Provenance
from cosim.results.result import Result
from cosim.results.thinned import thinned

if TYPE_CHECKING:
    import xarray as xr

Colour = NDArray[np.float64]
"""Red, green, blue and opacity."""

_SNAPSHOTS = 5
_LEADER = "black"
_WIDTH, _HEIGHT = 13.0, 16.0
_LEFT, _RIGHT, _BETWEEN = 0.95, 0.2, 0.95
"""Margins beside the panels and the gap between them [in]: a layout that is computed takes as long as the drawing."""
_BOTTOM, _TOP, _LINE = 0.75, 0.62, 0.24
"""Margins below the panels, above them, and for each further line of the title [in]."""
_LEFT_OF, _BELOW = 0.66, 0.31
"""Distances of the labels from their axes [in], with room for the numbers between."""


def save_figure(result: xr.Dataset | Result, path: str | Path) -> None:
    """Draw a result and write it as PNG.

    Raises
    ------
    InputError
        It holds no sample.
    OutputError
        The file cannot be written.
    """
    result = representative(Result.of(result))
    if not result.sizes["time"]:
        raise InputError("the result holds no sample, so there is nothing to draw")
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # a title in letters that the font lacks
        draw(result).savefig(buffer, format="png", dpi=120, pil_kwargs={"compress_level": 1})  # others take longer
    write(Path(path), buffer.getbuffer())


def draw(result: xr.Dataset | Result) -> Figure:
    """Return the figure: panels (a) to (h) as in the paper; a panel without a recorded signal states that.

    Above them stand the changes of the scenario and the reason of an early end, below them seed and versions.
    """
    whole = Result.of(result)
    drawn = drawable(whole)
    figure = Figure(figsize=(_WIDTH, _HEIGHT))
    title = _title(drawn)
    figure.suptitle(title, fontsize=13, y=1 - 0.1 / _HEIGHT, parse_math=False)
    basis = Provenance.of(whole.attrs).basis
    if any(_missing(drawn[name].values) > _missing(whole[name].values) for name in whole.data_vars):
        basis += "; diverged values are not drawn"
    figure.supxlabel(basis, fontsize=8, color="grey", parse_math=False)
    grid = figure.add_gridspec(
        4,
        2,
        height_ratios=(1.5, 1.2, 1.2, 0.8),
        left=_LEFT / _WIDTH,
        right=1 - _RIGHT / _WIDTH,
        bottom=_BOTTOM / _HEIGHT,
        top=1 - (_TOP + _LINE * title.count("\n")) / _HEIGHT,
        wspace=2 * _BETWEEN / (_WIDTH - _LEFT - _RIGHT - _BETWEEN),
        hspace=0.27,
    )
    colours = dict(zip(drawn.robots, _colours(len(drawn.robots)), strict=True))

    paths = _panel(figure, grid[0, 0], "(a) paths")
    _draw_paths(paths, drawn, colours)
    paths.legend(fontsize="small", loc="best")
    enlarged = _panel(figure, grid[0, 1], "(b) formation at five instants, enlarged")
    _draw_formation(enlarged, drawn, colours)

    for at, (heading, signals) in enumerate(panels(drawn), 2):
        _draw_signals(figure, grid[at // 2, at % 2], heading, drawn, colours, signals)
    return figure


def _title(result: Result) -> str:
    provenance = Provenance.of(result.attrs)
    title = f"{result.attrs['title']} ({result.attrs['scenario_name']})"
    if result.attrs["status"] != "completed":
        title += f", recorded up to {result['time'].values[-1]:g} s"
    further = [provenance.changed] if provenance.changes else []
    if provenance.failure:
        further.append(printable(str(provenance.failure)))
    wrapped = (part for line in further for part in textwrap.wrap(line, 120, max_lines=3, placeholder=" ..."))
    return "\n".join([title, *wrapped])


# Panels -----------------------------------------------------------------------------------------------------


def _panel(figure: Figure, place: SubplotSpec, title: str, first: Axes | None = None) -> Axes:
    """Return empty axes whose title and labels stand where they are put, not where the numbers end."""
    axes = figure.add_subplot(place, sharex=first)
    axes.set_title(title, y=1.0)
    left = ScaledTranslation(-_LEFT_OF, 0, figure.dpi_scale_trans)
    below = ScaledTranslation(0, -_BELOW, figure.dpi_scale_trans)
    axes.yaxis.set_label_coords(0.0, 0.5, axes.transAxes + left)
    axes.xaxis.set_label_coords(0.5, 0.0, axes.transAxes + below)
    return axes


def _draw_paths(axes: Axes, result: Result, colours: Mapping[str, Colour]) -> None:
    leader = result["leader_pose"].values
    axes.plot(leader[:, 0], leader[:, 1], color=_LEADER, linestyle="--", linewidth=1.2, label="leader")
    for robot, colour in colours.items():
        pose = result.of_robot("pose", robot)
        axes.plot(pose[:, 0], pose[:, 1], color=colour, linewidth=1.2, label=robot)
        axes.plot(*pose[0, :2], marker="o", markersize=4, color=colour)
    axes.plot(*leader[0, :2], marker="o", markersize=4, color=_LEADER)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.grid(alpha=0.3)


def _draw_formation(axes: Axes, result: Result, colours: Mapping[str, Colour]) -> None:
    """Draw the last part of the paths, and the robots and their lines of sight at a few instants."""
    places = [np.isfinite(result[name].values[..., :3]).all(axis=-1) for name in ("pose", "leader_pose")]
    drawn = places[0].all(axis=1) & places[1]
    samples = int(np.flatnonzero(drawn)[-1]) + 1 if drawn.any() else 0
    if not samples:
        return
    shown = np.unique(np.linspace(0.6 * (samples - 1), samples - 1, _SNAPSHOTS).round().astype(int))
    _draw_paths(axes, result, colours)
    leader, poses = result["leader_pose"].values[shown, :2], result["pose"].values[shown]
    sight = np.stack([poses[..., :2], np.broadcast_to(leader[:, np.newaxis], poses[..., :2].shape)], axis=-2)
    axes.add_collection(LineCollection(list(sight.reshape(-1, 2, 2)), colors="grey", linewidths=0.6), autolim=False)
    x, y, heading = poses[..., 0].ravel(), poses[..., 1].ravel(), poses[..., 2].ravel()
    colour = [*colours.values()] * len(shown)
    axes.quiver(x, y, np.cos(heading), np.sin(heading), color=colour, scale=28, width=0.006, zorder=3)
    axes.plot(*leader.T, linestyle="", marker="D", markersize=4, color=_LEADER)
    for sample, place in zip(shown, leader, strict=True):
        axes.annotate(
            f"{result['time'].values[sample]:.0f} s",
            place,
            textcoords="offset points",
            xytext=(0, 6),
            fontsize=8,
            ha="center",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 0.5},
        )
    points = np.concatenate([leader, poses[..., :2].reshape(-1, 2)])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * float(np.max(high - low)) + 0.5
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)


def _draw_signals(
    figure: Figure,
    place: SubplotSpec,
    title: str,
    result: Result,
    colours: Mapping[str, Colour],
    signals: Mapping[str, NDArray[np.float64] | None],
) -> None:
    """Draw signals (T, N) above each other over the same time."""
    grid = place.subgridspec(len(signals), 1, hspace=0.15)
    first: Axes | None = None
    for row, (label, signal) in enumerate(signals.items()):
        axes = _panel(figure, grid[row, 0], "" if first else title, first)
        _draw_lines(axes, result, colours, label, signal)
        first = first or axes
        if row < len(signals) - 1:
            axes.tick_params(labelbottom=False)
        else:
            axes.set_xlabel("time [s]")


def _draw_lines(
    axes: Axes, result: Result, colours: Mapping[str, Colour], label: str, signal: NDArray[np.float64] | None
) -> None:
    axes.set_ylabel(label)
    axes.grid(alpha=0.3)
    if signal is None:
        axes.text(0.5, 0.5, "not recorded by this controller", transform=axes.transAxes, ha="center", va="center")
        return
    time = result["time"].values
    marker = "." if len(time) == 1 else ""
    for course, colour in zip(signal.T, colours.values(), strict=True):
        shown = thinned(course)
        axes.plot(time[shown], course[shown], color=colour, linewidth=0.9, marker=marker)


def _missing(values: NDArray[np.float64]) -> int:
    return int(np.isnan(values).sum())


def _colours(number: int) -> Iterable[Colour]:
    if number <= 10:
        return mpl.colormaps["tab10"](np.arange(number))
    return mpl.colormaps["viridis"](np.linspace(0, 1, number))
