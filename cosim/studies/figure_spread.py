"""How a measure is spread: the share of runs up to each figure, with its confidence and what must hold."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import PercentFormatter
from numpy.typing import NDArray

from cosim.errors import printable
from cosim.quantity import quantity
from cosim.studies import bounds
from cosim.studies.conduct import StudyOutcome
from cosim.studies.draws import AT_RANDOM
from cosim.studies.figure_style import BOUND, COLOURS, draw_bound, few_ticks, label, note
from cosim.studies.study import Measured

CONFIDENCE = 0.95


def draw_spread(
    panel: Axes, outcome: StudyOutcome, measured: Measured, cases: Mapping[str, NDArray[np.float64]]
) -> None:
    """Draw the share of the runs whose figure is at most so large.

    Parameters
    ----------
    cases
        The figures of the runs of each case, those without a figure included; of a single one, its name is not shown.
    """
    panel.set_xlabel(label(measured.name, measured.unit), parse_math=False)
    panel.set_ylabel("share of the runs up to it")
    panel.yaxis.set_major_formatter(PercentFormatter(1.0))
    panel.set_ylim(0.0, 1.03)
    at_random = outcome.study.sample.method in AT_RANDOM
    draws = len({row.draw for row in outcome.rows})
    for (name, figures), colour in zip(cases.items(), COLOURS, strict=False):
        named = printable(name) if len(cases) > 1 else None
        band = at_random and len(figures) <= draws  # several runs of a draw depend on each other
        _draw_steps(panel, figures, measured.greatest_is_worst, colour, named, band)
    few_ticks(panel, np.concatenate(list(cases.values())))
    runs = sum(map(len, cases.values()))
    missing = sum(int((~np.isfinite(figures)).sum()) for figures in cases.values())
    if missing:
        note(panel, f"{missing} of {runs} runs without a figure")
    _draw_requirements(panel, outcome, measured)
    if panel.get_legend_handles_labels()[1]:
        panel.legend(fontsize="small", loc="lower right")


def _draw_steps(
    panel: Axes, figures: NDArray[np.float64], greatest_is_worst: bool, colour: str, name: str | None, band: bool
) -> None:
    runs = len(figures)  # a broken run has no figure, and counts in the share
    known = np.sort(figures[np.isfinite(figures)])
    if not len(known):
        return
    worse_than_all = 0 if greatest_is_worst else runs - len(known)
    if band:
        steps = np.unique(np.linspace(0, len(known) - 1, min(len(known), 200)).astype(int))
        counts = steps + 1 + worse_than_all
        sure = (1.0 + CONFIDENCE) / 2.0
        low = [bounds.probability_at_least(int(count), runs, sure) for count in counts]
        high = [bounds.probability_at_most(int(count), runs, sure) for count in counts]
        panel.fill_between(known[steps], low, high, step="post", color=colour, alpha=0.2, linewidth=0)
    shares = (np.arange(len(known)) + 1 + worse_than_all) / runs
    panel.step(known, shares, where="post", color=colour, label=name)


def _draw_requirements(panel: Axes, outcome: StudyOutcome, measured: Measured) -> None:
    """Draw the bound of each thing that must hold of a measure, and the quantile that was shown with confidence."""
    verdicts = {verdict.where: verdict for verdict in outcome.verdicts}
    for one in outcome.study.requirements:
        text = one.attributes.get("below", one.attributes.get("above", ""))
        if one.attributes.get("of") != measured.name or not text or one.kind not in ("quantile", "mean", "worst"):
            continue
        draw_bound(panel, one, quantity(text, measured.unit or "1"), across=False)
        verdict = verdicts.get(one.where)
        if one.kind == "quantile" and verdict is not None and np.isfinite(verdict.figure):
            at, confidence = float(one.attributes["at"]), float(one.attributes["confidence"])
            side = "most" if "below" in one.attributes else "least"
            figure = f"{verdict.figure:.4g} {printable(measured.unit)}".rstrip()
            given = f" {printable(one.given_in_words)}" if one.given else ""
            told = f"{at:.12g} quantile{given}: at {side} {figure}\nwith confidence {confidence:.12g}"
            panel.plot([verdict.figure], [at], "D", color=BOUND, markersize=4, label=told)
