"""What the pictures of all studies have in common: sizes, colours, and labels."""

from __future__ import annotations

from contextlib import AbstractContextManager

from matplotlib import rc_context
from matplotlib.axes import Axes

from cosim.errors import printable
from cosim.studies.row import FAILED, PASSED

WIDTH, HEIGHT = 3.7, 2.8
"""Of a panel [in]."""
LOOK = {PASSED: ("#0072b2", "o", "passed"), FAILED: ("#d55e00", "x", "failed")}
"""Colour, marker and word of each status: colours that the colour-blind can tell, and other markers."""
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
"""That the colour-blind can tell from each other; one a case."""
GREY, BOUND = "#999999", "black"
MOST_WORDS = 12
"""Words on an axis."""


def font() -> AbstractContextManager[None]:
    """Return the context in which figures are made and saved."""
    return rc_context({"font.size": 9.0})


def label(name: str, unit: str) -> str:
    """Return a name with its unit, as Matplotlib shows it."""
    return printable(f"{name} [{unit}]" if unit else name)


def number(value: object) -> str:
    """Return a value for a tick."""
    return f"{value:.4g}" if isinstance(value, float) else printable(str(value))


def note(panel: Axes, text: str) -> None:
    """Write a remark into the upper left corner of a panel."""
    panel.text(0.02, 0.97, text, transform=panel.transAxes, va="top", fontsize="small")
