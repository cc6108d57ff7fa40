"""The picture of a study, from its table alone. What varies decides what it shows.

Of a sensitivity, what each measure depends on; of one value at a time, a tornado; of any other study how each measure
is spread, and beside it a curve over a single value, a map over a grid of two, or each run over each value.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cosim.errors import printable
from cosim.studies.conduct import StudyOutcome
from cosim.studies.figure_sensitivity import changes_of, draw_sensitivity, draw_tornado
from cosim.studies.figure_spread import draw_spread
from cosim.studies.figure_style import COLOURS, HEIGHT, MOST_WORDS, WIDTH, font, png
from cosim.studies.figure_values import draw_bounds, draw_curves, draw_map, draw_runs
from cosim.studies.row import Row
from cosim.studies.study import Measured, Vary
from cosim.studies.summary import counts
from cosim.studies.table import Column, columns
from cosim.studies.values import Count, Finite

Panel: TypeAlias = Callable[[Axes], None]
_MOST_MEASURES, _MOST_VALUES = 6, 3
"""Rows of panels, and varied values or cases in a row."""


def picture(outcome: StudyOutcome) -> bytes:
    """Return the picture as PNG; see `draw`."""
    return png(draw(outcome))


def draw(outcome: StudyOutcome) -> Figure:
    """Return the figure: a row for each measure."""
    rows = [row[: _MOST_VALUES + 1] for row in _rows(outcome)[:_MOST_MEASURES]]
    across = max(map(len, rows), default=1)
    with font():
        figure = Figure(figsize=(max(across * WIDTH, 5.0), max(len(rows), 1) * HEIGHT + 0.6), layout="constrained")
        title = printable(f"{outcome.study.name}: {outcome.study.title}")
        ends = ", ".join(f"{number} {status}" for status, number in counts(outcome).items())
        told = [*textwrap.wrap(title, max(round(figure.get_figwidth() * 13), 40)), f"{len(outcome.rows)} runs: {ends}"]
        figure.suptitle("\n".join(told), parse_math=False)
        panels = figure.subplots(max(len(rows), 1), across, squeeze=False)
        if not rows:
            panels[0, 0].axis("off")
            panels[0, 0].text(0.5, 0.5, "the study has no measure", ha="center")
        for places, row in zip(panels, rows, strict=False):
            for panel in places[len(row) :]:
                panel.axis("off")
            for panel, drawn in zip(places, row, strict=False):
                drawn(panel)
    return figure


def _rows(outcome: StudyOutcome) -> list[list[Panel]]:
    """Return what draws each panel: of each measure, from left to right."""
    if outcome.sensitivities:
        return _of_sensitivity(outcome)
    if outcome.study.sample.method == "one_at_a_time":
        return _tornados(outcome)
    return _over_values(outcome)


# Sensitivities ------------------------------------------------------------------------------------------------


def _of_sensitivity(outcome: StudyOutcome) -> list[list[Panel]]:
    """Return bars for each case; of a single one, also each run over the most important value."""
    found = outcome.sensitivities
    table = _table(outcome)
    rows = []
    for measure in dict.fromkeys(one.measure for one in found):
        own = [one for one in found if one.measure == measure]
        bars = partial(draw_sensitivity, method=outcome.study.sample.method)
        row: list[Panel] = [_titled(", ".join(one.cases), partial(bars, one=one)) for one in own]
        if len(own) == 1 and own[0].figures and measure != "passed":
            row.append(_runs(table, measure, own[0].names[own[0].order()[0]]))
        rows.append(row)
    return rows


def _tornados(outcome: StudyOutcome) -> list[list[Panel]]:
    """Return a tornado for each case."""
    study = outcome.study
    crossed = [index for index, vary in enumerate(study.vary) if vary.crossed]
    groups: dict[tuple[str | None, ...], list[Row]] = {}
    for one in outcome.rows:
        groups.setdefault(tuple(one.values[index] for index in crossed), []).append(one)
    rows = []
    for number, measured in enumerate(study.measures):
        row: list[Panel] = []
        for case, own in groups.items():
            base, changes = changes_of(study, own, number)
            drawn = partial(draw_tornado, measured=measured, base=base, changes=changes)
            row.append(_titled(", ".join(map(str, case)), drawn))
        rows.append(row)
    return rows


# Measures over values -----------------------------------------------------------------------------------------


def _over_values(outcome: StudyOutcome) -> list[list[Panel]]:
    """Return how each measure is spread, and how it depends on what varies."""
    study, table = outcome.study, _table(outcome)
    axes = [vary for vary in study.vary if _can_be_an_axis(vary, table[vary.name])]
    numbers = [vary for vary in axes if not _has_words(table[vary.name])]
    words = [vary for vary in axes if _has_words(table[vary.name])]
    cases = _cases(outcome, table, words)
    a_curve = len(numbers) == 1 and isinstance(numbers[0].values, Finite) and study.sample.method != "one_at_a_time"
    a_map = len(axes) == 2 and study.sample.method == "grid"
    rows = []
    for measured in study.measures:
        figures = np.array(table[measured.name].values, dtype=np.float64)
        spread = {name: figures[own] for name, own in cases.items()}
        row: list[Panel] = [partial(draw_spread, outcome=outcome, measured=measured, cases=spread)]
        over = partial(_draw_over, outcome=outcome, measured=measured, table=table, figures=figures)
        if a_curve and (not words or len(cases) > 1):
            row.append(partial(over, curve=numbers[0], cases=cases))
        elif a_map:
            row.append(partial(over, grid=axes))
        else:
            row += [_runs(table, measured.name, vary.name) for vary in axes]
        rows.append(row)
    return rows


def _draw_over(
    panel: Axes,
    outcome: StudyOutcome,
    measured: Measured,
    table: Mapping[str, Column],
    figures: NDArray[np.float64],
    curve: Vary | None = None,
    grid: Sequence[Vary] = (),
    cases: Mapping[str, NDArray[np.bool_]] | None = None,
) -> None:
    """Draw a curve or a map; a run that is broken is as bad as one without a figure."""
    known = np.where(np.isnan(figures), math.inf if measured.greatest_is_worst else -math.inf, figures)
    if curve is None:
        draw_map(panel, table[measured.name], [table[vary.name] for vary in grid], known, measured.greatest_is_worst)
        return
    draw_curves(panel, table[measured.name], table[curve.name], cases or {}, known)
    draw_bounds(panel, outcome, measured)


def _runs(table: Mapping[str, Column], measure: str, value: str) -> Panel:
    """Return what draws each run over a value."""
    figures = np.array(table[measure].values, dtype=np.float64)
    statuses = np.array(table["status"].values)
    return partial(draw_runs, measure=table[measure], value=table[value], figures=figures, statuses=statuses)


def _cases(outcome: StudyOutcome, table: Mapping[str, Column], words: Sequence[Vary]) -> dict[str, NDArray[np.bool_]]:
    """Return which runs each combination of words has; all runs together if there are too many to tell apart."""
    names = [" ".join(map(str, own)) for own in zip(*(table[vary.name].values for vary in words), strict=True)]
    different = list(dict.fromkeys(names))
    if not 1 < len(different) <= len(COLOURS):
        return {"": np.ones(len(outcome.rows), dtype=bool)}
    return {name: np.array([own == name for own in names]) for name in different}


def _can_be_an_axis(vary: Vary, column: Column) -> bool:
    """Return whether a varied value is a number, or one of a few words, and no seed, which just repeats a run."""
    if isinstance(vary.values, Count) or (
        vary.targets and all(target.select.endswith("@seed") for target in vary.targets)
    ):
        return False
    different = len(set(column.values))
    return different > 1 and (different <= MOST_WORDS or not _has_words(column))


def _has_words(column: Column) -> bool:
    return all(isinstance(value, str) for value in column.values)


def _table(outcome: StudyOutcome) -> dict[str, Column]:
    return {column.name: column for column in columns(outcome)}


def _titled(title: str, drawn: Callable[..., None]) -> Panel:
    def draw_titled(panel: Axes) -> None:
        drawn(panel)
        if title:
            panel.set_title(printable(title), fontsize="medium", loc="left", parse_math=False)

    return draw_titled
