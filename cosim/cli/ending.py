"""How a command, or one of its scenarios, ends early: one sentence and an exit status, whatever has happened."""

from __future__ import annotations

import sys

from cosim.cli.console import report
from cosim.errors import FormationError, InputError, Location, printable
from cosim.unforeseen import foreseen, status_of


def ended_by(error: BaseException, about: object = "", *, several: bool = False) -> tuple[FormationError, int]:
    """Print the error that has ended something; return it as a user sees it, with its exit status.

    Parameters
    ----------
    error
        Anything but an interruption.
    about
        The file whose turn it was; empty if it was no file's.
    several
        Whether it is one of several files: an error without a place is then shown with that file.
    """
    shown = foreseen(error, str(about))
    if several and isinstance(shown, InputError) and shown.where is None:
        shown.where = Location(str(about))
    try:
        report(shown)
    except Exception:  # what prints it is broken, too
        print(f"error: {printable(str(shown))}", file=sys.stderr)
    return shown, status_of(shown)
