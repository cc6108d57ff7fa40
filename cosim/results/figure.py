"""The panels of the paper's Figure 6, drawn from a result."""

from __future__ import annotations

import io
import textwrap
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec

from cosim.errors import InputError, printable
from cosim.results.drawable_part import drawable
from cosim.results.files import write
from cosim.results.provenance import Provenance

_SNAPSHOTS = 5
_LEADER = "black"


def save_figure(result: xr.Dataset, path: str | Path) -> None:
    """Draw a result and write it as PNG.

    Raises
    ------
    InputError
        It holds no sample.
    OutputError
        The file cannot be written.
    """
    if not result.sizes["time"]:
        raise InputError("the result holds no sample, so there is nothing to draw")
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # a title in letters that the font lacks
        draw(result).savefig(buffer, format="png", dpi=120)
    write(Path(path), buffer.getbuffer())


def draw(result: xr.Dataset) -> Figure:
    """Return the figure: panels (a) to (h) as in the paper; a panel without a recorded signal states that.

    Above them stand the changes of the scenario and the reason of an early end, below them seed and versions.
    """
    figure = Figure(figsize=(13, 16), layout="constrained")
    figure.suptitle(_title(result), fontsize=13, parse_math=False)
    basis, whole = Provenance.of(result.attrs).basis, result
    result = drawable(result)
    if any(result[name].isnull().sum() > signal.isnull().sum() for name, signal in whole.data_vars.items()):
        basis += "; diverged values are not drawn"
    figure.supxlabel(basis, fontsize=8, color="grey", parse_math=False)
    grid = figure.add_gridspec(4, 2, height_ratios=(1.5, 1.2, 1.2, 0.8))
    robots = [str(robot) for robot in result["robot"].values]
    colours = dict(zip(robots, _colours(len(robots)), strict=True))

    paths = figure.add_subplot(grid[0, 0])
    paths.set_title("(a) paths")
    _draw_paths(paths, result, colours)
    paths.legend(fontsize="small", loc="best")
    enlarged = figure.add_subplot(grid[0, 1])
    enlarged.set_title("(b) formation at five instants, enlarged")
    _draw_formation(enlarged, result, colours)

    _draw_pair(
        figure,
        grid[1, 0],
        "(c) tracking errors",
        result,
        colours,
        {"range error [m]": result["range_error"], "bearing error [deg]": _degrees(result["bearing_error"])},
    )
    commands = "torque" if "torque" in result else "command"
    _draw_pair(figure, grid[1, 1], f"(d) {commands}s as applied", result, colours, _components(result, commands))
    _draw_pair(
        figure,
        grid[2, 0],
        "(e) estimation errors of range and bearing",
        result,
        colours,
        {
            "range error [m]": _error_of("range_estimate", result["range"], result),
            "bearing error [deg]": _degrees(_error_of("bearing_estimate", result["bearing"], result)),
        },
    )
    speed, steering = (result["velocity"].isel(velocity_component=i) for i in range(2))
    _draw_pair(
        figure,
        grid[2, 1],
        "(f) estimation errors of the velocities",
        result,
        colours,
        {
            "error of v [m/s]": _error_of("speed_estimate", speed, result),
            "error of omega [rad/s]": _error_of("steering_rate_estimate", steering, result),
        },
    )
    for place, title, name, label in (
        (grid[3, 0], "(g) Frobenius norm of the weights", "weight_norm", "norm of W"),
        (grid[3, 1], "(h) estimate of the robust gain", "gain_estimate", "theta"),
    ):
        axes = figure.add_subplot(place)
        axes.set_title(title)
        signal = result.get(name)
        unit = f" [{signal.attrs['units']}]" if signal is not None else ""
        _draw_lines(axes, result, colours, label + unit, signal)
        axes.set_xlabel("time [s]")
    return figure


def _title(result: xr.Dataset) -> str:
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


def _draw_paths(axes: Axes, result: xr.Dataset, colours: Mapping[str, Any]) -> None:
    leader = result["leader_pose"].values
    axes.plot(leader[:, 0], leader[:, 1], color=_LEADER, linestyle="--", linewidth=1.2, label="leader")
    for robot, colour in colours.items():
        pose = result["pose"].sel(robot=robot).values
        axes.plot(pose[:, 0], pose[:, 1], color=colour, linewidth=1.2, label=robot)
        axes.plot(*pose[0, :2], marker="o", markersize=4, color=colour)
    axes.plot(*leader[0, :2], marker="o", markersize=4, color=_LEADER)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.grid(alpha=0.3)


def _draw_formation(axes: Axes, result: xr.Dataset, colours: Mapping[str, Any]) -> None:
    """Draw the last part of the paths, and the robots and their lines of sight at a few instants."""
    places = [np.isfinite(result[name].values[..., :3]).all(axis=-1) for name in ("pose", "leader_pose")]
    drawn = places[0].all(axis=1) & places[1]
    samples = int(np.flatnonzero(drawn)[-1]) + 1 if drawn.any() else 0
    if not samples:
        return
    shown = np.unique(np.linspace(0.6 * (samples - 1), samples - 1, _SNAPSHOTS).round().astype(int))
    _draw_paths(axes, result, colours)
    leader = result["leader_pose"].values
    poses = {robot: result["pose"].sel(robot=robot).values for robot in colours}
    for sample in shown:
        for robot, colour in colours.items():
            pose = poses[robot][sample]
            axes.plot([pose[0], leader[sample, 0]], [pose[1], leader[sample, 1]], color="grey", linewidth=0.6)
            axes.quiver(
                pose[0],
                pose[1],
                np.cos(pose[2]),
                np.sin(pose[2]),
                color=colour,
                scale=28,
                width=0.006,
                zorder=3,
            )
        axes.plot(leader[sample, 0], leader[sample, 1], marker="D", markersize=4, color=_LEADER)
        time = f"{result['time'].values[sample]:.0f} s"
        axes.annotate(
            time,
            (leader[sample, 0], leader[sample, 1]),
            textcoords="offset points",
            xytext=(0, 6),
            fontsize=8,
            ha="center",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 0.5},
        )
    points = np.concatenate([leader[shown, :2], *(pose[shown, :2] for pose in poses.values())])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * float(np.max(high - low)) + 0.5
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)


def _draw_pair(
    figure: Figure,
    place: SubplotSpec,
    title: str,
    result: xr.Dataset,
    colours: Mapping[str, Any],
    signals: Mapping[str, xr.DataArray | None],
) -> None:
    """Draw two signals above each other over the same time."""
    grid = place.subgridspec(len(signals), 1)
    first: Axes | None = None
    for row, (label, signal) in enumerate(signals.items()):
        axes = figure.add_subplot(grid[row, 0], sharex=first)
        _draw_lines(axes, result, colours, label, signal)
        if first is None:
            axes.set_title(title)
            first = axes
        if row < len(signals) - 1:
            axes.tick_params(labelbottom=False)
        else:
            axes.set_xlabel("time [s]")


def _draw_lines(
    axes: Axes, result: xr.Dataset, colours: Mapping[str, Any], label: str, signal: xr.DataArray | None
) -> None:
    axes.set_ylabel(label)
    axes.grid(alpha=0.3)
    if signal is None:
        axes.text(0.5, 0.5, "not recorded by this controller", transform=axes.transAxes, ha="center", va="center")
        return
    time = result["time"].values
    marker = "." if len(time) == 1 else ""
    for robot, colour in colours.items():
        axes.plot(time, signal.sel(robot=robot).values, color=colour, linewidth=0.9, marker=marker)


# Signals ----------------------------------------------------------------------------------------------------


def _components(result: xr.Dataset, name: str) -> dict[str, xr.DataArray | None]:
    """Return the components of a signal, labelled with their units; those of an older result are torques."""
    labels = [str(label) for label in result[f"{name}_component"].values]
    units = result.get(f"{name}_component_units")
    shown = ["N.m"] * len(labels) if units is None else [str(unit) for unit in units.values]
    signals = [result[name].isel({f"{name}_component": at}) for at in range(len(labels))]
    return {f"{label} [{unit}]": signal for label, unit, signal in zip(labels, shown, signals, strict=True)}


def _error_of(estimate: str, true: xr.DataArray, result: xr.Dataset) -> xr.DataArray | None:
    return true - result[estimate] if estimate in result else None


def _degrees(signal: xr.DataArray | None) -> xr.DataArray | None:
    return None if signal is None else signal * (180 / np.pi)


def _colours(number: int) -> Any:
    if number <= 10:
        return mpl.colormaps["tab10"](np.arange(number))
    return mpl.colormaps["viridis"](np.linspace(0, 1, number))
