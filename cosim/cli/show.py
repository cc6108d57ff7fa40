"""``formation show``: the summary of a finished run, from its result."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from cosim.cli.console import out, report, safe, say, warn
from cosim.cli.options import refuse
from cosim.cli.summary import print_summary
from cosim.errors import FormationError, InputError, SimulationError
from cosim.results.files import load_run
from cosim.results.result import Result
from cosim.results.summary import PART, Summary, summary_of

if TYPE_CHECKING:
    from cosim.results.figure import Choice

EXPECTATION_FAILED, NOT_TO_THE_END, INTERRUPTED = 1, SimulationError.exit_status, 130


def show(options: argparse.Namespace) -> int:
    """Print the summary of each result and draw the figure if asked for; return the most serious exit status.

    The exit status equals the run's: 0 all expectations hold, 1 one failed, 3 it failed, 130 it was
    interrupted; 1 also if the result lacks samples of its run, 2 if there is no such result.
    """
    if options.figure is None:
        refuse(options, ("--panels",), "is about the figure: add --figure FILE.png, or leave it out")
    elif len(options.results) > 1:
        raise InputError(f"--figure {options.figure}: it draws one result: name one, not {len(options.results)}")
    return max(_shown(path, options.figure, options.panels) for path in options.results)


def _shown(path: Path, figure: Path | None, panels: Choice) -> int:
    try:
        result = load_run(path)
        summary = _summary(path, result)
        print_summary(out(), summary)
        if figure is not None:
            from cosim.results.figure import save_figure

            save_figure(result, figure, panels)
            out().print(safe(f"figure in {figure}"), soft_wrap=True)
    except FormationError as error:
        report(error)
        return error.exit_status
    if summary.status == PART:
        return EXPECTATION_FAILED
    if not summary.completed:
        failure = summary.provenance.failure
        if failure is not None and failure.left:
            say(out(), safe(f"{failure}: nothing is judged yet, and formation resume goes on"))
            return 0
        warn(f"the run ended early{f': {failure}' if failure else f', after {summary.end_time:.12g} s'}")
        return INTERRUPTED if failure is not None and failure.interrupted else NOT_TO_THE_END
    return 0 if summary.passed else EXPECTATION_FAILED


def _summary(path: Path, result: Result) -> Summary:
    try:
        return summary_of(result)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
