"""Where the command line prints: colours and frames on a terminal, plain lines elsewhere."""

from __future__ import annotations

import errno
import io
import os
import re
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar, TextIO

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from cosim.cli.remedies import advice
from cosim.compiling import patience
from cosim.errors import FormationError, InputError, printable

_PLAIN_WIDTH = 160
_HANGING = 7
"""Columns by which the lines of a sentence after the first are indented: the length of a verdict and two spaces."""
PATIENCE = patience(3.0)
"""Seconds of silence, without a terminal, before a slow step is named."""


class _Tolerant(io.TextIOBase, TextIO):
    """A stream whose reader may be gone, whose disk may be full, or that may not know a character.

    Results must not depend on whether the output could be printed. What a disk has refused is told in the end.

    Attributes
    ----------
    refused : list of OSError
        Why standard output was not written, other than for want of a reader; the first error counts.
    """

    refused: ClassVar[list[OSError]] = []

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = stream if stream is not None else open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
        if isinstance(self._stream, io.TextIOWrapper):
            self._stream.reconfigure(errors="backslashreplace")

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self._stream.encoding or "ascii"

    def isatty(self) -> bool:
        return self._stream.isatty()

    def fileno(self) -> int:
        return self._stream.fileno()

    def write(self, text: str) -> int:
        try:
            self._stream.write(text)
        except OSError as error:
            self._give_up(error)
        return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        """Discard the rest, also output that the interpreter flushes when it ends."""
        if error.errno != errno.EPIPE and self._stream is sys.stdout:
            self.refused.append(error)
        os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())


class _Disarmed(_Tolerant):
    """A stream on which no text of others, such as the name of a file, can control a terminal or turn a line around.

    The escape character may be the console's own, so `safe` takes it out of texts.
    """

    def write(self, text: str) -> int:
        super().write(_CONTROL.sub("?", text))
        return len(text)


_CONTROL = re.compile("[\x80-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")


def out() -> Console:
    """Return the console of standard output, for the output of a command."""
    return _console(sys.stdout)


def err() -> Console:
    """Return the console of standard error, for errors, warnings and progress."""
    return _console(sys.stderr)


def refused() -> OSError | None:
    """Return why standard output could not be written since this was asked last; None if it was, or nobody reads it."""
    found = _Tolerant.refused[:1]
    _Tolerant.refused.clear()
    return found[0] if found else None


def verbatim(xml: str) -> None:
    """Print XML to standard output as it is; a character that its encoding lacks, as a character reference."""
    stream = _Tolerant(sys.stdout)
    stream.write(xml.encode(stream.encoding, "xmlcharrefreplace").decode(stream.encoding))
    stream.write("" if xml.endswith("\n") else "\n")
    stream.flush()


def table(console: Console, title: str) -> Table:
    """Return an empty table for a console."""
    return Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=box.ROUNDED if console.is_terminal else box.SIMPLE_HEAD,
    )


@contextmanager
def taking_a_while(message: str) -> Iterator[None]:
    """Name a slow step: on a terminal at once, elsewhere in a line after some seconds."""
    console, message = err(), safe(message)
    if console.is_terminal:
        with console.status(message):
            yield
        return
    timer = threading.Timer(PATIENCE, lambda: console.print(f"{message} ...", soft_wrap=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def say(console: Console, markup: str, style: str = "") -> None:
    """Print a sentence: on a terminal in lines that end between words and are indented from the second one on.

    Elsewhere it is one line, which programs read. What the user may copy, such as a path, is for `Console.print`.
    """
    if not console.is_terminal:
        console.print(markup, style=style, soft_wrap=True)
        return
    lines = Text.from_markup(markup, style=style, overflow="ignore").wrap(console, max(console.width - _HANGING, 20))
    for number, line in enumerate(lines):
        line.rstrip()
        console.print(Text(" " * _HANGING * (number > 0)) + line, soft_wrap=True)


def broken(name: str, width: int) -> str:
    """Return a long name in lines of at most some width where it can be broken after a separator of its words."""
    lines = [""]
    for part in re.findall(r"[^-.,_\[\]/ ]+[-.,_\]/ ]*|\[|[-.,_\]/ ]+", name):
        if lines[-1] and len(lines[-1]) + len(part) > width:
            lines.append("")
        lines[-1] += part
    return "\n".join(lines)


def report(error: FormationError) -> None:
    """Print an error the way compilers do, so that editors find the place."""
    if isinstance(error, InputError) and error.where:
        place, message = f"{error.where}: ", error.message
    else:
        place, message = "", str(error)
    err().print(f"{safe(place)}[bold red]error:[/] {safe(message + advice(error))}", soft_wrap=True)


def warn(message: str) -> None:
    """Print a warning."""
    err().print(f"[bold yellow]warning:[/] {safe(message)}", soft_wrap=True)


def safe(text: str) -> str:
    """Return a text of unknown origin as the consoles can print it, markup and control characters disarmed."""
    return escape(printable(text))


def _console(stream: TextIO | None) -> Console:
    tolerant = _Disarmed(stream)
    return Console(file=tolerant, highlight=False, width=None if tolerant.isatty() else _PLAIN_WIDTH)
