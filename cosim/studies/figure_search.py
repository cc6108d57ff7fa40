"""The picture of a search for the worst case: the least margin of each run, and where in the ranges it is small."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter
from numpy.typing import NDArray

from cosim.errors import printable
from cosim.studies.conduct import StudyOutcome
from cosim.studies.figure_style import HEIGHT, WIDTH, font, is_log, note, png, word_ticks
from cosim.studies.row import PASSED
from cosim.studies.table import Column, columns
from cosim.studies.values import Count

_MOST_VALUES = 3
_RUN, _FAILS, _LEAST = "#0072b2", "#d55e00", "#333333"
"""Colours that the colour-blind can tell from each other."""
_LOWEST = -1.0
"""Margins below are drawn here: a margin may be without limit."""


def picture(outcome: StudyOutcome) -> bytes:
    """Return the picture as PNG; see `draw`."""
    return png(draw(outcome))


def draw(outcome: StudyOutcome) -> Figure:
    """Return the figure: the least margin of each run over its bound, and the least so far; then over each value.

    Of two or more values, the last panel has all runs over the first two.
    """
    table = {column.name: column for column in columns(outcome)}
    searched = [table[vary.name] for vary in outcome.study.vary if not isinstance(vary.values, Count)]
    varied = [column for column in searched if len(set(column.values)) > 1][:_MOST_VALUES]
    numeric = [column for column in varied if not isinstance(column.values[0], str)]
    both = len(numeric) > 1
    across = 1 + len(varied) + both
    lines = 1 if across <= 3 else 2
    margins = np.maximum([row.least for row in outcome.rows], _LOWEST)
    fails = np.array([row.status != PASSED for row in outcome.rows])
    with font():
        figure = Figure(figsize=(WIDTH * math.ceil(across / lines), HEIGHT * lines + 0.5), layout="constrained")
        figure.suptitle(printable(f"{outcome.study.name}: {outcome.study.title}"), parse_math=False)
        panels = figure.subplots(lines, math.ceil(across / lines), squeeze=False).ravel()
        for panel in panels[across:]:
            panel.axis("off")
        _descent(panels[0], margins, fails)
        for panel, column in zip(panels[1:], varied, strict=False):
            _over(panel, column, margins, fails)
        if both:
            _map(panels[across - 1], numeric[0], numeric[1], margins, fails)
    return figure


def _descent(panel: Axes, margins: NDArray[np.float64], fails: NDArray[np.bool_]) -> None:
    runs = np.arange(1, len(margins) + 1)
    panel.step(runs, np.minimum.accumulate(margins), where="post", color=_LEAST, linewidth=1, label="least so far")
    panel.scatter(runs[~fails], margins[~fails], s=8, color=_RUN, linewidths=0, label="passes")
    panel.scatter(runs[fails], margins[fails], s=14, color=_FAILS, marker="x", linewidths=0.8, label="fails")
    panel.set_xlabel("run")
    _margin_axis(panel, margins)
    panel.legend(fontsize="small", loc="best")


def _over(panel: Axes, column: Column, margins: NDArray[np.float64], fails: NDArray[np.bool_]) -> None:
    words = list(dict.fromkeys(map(str, column.values))) if isinstance(column.values[0], str) else []
    at = np.array([words.index(str(value)) if words else float(value) for value in column.values])
    if words:
        word_ticks(panel, words)
    elif is_log(at):
        panel.set_xscale("log")
    panel.scatter(at[~fails], margins[~fails], s=8, color=_RUN, linewidths=0)
    panel.scatter(at[fails], margins[fails], s=14, color=_FAILS, marker="x", linewidths=0.8)
    panel.set_xlabel(printable(column.heading), parse_math=False)
    _margin_axis(panel, margins)


def _margin_axis(panel: Axes, margins: NDArray[np.float64]) -> None:
    panel.axhline(0.0, color=_LEAST, linestyle="--", linewidth=1)
    panel.set_ylabel("least margin, of its bound")
    if margins.min() <= _LOWEST:
        note(panel, "-100 %: or less, or no figure")
    panel.yaxis.set_major_formatter(PercentFormatter(1.0))


def _map(panel: Axes, one: Column, other: Column, margins: NDArray[np.float64], fails: NDArray[np.bool_]) -> None:
    x, y = (np.array([float(value) for value in column.values]) for column in (one, other))
    finite = margins[np.isfinite(margins)]
    top = float(np.max(finite)) if len(finite) else math.nan
    seen = panel.scatter(x[~fails], y[~fails], c=margins[~fails], s=14, cmap="cividis", vmin=0.0, vmax=max(top, 1e-9))
    panel.scatter(x[fails], y[fails], s=18, color=_FAILS, marker="x", linewidths=0.9)
    panel.set_xlabel(printable(one.heading), parse_math=False)
    panel.set_ylabel(printable(other.heading), parse_math=False)
    for numbers, scale in ((x, panel.set_xscale), (y, panel.set_yscale)):
        if is_log(numbers):
            scale("log")
    bar = panel.figure.colorbar(seen, ax=panel, label="least margin of runs that pass")
    bar.ax.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
