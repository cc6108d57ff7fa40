"""``formation report``: the page of finished runs, or of a study, from their results."""

from __future__ import annotations

import argparse
from pathlib import Path

from cosim.cli.console import out, safe
from cosim.errors import InputError
from cosim.report.page import PAGE, save_report, save_study_report
from cosim.report.study_content import is_study
from cosim.results.files import load_run


def report(options: argparse.Namespace) -> int:
    """Write the page of a result or of a study beside it, or one page in which several results are compared."""
    path: Path = options.out or _usual_place(options.results)
    if path.suffix not in (".html", ".htm"):
        raise InputError(f"--out {path}: a browser takes it for a page only if its name ends with .html: name it so")
    studies = [place for place in options.results if is_study(place)]
    if studies and len(options.results) > 1:
        raise InputError(f"{studies[0]} is the folder of a study, which has a page of its own: give it alone")
    if studies:
        save_study_report(studies[0], path)
    else:
        save_report([load_run(result) for result in options.results], path)
    out().print(safe(f"page in {path}: open it in a browser"), soft_wrap=True)
    return 0


def _usual_place(results: list[Path]) -> Path:
    if len(results) > 1:
        return Path(PAGE)
    [result] = results
    return (result if result.is_dir() else result.parent) / PAGE
