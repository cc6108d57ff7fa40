"""What a measure depends on: bars of a sensitivity, and the tornado of one value at a time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from cosim.errors import printable
from cosim.studies.figure_style import COLOURS, label
from cosim.studies.row import BROKEN, Row
from cosim.studies.sensitivity import Sensitivity
from cosim.studies.study import Measured, Study
from cosim.studies.values import Count

_MOST = 12
"""Values in a panel."""
_BARS = {
    "saltelli": (("total", "in all", COLOURS[4]), ("first", "alone", COLOURS[0])),
    "morris": (("mean_absolute", "magnitude", COLOURS[0]), ("deviation", "deviation", COLOURS[4])),
}
"""Of each method: figure, word and colour, the first bar at the top."""


def draw_sensitivity(panel: Axes, one: Sensitivity, method: str) -> None:
    """Draw a pair of bars for each value, the most important one at the top, with intervals of 95 % confidence."""
    if not one.figures:
        panel.axis("off")
        panel.text(0.5, 0.5, printable(f"{one.measure}: {one.note}"), ha="center", va="center", wrap=True)
        return
    order = one.order()[:_MOST]
    places = np.arange(len(order))
    for number, (name, word, colour) in enumerate(_BARS[method]):
        lengths = [one.figures[name][index] for index in order]
        spread = one.figures.get(f"{name}_plus_minus")
        panel.barh(
            places + 0.38 * (number - 0.5),
            lengths,
            0.36,
            color=colour,
            label=word,
            xerr=None if spread is None else [spread[index] for index in order],
            error_kw={"linewidth": 0.9, "ecolor": "black", "capsize": 2},
        )
    panel.set_yticks(places, [printable(one.names[index]) for index in order])
    panel.invert_yaxis()
    panel.axvline(0.0, color="black", linewidth=0.8)
    if method == "saltelli":
        text = f"share of the variance of {printable(one.measure)}"
    else:
        text = f"change of {label(one.measure, one.unit)}\nover the range of each value"
    panel.set_xlabel(text, parse_math=False)
    panel.legend(fontsize="small", loc="lower right")
    more = [f"{len(one.names) - _MOST} less important values"] if len(one.names) > _MOST else []
    if one.left_out:
        more.append(f"without {one.left_out} of {one.groups + one.left_out} groups of runs")
    if more:
        panel.set_title("; ".join(more), fontsize="small", loc="right")


@dataclass(frozen=True)
class Change:
    """What one value changes, alone: of each of its values the figure; infinite where there is none."""

    name: str
    texts: tuple[str, ...]
    figures: tuple[float, ...]


def changes_of(study: Study, rows: Sequence[Row], measure: int) -> tuple[float, list[Change]]:
    """Return the figure of the scenario as it is, and what each value changes alone, the most important one first."""
    crossed = [index for index, vary in enumerate(study.vary) if vary.crossed]
    own = next((row for row in rows if row.draw == 1), None)
    base = math.nan if own is None else _figure(own, measure)
    found = []
    for index, vary in enumerate(study.vary):
        if index in crossed or isinstance(vary.values, Count):
            continue
        changed = [row for row in rows if row.draw > 1 and row.values[index] is not None]
        if changed:
            texts = tuple(str(row.values[index]) for row in changed)
            found.append(Change(vary.name, texts, tuple(_figure(row, measure) for row in changed)))
    return base, sorted(found, key=lambda change: -_reach(change, base))


def draw_tornado(panel: Axes, measured: Measured, base: float, changes: Sequence[Change]) -> None:
    """Draw a bar for each value, from the least to the greatest figure, with the values that these belong to."""
    panel.set_xlabel(label(measured.name, measured.unit), parse_math=False)
    shown = changes[:_MOST]
    panel.set_yticks(range(len(shown)), [printable(change.name) for change in shown])
    panel.set_ylim(len(shown) - 0.5, -0.5)
    for place, change in enumerate(shown):
        ends = list(zip(change.figures, change.texts, strict=True))
        _draw_bar(panel, place, [end for end in ends if math.isfinite(end[0])], base)
        without = [text for figure, text in ends if not math.isfinite(figure)]
        if without:
            told = printable(f"no figure: {', '.join(without)} ")
            at = 1.0, place
            panel.annotate(told, at, xycoords=panel.get_yaxis_transform(), fontsize="small", ha="right", va="center")
    if math.isfinite(base):
        panel.axvline(base, color="black", linewidth=1)
    panel.margins(x=0.25)
    if len(changes) > _MOST:
        panel.set_title(f"{len(changes) - _MOST} less important values", fontsize="small", loc="right")


def _draw_bar(panel: Axes, place: int, ends: Sequence[tuple[float, str]], base: float) -> None:
    """Draw a bar from the least to the greatest figure, with that of the scenario as it is, whose value has no word."""
    ends = [*ends, *([(base, "")] if math.isfinite(base) else [])]
    if not ends:
        return
    least, greatest = min(ends), max(ends)
    middle = base if math.isfinite(base) else least[0]
    for (figure, text), colour, side, shift in (
        (least, COLOURS[0], "right", -3),
        (greatest, COLOURS[1], "left", 3),
    ):
        panel.barh(place, figure - middle, 0.6, left=middle, color=colour)
        if least[0] < greatest[0]:
            panel.annotate(
                printable(text),
                (figure, place),
                (shift, 0),
                textcoords="offset points",
                ha=side,
                va="center",
                fontsize="small",
            )


def _figure(row: Row, measure: int) -> float:
    return math.inf if row.status == BROKEN else row.measures[measure]


def _reach(change: Change, base: float) -> float:
    if not all(map(math.isfinite, change.figures)):
        return math.inf
    known = [*change.figures, *([base] if math.isfinite(base) else [])]
    return max(known) - min(known)
