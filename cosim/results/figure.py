"""A result as a picture: the paths, the robots to scale, and each quantity of the run over time."""

from __future__ import annotations

import io
import math
import textwrap
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from cosim.errors import InputError, printable
from cosim.results.bands import bands_of
from cosim.results.colours import BAD, GOOD
from cosim.results.drawable_part import drawable
from cosim.results.expectations.shown import Band
from cosim.results.figure_panels import MANY, MOST_LINES, Place, draw_panels
from cosim.results.figure_paths import draw_formation, draw_paths
from cosim.results.figure_style import LEADER, Colour, colours_of
from cosim.results.files import write
from cosim.results.form import in_form
from cosim.results.panels import Panel, panels, paper_panels
from cosim.results.provenance import Provenance
from cosim.results.representative import representative
from cosim.results.result import Result

if TYPE_CHECKING:
    import xarray as xr

Choice = Literal["all", "paper"]
"""Panels of all that a run has, or those of the paper's Figure 6."""

_MOST_PANELS = 30
_MOST_NAMES, _LONGEST_NAME, _LETTERS = 12, 24, 165
"""Followers in the legend, letters of a name there, and of a line."""
_WIDTH, _LEFT, _RIGHT = 13.0, 0.55, 0.12
"""The figure, room for the numbers beside a panel, and the margin [in]: a computed layout takes as long as drawing."""
_PATHS, _TITLE, _GAP, _BOTTOM = 4.6, 0.27, 0.45, 0.72
"""Height of the paths, of a panel's title, of the numbers below the paths, and of all below the last panel [in]."""
_LINE, _NOTE = 0.24, 0.15
"""Height of a line above the panels and below them [in]."""
_LEGEND: Mapping[str, Any] = {
    "loc": "upper center",
    "frameon": False,
    "fontsize": 9,
    "handlelength": 1.6,
    "columnspacing": 1.2,
    "borderaxespad": 0,
    "borderpad": 0.1,
}


def save_figure(result: xr.Dataset | Result, path: str | Path, panels: Choice = "all") -> None:
    """Draw a result and write it as PNG.

    Parameters
    ----------
    result
        Of a run, complete or not.
    path
        The file.
    panels
        ``all``: what the run has, of any law and kind of vehicle; ``paper``: the panels of the paper's Figure 6.

    Raises
    ------
    InputError
        It is not the result of a run, it holds no sample, or there are no such panels.
    OutputError
        The file cannot be written.
    """
    result = representative(in_form(Result.of(result)))
    if not result.sizes["time"]:
        raise InputError("the result holds no sample, so there is nothing to draw")
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # a title in letters that the font lacks
        figure = draw(result, panels)
        figure.savefig(buffer, format="png", dpi=120, pil_kwargs={"compress_level": 1})  # others take longer
    write(Path(path), buffer.getbuffer())


def draw(result: xr.Dataset | Result, choice: Choice = "all") -> Figure:
    """Return the figure of a result: the paths, the formation at some instants, and panels over time.

    Above them stand the changes of the scenario and the reason of an early end, below them seed and versions.
    """
    if (sheet := _SHEETS.get(choice)) is None:
        raise InputError(f"there are no panels {choice!r}: expected is one of {', '.join(_SHEETS)}")
    whole = Result.of(result)
    drawn = drawable(whole)
    shown, notes = sheet.panels(drawn)
    if _has_gaps(whole, drawn):
        notes.insert(0, "diverged values are not drawn")
    notes = [line for note in notes for line in textwrap.wrap(printable(note), 220, max_lines=2, placeholder=" ...")]
    above = _title(drawn)
    colours = colours_of(len(drawn.robots))
    bands = [band for band in bands_of(drawn) if band.signal in {panel.signal for panel in shown}]
    legend = _legend(drawn.robots, colours, bands)

    top = 0.2 + _LINE * (len(above) + len(legend))
    across = (_WIDTH - _RIGHT) / sheet.columns
    first = top + _PATHS + _GAP
    last = first + math.ceil(len(shown) / sheet.columns) * (_TITLE + sheet.height)
    height = last + _BOTTOM + _NOTE * len(notes)
    figure = Figure(figsize=(_WIDTH, height))

    def axes(left: float) -> Axes:
        """Return axes for paths, from a place [in] on."""
        made = figure.add_axes(
            (
                (left + _LEFT) / _WIDTH,
                1 - (top + _PATHS) / height,
                ((_WIDTH - _RIGHT) / 2 - _LEFT) / _WIDTH,
                (_PATHS - _TITLE) / height,
            )
        )
        made.tick_params(labelsize=8, pad=2)
        made.spines[["top", "right"]].set_visible(False)
        return made

    figure.suptitle("\n".join(above), fontsize=12, y=1 - 0.1 / height, parse_math=False)
    below = "\n".join([Provenance.of(whole.attrs).basis, *notes])
    figure.supxlabel(below, fontsize=8, y=0.08 / height, color="dimgrey", parse_math=False)
    for number, line in enumerate(legend):
        y = 1 - (0.16 + _LINE * (len(above) + number)) / height
        for text in figure.legend(handles=line, bbox_to_anchor=(0.5, y), ncols=len(line), **_LEGEND).get_texts():
            text.set_parse_math(False)
    draw_paths(axes(0.0), sheet.titles[0], drawn, colours)
    draw_formation(axes((_WIDTH - _RIGHT) / 2), sheet.titles[1], drawn, colours)

    places = []
    for number in range(len(shown)):
        row, column = divmod(number, sheet.columns)
        upper = first + row * (_TITLE + sheet.height) + _TITLE
        last_in_column = number + sheet.columns >= len(shown)
        places.append(Place(column * across + _LEFT, upper, across - _LEFT, sheet.height, last_in_column))
    canvas = figure.add_axes((0, 0, 1, 1), xlim=(0, _WIDTH), ylim=(height, 0), frameon=False, zorder=-1)
    canvas.set_axis_off()
    failure = Provenance.of(whole.attrs).failure
    failed = None if failure is None else failure.time
    draw_panels(canvas, list(zip(shown, places, strict=True)), _span(drawn, failed), colours, bands, failed)
    return figure


def _title(result: Result) -> list[str]:
    """Return the lines above the panels."""
    provenance = Provenance.of(result.attrs)
    title = f"{result.attrs['title']} ({result.attrs['scenario_name']})"
    if result.attrs["status"] != "completed":
        title += f", recorded up to {result['time'].values[-1]:.12g} s"
    further = [provenance.changed] if provenance.changes else []
    if provenance.failure:
        further.append(printable(str(provenance.failure)))
    wrapped = (part for line in further for part in textwrap.wrap(line, 120, max_lines=3, placeholder=" ..."))
    return [title, *wrapped]


def _legend(robots: Sequence[str], colours: Sequence[Colour], bands: Sequence[Band]) -> list[list[Artist]]:
    """Return the lines that name the leader, the followers, of many followers some, and what is shaded."""
    entries: list[Artist] = [Line2D([], [], color=LEADER, linestyle="--", label="leader")]
    chosen = np.unique(np.linspace(0, len(robots) - 1, min(len(robots), _MOST_NAMES)).round().astype(int))
    for row in chosen.tolist():
        name = printable(robots[row])
        shown = name if len(name) <= _LONGEST_NAME else f"{name[: _LONGEST_NAME - 3]}..."
        entries.append(Line2D([], [], color=colours[row], label=shown))
    if len(robots) > MOST_LINES:
        entries.append(Patch(color=MANY, alpha=0.5, label=f"{len(robots)} followers: all, 80 %, median"))
    limits = [band.inside for band in bands if math.isfinite(band.lower) or math.isfinite(band.upper)]
    for inside, colour, label in ((True, GOOD, "expected"), (False, BAD, "singular")):
        if inside in limits:
            entries.append(Patch(facecolor=to_rgba(colour, 0.13), edgecolor=colour, label=label))
    letters = [len(str(entry.get_label())) + 6 for entry in entries]
    lines: list[list[Artist]] = [[]]
    length = 0
    for entry, own in zip(entries, letters, strict=True):
        if length + own > _LETTERS:
            lines.append([])
            length = 0
        lines[-1].append(entry)
        length += own
    return lines


def _all(result: Result) -> tuple[Sequence[Panel], list[str]]:
    """Return the panels of what changes in a run, and what to say about others: constants, and too many."""
    found = panels(result)
    constant = [panel.title for panel in found if panel.constant]
    changing = [panel for panel in found if not panel.constant]
    notes = [f"constant: {', '.join(constant)}"] if constant else []
    if further := changing[_MOST_PANELS:]:
        notes.append(f"in the result, but not here: {', '.join(panel.title for panel in further)}")
    return changing[:_MOST_PANELS], notes


def _paper(result: Result) -> tuple[Sequence[Panel], list[str]]:
    return paper_panels(result), []


@dataclass(frozen=True)
class _Sheet:
    """A choice of panels: the titles of the paths, the panels below, how many stand in a row, and their height [in]."""

    titles: tuple[str, str]
    panels: Callable[[Result], tuple[Sequence[Panel], list[str]]]
    columns: int
    height: float


_SHEETS: Mapping[Choice, _Sheet] = {
    "all": _Sheet(("paths", "formation, enlarged"), _all, 3, 1.1),
    "paper": _Sheet(("(a) paths", "(b) formation, enlarged"), _paper, 2, 1.35),
}


def _span(result: Result, failed: float | None) -> tuple[float, float]:
    """Return the times [s] at the ends of all panels; when the run failed is between them."""
    start, stop = (float(result["time"].values[end]) for end in (0, -1))
    stop = stop if failed is None else max(stop, failed)
    margin = 0.01 * (stop - start) or 0.5
    return start - margin, stop + margin


def _has_gaps(whole: Result, drawn: Result) -> bool:
    """Return whether numbers of a result are not drawn."""
    courses = (name for name, signal in whole.data_vars.items() if signal.dims[:1] == ("time",))
    return any(_missing(drawn[name].values) > _missing(whole[name].values) for name in courses)


def _missing(values: NDArray[np.float64]) -> int:
    return int(np.isnan(values).sum())
