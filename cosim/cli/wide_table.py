"""Tables with many columns: what is too wide for the terminal is cut into tables one below another.

The columns that say what a row is about are in each of them, and nothing is left out.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from rich.cells import cell_len
from rich.console import Console

from cosim.cli.console import broken, safe, table

_SHARE = 0.55
"""Of the width of a terminal: what names may take if not all columns have room."""


@dataclass(frozen=True)
class WideColumn:
    """A column of texts.

    Attributes
    ----------
    heading : str
        Its heading, which may have several lines.
    cells : sequence of str
        One a row.
    is_name : bool
        Whether its cells are names, at the left, which may be broken where the terminal is narrow.
    """

    heading: str
    cells: Sequence[str]
    is_name: bool = False

    @property
    def width(self) -> int:
        """The length of its longest line."""
        return max(cell_len(line) for text in (self.heading, *self.cells) for line in text.split("\n"))


def print_wide(
    console: Console,
    title: str,
    kept: Sequence[WideColumn],
    others: Sequence[WideColumn],
    ends: Collection[int] = (),
) -> None:
    """Print a table, of which some columns are kept side by side with as many of the others as there is room for.

    Parameters
    ----------
    title
        Its title, as markup.
    ends
        The rows that end a section.
    """
    if title:
        console.print(f"[bold]{title}[/]")
    if not _fits([*kept, *others], console.width):
        kept = _narrowed(kept, int(_SHARE * console.width))
    for part in _parts(kept, others, console.width):
        columns = [*kept, *part]
        shown = table(console, "")
        for column in columns:
            heading = _safe(column.heading)
            if column.is_name:
                shown.add_column(heading, overflow="fold")
            else:
                shown.add_column(heading, justify="right", no_wrap=True)
        for number, cells in enumerate(zip(*(column.cells for column in columns), strict=True)):
            shown.add_row(*map(_safe, cells), end_section=number in ends)
        console.print(shown)


def _narrowed(columns: Sequence[WideColumn], room: int) -> list[WideColumn]:
    """Return columns with their names broken so that they have room together, the longest ones first."""
    found = list(columns)
    open_ones = {place for place, column in enumerate(found) if column.is_name}
    while open_ones and not _fits(found, room):
        longest = max(open_ones, key=lambda place: found[place].width)
        limit = found[longest].width - 1
        narrower = replace(
            found[longest],
            heading=broken(columns[longest].heading, limit),
            cells=[broken(text, limit) for text in columns[longest].cells],
        )
        if narrower.width > limit:  # its longest word
            open_ones.remove(longest)
        else:
            found[longest] = narrower
    return found


def _parts(kept: Sequence[WideColumn], others: Sequence[WideColumn], room: int) -> Iterator[list[WideColumn]]:
    """Yield as many of the other columns at a time as have room beside those that are kept; one at least."""
    part: list[WideColumn] = []
    for column in others:
        if part and not _fits([*kept, *part, column], room):
            yield part
            part = []
        part.append(column)
    yield part


def _fits(columns: Sequence[WideColumn], room: int) -> bool:
    """Return whether columns have room with what is between and around them."""
    return sum(column.width + 3 for column in columns) + 1 <= room


def _safe(text: str) -> str:
    return "\n".join(map(safe, text.split("\n")))
