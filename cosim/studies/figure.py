"""The picture of a study, from its table alone: how each measure is spread, and what it depends on."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter
from numpy.typing import NDArray

from cosim.errors import printable
from cosim.quantity import quantity
from cosim.studies import bounds
from cosim.studies.conduct import StudyOutcome
from cosim.studies.row import FAILED, PASSED
from cosim.studies.study import Measured, Vary
from cosim.studies.table import Column, columns
from cosim.studies.values import Count

_MOST_MEASURES, _MOST_VALUES = 6, 3
"""Rows of panels, and varied values in a row."""
_MOST_WORDS = 12
"""Words on an axis."""
_LOOK = {PASSED: ("#0072b2", "o", "passed"), FAILED: ("#d55e00", "x", "failed")}
"""Colour, marker and word of each status: colours that the colour-blind can tell, and other markers."""
_BAND, _BOUND = "#999999", "black"
_WIDTH, _HEIGHT = 4.2, 3.1
"""Of a panel [in]."""
_CONFIDENCE = 0.95


def picture(outcome: StudyOutcome) -> bytes:
    """Return the picture as PNG; see `draw`."""
    buffer = io.BytesIO()
    draw(outcome).savefig(buffer, format="png", dpi=110, pil_kwargs={"compress_level": 1})
    return buffer.getvalue()


def draw(outcome: StudyOutcome) -> Figure:
    """Return the figure: a row for each measure.

    On the left the share of runs whose figure is at most so large, with a band of 95 % confidence for each share and
    the bounds of what must hold. Beside it the figure of each run over each varied value; or, of a grid of two values,
    the worst figure at each of their points.
    """
    table = {column.name: column for column in columns(outcome)}
    measures = outcome.study.measures[:_MOST_MEASURES]
    varied = [table[vary.name] for vary in outcome.study.vary if _can_be_an_axis(vary, table[vary.name])][:_MOST_VALUES]
    a_map = len(varied) == 2 and outcome.study.sample.method == "grid"
    across = 1 + (1 if a_map else len(varied))
    figure = Figure(figsize=(across * _WIDTH, max(len(measures), 1) * _HEIGHT + 0.5), layout="constrained")
    figure.suptitle(printable(f"{outcome.study.name}: {outcome.study.title}"), fontsize=12, parse_math=False)
    statuses = np.array(table["status"].values)
    panels = figure.subplots(max(len(measures), 1), across, squeeze=False)
    if not measures:
        for panel in panels.flat:
            panel.axis("off")
        panels[0, 0].text(0.5, 0.5, "the study has no measure", ha="center")
    for row, measured in zip(panels, measures, strict=False):
        figures = np.array(table[measured.name].values, dtype=np.float64)
        _distribution(row[0], outcome, measured, figures[~np.isnan(figures)])
        if a_map:
            _map(row[1], table[measured.name], varied, figures, measured.greatest_is_worst)
            continue
        for panel, value in zip(row[1:], varied, strict=True):
            _scatter(panel, table[measured.name], value, figures, statuses)
    if measures and varied and not a_map and len(set(statuses) & set(_LOOK)) > 1:
        panels[0, 1].legend(fontsize="small", loc="best")
    return figure


def _can_be_an_axis(vary: Vary, column: Column) -> bool:
    """Return whether a varied value is a number, or one of a few words, and does not just count the draws."""
    different = len(set(column.values))
    words = all(isinstance(value, str) for value in column.values)
    return different > 1 and not isinstance(vary.values, Count) and (different <= _MOST_WORDS or not words)


def _distribution(panel: Axes, outcome: StudyOutcome, measured: Measured, figures: NDArray[np.float64]) -> None:
    runs = len(outcome.rows)  # a broken run has no figure, and counts in the share
    known = np.sort(figures[np.isfinite(figures)])
    panel.set_xlabel(_label(measured.name, measured.unit), parse_math=False)
    panel.set_ylabel("share of the runs up to it")
    panel.yaxis.set_major_formatter(PercentFormatter(1.0))
    panel.set_ylim(0.0, 1.03)
    if len(known):
        worse_than_all = 0 if measured.greatest_is_worst else runs - len(known)
        steps = np.unique(np.linspace(0, len(known) - 1, min(len(known), 200)).astype(int))
        counts = steps + 1 + worse_than_all
        sure = (1.0 + _CONFIDENCE) / 2.0
        low = [bounds.probability_at_least(int(count), runs, sure) for count in counts]
        high = [bounds.probability_at_most(int(count), runs, sure) for count in counts]
        panel.fill_between(known[steps], low, high, step="post", color=_BAND, alpha=0.35, linewidth=0)
        panel.step(known, (np.arange(len(known)) + 1 + worse_than_all) / runs, where="post", color=_LOOK[PASSED][0])
    missing = runs - len(known)
    if missing:
        panel.text(
            0.02, 0.97, f"{missing} of {runs} runs without a figure", transform=panel.transAxes, va="top", fontsize=8
        )
    for bound in _bounds(outcome, measured):
        panel.axvline(bound, color=_BOUND, linestyle="--", linewidth=1)


def _bounds(outcome: StudyOutcome, measured: Measured) -> list[float]:
    """Return the bounds of what must hold of a measure, in its unit."""
    found = []
    for one in outcome.study.requirements:
        text = one.attributes.get("below", one.attributes.get("above", ""))
        if one.attributes.get("of") == measured.name and text and one.kind in ("quantile", "mean", "worst"):
            found.append(quantity(text, measured.unit or "1"))
    return found


def _scatter(
    panel: Axes, measure: Column, value: Column, figures: NDArray[np.float64], statuses: NDArray[np.str_]
) -> None:
    words = sorted({str(own) for own in value.values}) if isinstance(value.values[0], str) else []
    at = np.array([words.index(str(own)) if words else float(own) for own in value.values])
    if words:  # side by side, so that runs with the same word do not hide each other
        at = at + 0.3 * (np.modf(np.arange(len(at)) * 0.618034)[0] - 0.5)
        panel.set_xticks(range(len(words)), [printable(word) for word in words])
    for status, (colour, marker, label) in _LOOK.items():
        shown = (statuses == status) & np.isfinite(figures)
        size = 14 if len(at) <= 300 else 5
        panel.scatter(
            at[shown], figures[shown], s=size, c=colour, marker=marker, label=label, linewidths=0.8, alpha=0.7
        )
    endless = (statuses != "broken") & ~np.isfinite(figures)
    if endless.any():  # at the edge: it has no figure
        panel.plot(
            at[endless],
            np.full(endless.sum(), 1.0),
            "^",
            transform=panel.get_xaxis_transform(),
            color=_BAND,
            clip_on=False,
        )
    panel.set_xlabel(_label(value.name, value.unit), parse_math=False)
    panel.set_ylabel(_label(measure.name, measure.unit), parse_math=False)


def _map(
    panel: Axes, measure: Column, varied: Sequence[Column], figures: NDArray[np.float64], greatest_is_worst: bool
) -> None:
    """Draw the worst figure at each point of a grid."""
    axes = [list(dict.fromkeys(column.values)) for column in varied]
    worst = np.full((len(axes[1]), len(axes[0])), math.nan)
    for one, other, figure in zip(varied[0].values, varied[1].values, figures, strict=True):
        place = axes[1].index(other), axes[0].index(one)
        pick = np.fmax if greatest_is_worst else np.fmin
        worst[place] = pick(worst[place], figure)
    image = panel.imshow(np.where(np.isfinite(worst), worst, math.nan), origin="lower", aspect="auto", cmap="cividis")
    panel.set_facecolor("white")
    panel.set_xticks(
        range(len(axes[0])), [f"{own:g}" if isinstance(own, float) else printable(str(own)) for own in axes[0]]
    )
    panel.set_yticks(
        range(len(axes[1])), [f"{own:g}" if isinstance(own, float) else printable(str(own)) for own in axes[1]]
    )
    panel.set_xlabel(_label(varied[0].name, varied[0].unit), parse_math=False)
    panel.set_ylabel(_label(varied[1].name, varied[1].unit), parse_math=False)
    panel.figure.colorbar(image, ax=panel, label=f"worst {_label(measure.name, measure.unit)}; white: none")


def _label(name: str, unit: str) -> str:
    return printable(f"{name} [{unit}]" if unit else name)
