"""A measure over the varied values: as a curve with a band, as a map, or run by run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from cosim.errors import printable
from cosim.quantity import quantity
from cosim.studies.conduct import StudyOutcome
from cosim.studies.figure_style import COLOURS, GREY, LOOK, draw_bound, is_log, label, number, slant, word_ticks
from cosim.studies.study import Measured
from cosim.studies.table import Column

_TICKS = 7
"""On an axis of a map, at most."""


def draw_curves(
    panel: Axes,
    measure: Column,
    value: Column,
    cases: Mapping[str, NDArray[np.bool_]],
    figures: NDArray[np.float64],
) -> None:
    """Draw the median at each value, with a band from 5 % to 95 % of the runs there; a curve for each case."""
    at = np.array(value.values, dtype=np.float64)
    several = False
    for (name, own), colour in zip(cases.items(), COLOURS, strict=False):
        places = np.unique(at[own & ~np.isnan(at)])
        here = [figures[own & (at == place)] for place in places]
        low, middle, high = np.array(
            [np.quantile(runs, [0.05, 0.5, 0.95], method="inverted_cdf") for runs in here]
        ).T.reshape(3, -1)
        named = printable(name) if len(cases) > 1 else None
        panel.plot(places, _finite(middle), ".-", color=colour, label=named)
        if any(len(runs) > 1 for runs in here):
            several = True
            panel.fill_between(places, _finite(low), _finite(high), color=colour, alpha=0.2, linewidth=0)
        some = [place for place, runs in zip(places, here, strict=True) if not np.isfinite(runs).all()]
        draw_endless(panel, np.array(some), colour)
    if is_log(at):
        panel.set_xscale("log")
    panel.set_xlabel(label(value.name, value.unit), parse_math=False)
    panel.set_ylabel(label(measure.name, measure.unit), parse_math=False)
    if several:
        panel.set_title("median, and 5 % to 95 % of the runs", fontsize="small", loc="left")
    if len(cases) > 1:
        panel.legend(fontsize="small", loc="best")


def draw_runs(
    panel: Axes, measure: Column, value: Column, figures: NDArray[np.float64], statuses: NDArray[np.str_]
) -> None:
    """Draw the figure of each run; those with the same word side by side."""
    words = list(dict.fromkeys(map(str, value.values))) if isinstance(value.values[0], str) else []
    at = np.array([words.index(str(own)) if words else float(own) for own in value.values])
    if words:  # side by side, so that runs with the same word do not hide each other
        at = at + 0.3 * (np.modf(np.arange(len(at)) * 0.618034)[0] - 0.5)
        word_ticks(panel, words)
    elif is_log(at):
        panel.set_xscale("log")
    for status, (colour, marker, told) in LOOK.items():
        shown = (statuses == status) & np.isfinite(figures)
        size = 14 if len(at) <= 300 else 5
        panel.scatter(at[shown], figures[shown], s=size, c=colour, marker=marker, label=told, linewidths=0.8, alpha=0.7)
    if {"passed", "failed"} <= set(statuses):
        panel.legend(fontsize="small", loc="best")
    draw_endless(panel, at[(statuses != "broken") & ~np.isfinite(figures)], GREY)
    panel.set_xlabel(label(value.name, value.unit), parse_math=False)
    panel.set_ylabel(label(measure.name, measure.unit), parse_math=False)


def draw_endless(panel: Axes, at: NDArray[np.float64], colour: str) -> None:
    """Mark runs without a figure at the upper edge."""
    if len(at):
        panel.plot(
            at,
            np.full(len(at), 1.0),
            "^",
            transform=panel.get_xaxis_transform(),
            color=colour,
            markersize=4,
            clip_on=False,
        )


def draw_map(
    panel: Axes, measure: Column, varied: Sequence[Column], figures: NDArray[np.float64], greatest_is_worst: bool
) -> None:
    """Draw the worst figure at each point of a grid."""
    axes = [list(dict.fromkeys(column.values)) for column in varied]
    worst = np.full((len(axes[1]), len(axes[0])), math.nan)
    for one, other, figure in zip(varied[0].values, varied[1].values, figures, strict=True):
        place = axes[1].index(other), axes[0].index(one)
        pick = np.fmax if greatest_is_worst else np.fmin
        worst[place] = pick(worst[place], figure)
    finite = np.isfinite(worst)
    image = panel.imshow(np.where(finite, worst, math.nan), origin="lower", aspect="auto", cmap="cividis")
    panel.set_facecolor("white")
    for axis, values, column in zip((panel.xaxis, panel.yaxis), axes, varied, strict=True):
        every = math.ceil(len(values) / _TICKS)
        shown = [number(own) for own in values[::every]]
        axis.set_ticks(range(0, len(values), every), shown)
        if axis is panel.xaxis:
            slant(panel, shown)
        axis.set_label_text(label(column.name, column.unit), parse_math=False)
    told = "worst " * (len(figures) > worst.size) + label(measure.name, measure.unit)
    panel.figure.colorbar(image, ax=panel).set_label(told + "; white: none" * (not finite.all()), parse_math=False)


def draw_bounds(panel: Axes, outcome: StudyOutcome, measured: Measured) -> None:
    """Draw the bounds of what must hold of each run's figure."""
    for one in outcome.study.requirements:
        if one.attributes.get("of") == measured.name and one.kind in ("quantile", "worst", "mean"):
            text = one.attributes.get("below", one.attributes.get("above", ""))
            draw_bound(panel, one, quantity(text, measured.unit or "1"), across=True)


def _finite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(np.isfinite(values), values, math.nan)
