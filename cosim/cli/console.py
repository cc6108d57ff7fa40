"""Where the command line prints: colours and frames on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from cosim.errors import FormationError, InputError

_PLAIN_WIDTH = 160


def out() -> Console:
    """Return the console of standard output, for what the user asked for."""
    return Console(highlight=False, width=None if sys.stdout.isatty() else _PLAIN_WIDTH)


def err() -> Console:
    """Return the console of standard error, for errors, warnings and progress."""
    return Console(stderr=True, highlight=False, width=None if sys.stderr.isatty() else _PLAIN_WIDTH)


def table(title: str) -> Table:
    """Return an empty table."""
    return Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=box.ROUNDED if sys.stdout.isatty() else box.SIMPLE_HEAD,
    )


def report(error: FormationError) -> None:
    """Print an error the way compilers do, so that editors find the place."""
    if isinstance(error, InputError) and error.where:
        place, message = f"{error.where}: ", error.message
    else:
        place, message = "", str(error)
    err().print(f"{escape(place)}[bold red]error:[/] {escape(message)}", soft_wrap=True)


def warn(message: str) -> None:
    """Print a warning."""
    err().print(f"[bold yellow]warning:[/] {escape(message)}", soft_wrap=True)
