"""What the pictures of all studies have in common: sizes, colours, and labels."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from contextlib import AbstractContextManager

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from cosim.errors import printable
from cosim.studies.row import FAILED, PASSED
from cosim.studies.study import Requirement

WIDTH, HEIGHT = 3.7, 2.8
"""Of a panel [in]."""
LOOK = {PASSED: ("#0072b2", "o", "passed"), FAILED: ("#d55e00", "x", "failed")}
"""Colour, marker and word of each status: colours that the colour-blind can tell, and other markers."""
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
"""That the colour-blind can tell from each other; one a case."""
GREY, BOUND = "#999999", "black"
_ROOM = 36
"""Characters that are beside each other below a panel."""
MOST_WORDS = 12
"""Words on an axis."""


def font() -> AbstractContextManager[None]:
    """Return the context in which figures are made and saved."""
    return rc_context({"font.size": 9.0})


def png(figure: Figure) -> bytes:
    """Return a figure as PNG."""
    buffer = io.BytesIO()
    with font():
        figure.savefig(buffer, format="png", dpi=130, pil_kwargs={"compress_level": 1})
    return buffer.getvalue()


def label(name: str, unit: str) -> str:
    """Return a name with its unit, as Matplotlib shows it."""
    return printable(f"{name} [{unit}]" if unit else name)


def draw_bound(panel: Axes, requirement: Requirement, at: float, *, across: bool) -> None:
    """Draw a bound as a line across or up a panel; beside one that is of some runs alone stands of which."""
    (panel.axhline if across else panel.axvline)(at, color=BOUND, linestyle="--", linewidth=1)
    if not requirement.given:
        return
    place, along = ((1.0, at), panel.get_yaxis_transform()) if across else ((at, 1.0), panel.get_xaxis_transform())
    panel.annotate(
        printable(requirement.given_in_words),
        place,
        xycoords=along,
        textcoords="offset points",
        xytext=(-2, 2) if across else (-2, -3),
        rotation=0 if across else 90,
        ha="right",
        va="bottom" if across else "top",
        fontsize="x-small",
        parse_math=False,
    )


def number(value: object) -> str:
    """Return a value for a tick."""
    return f"{value:.4g}" if isinstance(value, float) else printable(str(value))


def word_ticks(panel: Axes, words: Sequence[str]) -> None:
    """Put words on the horizontal axis, at 0, 1, 2 and so on."""
    panel.set_xticks(range(len(words)), [printable(word) for word in words])
    slant(panel, words)


def slant(panel: Axes, texts: Sequence[str]) -> None:
    """Turn the labels of the horizontal axis if they would touch each other."""
    if max(map(len, texts), default=0) * len(texts) > _ROOM:
        for text in panel.get_xticklabels():
            text.set(rotation=40, ha="right", rotation_mode="anchor")


def few_ticks(panel: Axes, values: NDArray[np.float64]) -> None:
    """Give a horizontal axis so few numbers that long ones do not touch; whole ones where all values are whole."""
    known = values[np.isfinite(values)]
    whole = bool(len(known)) and bool((known == np.round(known)).all())
    panel.xaxis.set_major_locator(MaxNLocator(5, integer=whole))


def is_log(at: NDArray[np.float64]) -> bool:
    """Return whether values lie at equal ratios rather than at equal distances, over a factor of ten or more."""
    known = np.unique(at[np.isfinite(at)])
    if len(known) < 3 or known[0] <= 0.0 or known[-1] < 10.0 * known[0]:
        return False
    middle = float(np.median(known))
    return abs(math.log(middle / math.sqrt(known[0] * known[-1]))) < abs(
        math.log(middle / (0.5 * (known[0] + known[-1])))
    )


def note(panel: Axes, text: str) -> None:
    """Write a remark above a panel, where it covers nothing."""
    panel.set_title(text, fontsize="small", loc="left")
