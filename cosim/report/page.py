"""The page of runs: one file that a browser shows without asking anybody for anything."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

from cosim.report.content import Json, content_of
from cosim.report.paths import with_distances
from cosim.report.study_content import study_of
from cosim.results.display_units import DISPLAYED
from cosim.results.files import write
from cosim.results.form import in_form
from cosim.results.result import Result
from cosim.results.summary import Summary

if TYPE_CHECKING:
    import xarray as xr

PAGE = "report.html"
"""Usual name of a page."""
STYLES = ("uPlot.min.css", "page.css")
OF_RUNS = (
    "uPlot.iife.min.js",
    "numbers.js",
    "scene.js",
    "playback.js",
    "panels.js",
    "tables.js",
    "differences.js",
    "runs.js",
)
SCRIPTS = (*OF_RUNS, "charts.js", "rows.js", "study.js", "page.js")
"""Files of the page, in the order in which they stand in it."""
_PLACE = re.compile(r"\{\{([a-z]+)\}\}")


def save_report(results: Sequence[xr.Dataset | Result], path: str | Path, summaries: Sequence[Summary] = ()) -> None:
    """Write the page of a run, or of several that are compared.

    Parameters
    ----------
    results
        The result of each run.
    path
        The file, ``report.html``.
    summaries
        The summary of each; without them, they are read from the results.

    Raises
    ------
    InputError
        A result is not that of a run, or it has no sample.
    OutputError
        The file cannot be written.
    """
    runs = with_distances(
        (arrays, content_of(arrays, summary))
        for arrays, summary in zip_longest((in_form(Result.of(one)) for one in results), summaries)
    )
    title = " against ".join(str(run["title"] or run["name"]) for run in runs)
    write(Path(path), page(title, {"runs": runs}).encode())


def save_study_report(folder: Path, path: Path) -> None:
    """Write the page of a study, from the files of its folder.

    Raises
    ------
    InputError
        The folder is not that of a study, or a file in it cannot be read.
    OutputError
        The file cannot be written.
    """
    study, runs = study_of(folder)
    write(path, page(study["title"] or study["name"], {"study": study, "runs": runs}).encode())


def page(title: str, data: Json, scripts: tuple[str, ...] = SCRIPTS, connect: str = "'none'") -> str:
    """Return the text of a page.

    Whatever comes from a run stands in it as data, in which no ``<`` is left, so no text can become markup; the page's
    script makes text of it and never markup. The policy lets nothing run but the script of the page.

    Parameters
    ----------
    title
        Its title.
    data
        What it shows: ``runs``, each as `content_of` returns it, and of a study ``study``. The script reads no other
        part of the page.
    scripts
        Its scripts.
    connect
        The only place that they may talk to, as a policy names it.
    """
    style, script = _assets(STYLES), _assets(scripts)
    parts = {
        "title": html.escape(title),
        "policy": (
            f"default-src 'none'; script-src '{_hash(script)}'; style-src '{_hash(style)}'; img-src data: blob:; "
            f"connect-src {connect}; base-uri 'none'; form-action 'none'"
        ),
        "style": style,
        "script": script,
        "data": _as_data({"units": DISPLAYED, **data}),
    }
    return _PLACE.sub(lambda place: parts[place[1]], _asset("page.html"))


def _as_data(value: object) -> str:
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    text = text.encode(errors="backslashreplace").decode()  # the name of a file may have bytes that are no text
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _hash(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


@cache
def _asset(name: str) -> str:
    return (files("cosim.report") / "assets" / name).read_text(encoding="utf-8")


@cache
def _assets(names: tuple[str, ...]) -> str:
    return "\n".join(_asset(name).strip() for name in names)
