"""The upper panels of a figure: the paths of all robots, and the formation at a few instants, to scale."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgba
from numpy.typing import NDArray

from cosim.results.figure_style import LEADER, Colour
from cosim.results.outlines import outlined_vehicles
from cosim.results.result import Result
from cosim.scenario.scenario import LEADER as LEADER_NAME
from cosim.vehicle.outline import Outline, placed

Floats = NDArray[np.float64]

_SNAPSHOTS = 5
_FROM = 0.6
"""The part of the run after which the formation is shown."""
_MOST_DETAILED = 60
"""Followers that are drawn with wheels and lines of sight."""
_POINTS = 2000
"""Points of a path."""
_SHADE = 0.3
"""Opacity of a body."""
_APART = 0.35
"""Distance of the names of two instants [in]."""


def draw_paths(axes: Axes, title: str, result: Result, colours: Sequence[Colour]) -> None:
    """Draw the paths of the whole run: where each begins is a dot, and the robots stand where they are in the end."""
    axes.set_title(title, loc="left", fontsize=9, y=1.0, pad=3)
    paths = _paths(axes, result, colours)
    starts = np.stack([path[0] for path in paths])
    axes.scatter(starts[:, 0], starts[:, 1], s=16, c=[LEADER, *colours], zorder=3)
    last = _last_drawn(result)
    if last is not None:
        _draw_robots(axes, result, np.array([last]), colours)
    points = np.concatenate(paths)
    points = points[np.isfinite(points).all(axis=1)]
    _show(axes, points if len(points) else np.zeros((1, 2)))


def draw_formation(axes: Axes, title: str, result: Result, colours: Sequence[Colour]) -> None:
    """Draw the last part of the paths, and the robots and their lines of sight at a few instants."""
    axes.set_title(title, loc="left", fontsize=9, y=1.0, pad=3)
    last = _last_drawn(result)
    if last is None:
        axes.set_axis_off()
        return
    shown = np.unique(np.linspace(_FROM * last, last, _SNAPSHOTS).round().astype(int))
    _paths(axes, result, colours)
    leader, poses = result["leader_pose"].values[shown, :2], result["pose"].values[shown, :, :2]
    if len(colours) <= _MOST_DETAILED:
        sight = np.stack([poses, np.broadcast_to(leader[:, np.newaxis], poses.shape)], axis=-2)
        axes.add_collection(LineCollection(list(sight.reshape(-1, 2, 2)), colors="grey", linewidths=0.5), autolim=False)
    _draw_robots(axes, result, shown, colours)
    _show(axes, np.concatenate([leader, poses.reshape(-1, 2)]))
    _name_instants(axes, result["time"].values[shown], leader)


def _last_drawn(result: Result) -> int | None:
    """Return the last sample at which all robots have a place."""
    placed_all = np.isfinite(result["pose"].values[..., :3]).all(axis=(1, 2))
    placed_all &= np.isfinite(result["leader_pose"].values[..., :3]).all(axis=-1)
    return int(np.flatnonzero(placed_all)[-1]) if placed_all.any() else None


def _paths(axes: Axes, result: Result, colours: Sequence[Colour]) -> list[Floats]:
    every = max(1, result.sizes["time"] // _POINTS)
    poses = result["pose"].values
    paths = [result["leader_pose"].values[::every, :2], *(poses[::every, row, :2] for row in range(len(colours)))]
    width = 1.2 if len(colours) <= _MOST_DETAILED else 0.4
    axes.add_collection(
        LineCollection(paths, colors=[LEADER, *colours], linestyles=["--", *["-"] * len(colours)], linewidths=width),
        autolim=False,
    )
    return paths


def _draw_robots(axes: Axes, result: Result, samples: NDArray[np.int_], colours: Sequence[Colour]) -> None:
    """Draw the robots at some samples: their outlines; arrows of those that have none."""
    outlined = outlined_vehicles(result)
    detailed = len(colours) <= _MOST_DETAILED
    alike: dict[Outline, list[str]] = {}
    for robot, own in outlined.items():
        alike.setdefault(own.outline, []).append(robot)
    colour_of = dict(zip((LEADER_NAME, *result.robots), (LEADER, *colours), strict=True))
    polygons: list[Floats] = []
    edges: list[Colour] = []
    faces: list[tuple[float, float, float, float]] = []
    for outline, robots in alike.items():
        poses = [outlined[robot].pose for robot in robots]
        pose = {entry: np.stack([own[entry][samples] for own in poses]) for entry in poses[0]}
        for part, corners in zip(outline, placed(outline, pose), strict=True):
            if part.collides or detailed:
                polygons += list(corners.reshape(-1, *corners.shape[2:]))
                for robot in robots:
                    edges += [colour_of[robot]] * len(samples)
                    faces += [to_rgba(colour_of[robot], _SHADE if part.collides else 1.0)] * len(samples)
    axes.add_collection(
        PolyCollection(polygons, edgecolors=edges, facecolors=faces, linewidths=0.8, zorder=2.5), autolim=False
    )
    for robot, colour in colour_of.items():
        if robot not in outlined:
            pose_of_it = result["leader_pose"].values if robot == LEADER_NAME else result.of_robot("pose", robot)
            x, y, heading = pose_of_it[samples, :3].T
            axes.quiver(x, y, np.cos(heading), np.sin(heading), color=colour, scale=28, width=0.006, zorder=3)


def _name_instants(axes: Axes, times: Floats, places: Floats) -> None:
    """Write the times [s] beside the leader's places, from the last one back; those that would overlap are left out."""
    scale = axes.get_window_extent().width / np.ptp(axes.get_xlim()) / axes.figure.dpi
    free: list[Floats] = []
    for time, place in zip(times[::-1], places[::-1], strict=True):
        if all(np.abs(place - other).max() * scale > _APART for other in free):
            free.append(place)
            axes.annotate(
                f"{time:.4g} s",
                place,
                textcoords="offset points",
                xytext=(0, 13),
                fontsize=8,
                ha="center",
                bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.5},
            )


def _show(axes: Axes, points: Floats) -> None:
    """Let a panel show some points, to scale."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * float(np.max(high - low)) + 0.8
    half = (high - low) / 2 + margin
    width, height = axes.get_window_extent().size
    scale = max(half[0] / width, half[1] / height)  # as set_aspect("equal"), which moves limits only while it draws
    left, bottom = (low + high) / 2 - scale * np.array([width, height])
    axes.set_xlim(left, left + 2 * scale * width)
    axes.set_ylim(bottom, bottom + 2 * scale * height)
    axes.grid(alpha=0.3)
    axes.set_xlabel("x [m]", labelpad=1)
    axes.set_ylabel("y [m]", labelpad=1)
