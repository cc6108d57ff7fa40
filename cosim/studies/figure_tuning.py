"""The picture of a tuning: how each search came down, and the cost on the draws that were held out."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cosim.errors import printable
from cosim.studies.conduct import StudyOutcome
from cosim.studies.row import Row
from cosim.studies.study import Tune
from cosim.studies.trial import cost_of, mean_cost, passes
from cosim.studies.tuned_files import so_far
from cosim.studies.tuning import Tuned

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
"""That the colour-blind can tell from each other; one a restart."""
_OWN, _BEST = "#999999", "#0072b2"


def picture(outcome: StudyOutcome) -> bytes:
    """Return the picture as PNG; see `draw`."""
    buffer = io.BytesIO()
    draw(outcome).savefig(buffer, format="png", dpi=110, pil_kwargs={"compress_level": 1})
    return buffer.getvalue()


def draw(outcome: StudyOutcome) -> Figure:
    """Return the figure: a row for each case.

    On the left the cost of each trial that passes, and the least one so far of each restart. On the right the cost of
    each held-out draw, with the scenario's own values and with the best ones.
    """
    tune = outcome.study.tune
    assert tune is not None
    figure = Figure(figsize=(9.5, 3.2 * max(len(outcome.tuned), 1) + 0.5), layout="constrained")
    figure.suptitle(printable(f"{outcome.study.name}: {outcome.study.title}"), fontsize=12, parse_math=False)
    panels = figure.subplots(max(len(outcome.tuned), 1), 2, squeeze=False, width_ratios=(2, 1))
    for (left, right), tuned in zip(panels, outcome.tuned, strict=False):
        _descent(left, tune, tuned)
        _held_out(right, tune, tuned)
        if tuned.name:
            left.set_title(printable(tuned.name), fontsize=10, parse_math=False)
    if not outcome.tuned:
        for panel in panels.flat:
            panel.axis("off")
    return figure


def _descent(panel: Axes, tune: Tune, tuned: Tuned) -> None:
    least = so_far(tune, tuned.trials)
    for restart in sorted({trial.restart for trial in tuned.trials}):
        colour = _COLOURS[(restart - 1) % len(_COLOURS)]
        own = [(trial, cost) for trial, cost in zip(tuned.trials, least, strict=True) if trial.restart == restart]
        good = [
            (place, mean_cost(tune, trial.rows.values()))
            for place, (trial, _) in enumerate(own, 1)
            if not trial.pruned and passes(trial.rows.values())
        ]
        panel.scatter([at for at, _ in good], [cost for _, cost in good], s=10, color=colour, alpha=0.5, linewidths=0)
        course = [cost if math.isfinite(cost) else math.nan for _, cost in own]
        panel.step(range(1, len(own) + 1), course, where="post", color=colour, label=f"restart {restart}")
    first = mean_cost(tune, tuned.trials[0].rows.values())
    if math.isfinite(first):
        panel.axhline(first, color=_OWN, linestyle="--", linewidth=1, label="the scenario's own values")
    _scale(panel, [mean_cost(tune, trial.rows.values()) for trial in tuned.trials])
    panel.set_xlabel("trial of the restart")
    panel.set_ylabel("cost in training")
    panel.legend(fontsize="small", loc="upper right")


def _held_out(panel: Axes, tune: Tune, tuned: Tuned) -> None:
    if not tuned.held_out:
        panel.axis("off")
        panel.text(0.5, 0.5, "a first look: nothing was run\non held-out draws", ha="center", va="center")
        return
    both: Sequence[tuple[str, Sequence[Row], str]] = (("own", tuned.own, _OWN), ("tuned", tuned.held_out, _BEST))
    costs = [np.array([cost_of(tune, row) for row in rows]) for _, rows, _ in both]
    for place, ((_, _, colour), own) in enumerate(zip(both, costs, strict=True)):
        finite = np.isfinite(own)
        panel.scatter(np.full(finite.sum(), place), own[finite], s=16, color=colour, zorder=3)
        if len(own) and not finite.all():
            text = f"{(~finite).sum()} without"
            panel.text(place, 0.97, text, transform=panel.get_xaxis_transform(), ha="center", va="top", fontsize=8)
    for one, other in zip(*costs, strict=True):  # a line for each draw: they are compared in pairs
        if math.isfinite(one) and math.isfinite(other):
            panel.plot([0, 1], [one, other], color="#bbbbbb", linewidth=0.7)
    _scale(panel, [float(cost) for own in costs for cost in own])
    panel.set_xticks([0, 1], ["own", "tuned"])
    panel.set_xlim(-0.5, 1.5)
    panel.set_ylabel("cost on held-out draws")


def _scale(panel: Axes, costs: Sequence[float]) -> None:
    """Choose a logarithmic axis for costs that differ by more than a factor of ten."""
    known = [cost for cost in costs if math.isfinite(cost)]
    if known and min(known) > 0.0 and max(known) > 10.0 * min(known):
        panel.set_yscale("log")
