"""How far apart two plants are, drawn: their paths, the commands, and every role with its difference over time."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TypedDict

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from numpy.typing import NDArray

from cosim.compare.comparison import PlantComparison, RoleDifference
from cosim.errors import printable
from cosim.results.display_units import displayed
from cosim.results.files import write


class _Style(TypedDict):
    """How a line is drawn, as Matplotlib takes it."""

    color: str
    linestyle: str | tuple[int, tuple[int, int]]
    linewidth: float
    alpha: float


_STYLES: tuple[_Style, ...] = (
    {"color": "tab:blue", "linestyle": "-", "linewidth": 2.2, "alpha": 0.8},
    {"color": "tab:orange", "linestyle": (0, (4, 2)), "linewidth": 1.4, "alpha": 1.0},
)
"""The second plant is drawn over the first, which is seen through its gaps."""
_DIFFERENCE = "tab:red"


def save_comparison_figure(comparison: PlantComparison, path: Path) -> None:
    """Draw a comparison and write it as PNG.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    buffer = io.BytesIO()
    draw_comparison(comparison).savefig(buffer, format="png", dpi=110)
    write(path, buffer.getbuffer())


def draw_comparison(comparison: PlantComparison) -> Figure:
    """Return the figure."""
    rows = len(comparison.roles)
    figure = Figure(figsize=(13, 5 + 1.9 * rows), layout="constrained")
    names = names_of(comparison)
    same = f"under the same {comparison.kind.command_word}s"
    figure.suptitle(f"{names[0]} and {names[1]} {same}", fontsize=13, parse_math=False)
    grid = figure.add_gridspec(1 + rows, 2, height_ratios=(2.4, *(1.0,) * rows))
    paths = figure.add_subplot(grid[0, 0])
    _draw_paths(paths, comparison, names)
    _draw_commands(figure, grid[0, 1], comparison)
    columns: list[Axes | None] = [None, None]
    for row, found in enumerate(comparison.roles, 1):
        left = figure.add_subplot(grid[row, 0], sharex=columns[0])
        right = figure.add_subplot(grid[row, 1], sharex=columns[1])
        _draw_role(left, comparison, found)
        _draw_difference(right, comparison, found)
        if row == 1:
            left.set_title("each")
            right.set_title("difference, B - A", loc="left")
            columns = [left, right]
        for axes in (left, right):
            if row < rows:
                axes.tick_params(labelbottom=False)
            else:
                axes.set_xlabel("time [s]")
    return figure


def names_of(comparison: PlantComparison) -> tuple[str, str]:
    """Return the names of the plants: A and B, with their files."""
    first, second = (printable(Path(about["file"]).name) for about in comparison.plants)
    return f"A: {first}", f"B: {second}"


def _draw_paths(axes: Axes, comparison: PlantComparison, names: tuple[str, str]) -> None:
    axes.set_title("paths")
    for states, style, name in zip(comparison.states, _STYLES, names, strict=True):
        axes.plot(states[:, 0], states[:, 1], **style, label=name.replace("$", r"\$"))
        reached = states[np.isfinite(states[:, 0])]
        axes.plot(*reached[-1, :2], marker="o", markersize=6, color=style["color"])
        axes.quiver(
            *reached[0, :2], np.cos(reached[0, 2]), np.sin(reached[0, 2]), color=style["color"], scale=15, width=0.006
        )
    x, y = comparison.kind.pose[:2]
    axes.set_xlabel(f"{x.name} [{x.unit}]")
    axes.set_ylabel(f"{y.name} [{y.unit}]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small", loc="best")


def _draw_commands(figure: Figure, place: SubplotSpec, comparison: PlantComparison) -> None:
    last = len(comparison.kind.command) - 1
    grid = place.subgridspec(1 + last, 1)
    for row, role in enumerate(comparison.kind.command):
        axes = figure.add_subplot(grid[row, 0])
        held = np.append(comparison.torque[:, row], comparison.torque[-1:, row])
        axes.step(comparison.time, held, where="post", color="black", linewidth=1.0)
        axes.set_ylabel(f"{role.name} [{role.unit}]")
        axes.grid(alpha=0.3)
        if row == 0:
            title = f"{comparison.kind.command_word}s: {printable(comparison.torque_from)}"
            axes.set_title(title, parse_math=False, wrap=True)
        axes.tick_params(labelbottom=row == last)
    axes.set_xlabel("time [s]")


def _draw_role(axes: Axes, comparison: PlantComparison, found: RoleDifference) -> None:
    unit, factor = displayed(found.role.unit)
    for states, style in zip(comparison.states, _STYLES, strict=True):
        axes.plot(comparison.time, factor * states[:, _column(comparison, found)], **style)
    axes.set_ylabel(f"{found.role.name} [{unit}]")
    axes.grid(alpha=0.3)


def _draw_difference(axes: Axes, comparison: PlantComparison, found: RoleDifference) -> None:
    unit, factor = displayed(found.role.unit)
    course: NDArray[np.float64] = factor * comparison.difference[:, _column(comparison, found)]
    axes.plot(comparison.time, course, color=_DIFFERENCE, linewidth=1.2)
    at = round(found.at / comparison.step)
    axes.plot(found.at, course[at], marker="o", markersize=5, color=_DIFFERENCE)
    text = f"largest {factor * found.largest:.3g} {unit} at {found.at:.12g} s, RMS {factor * found.rms:.3g} {unit}"
    axes.set_title(text, loc="right", fontsize=9, pad=3)
    low, high = np.nanmin(course), np.nanmax(course)
    axes.margins(y=0.1)
    tolerance = factor * found.tolerance
    if tolerance < 5 * max(abs(low), abs(high)):  # else the difference could not be seen
        axes.axhspan(-tolerance, tolerance, color="grey", alpha=0.15, linewidth=0)
    axes.axhline(0.0, color="black", linewidth=0.6)
    axes.set_ylabel(f"{found.role.name} [{unit}]")
    axes.grid(alpha=0.3)


def _column(comparison: PlantComparison, found: RoleDifference) -> int:
    return (*comparison.kind.pose, *comparison.kind.velocity).index(found.role)
