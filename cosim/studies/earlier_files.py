"""Takes the files of an earlier study out of the way before a run of a new one begins, so that none is taken for its.

The rows stay, and so do full results of the same runs.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

from cosim.errors import OutputError
from cosim.studies.kept_run import RESULT, SCENARIO, key_in
from cosim.studies.row import Row

SUMMARY, TABLE, CASES, TRIALS = "summary.json", "runs.nc", "cases.csv", "trials.csv"
KEPT, TO_SEE = "kept", "runs_to_see"
BEFORE = "files.before"
"""The files of an earlier study, until those of a new one are complete."""
_FILES = (SUMMARY, TABLE, "runs.csv", CASES, TRIALS, "figure.png", "envelope.png", "report.html")
"""Files that are made from the rows; the summary is moved first, as it has the verdict."""


def mark_of(text: str, rows: Iterable[Row]) -> str:
    """Return a mark of a study's text and runs; files with the same one belong together."""
    digest = hashlib.sha256(text.encode())
    for row in rows:
        digest.update(f" {row.key}".encode())
    return digest.hexdigest()[:16]


def set_aside(folder: Path) -> None:
    """Move all files of a study that are made from its rows to `BEFORE`, in place of those of another one.

    Raises
    ------
    OutputError
        They cannot be moved.
    """
    names = list(_made(folder))
    if not names:
        return
    try:
        shutil.rmtree(folder / BEFORE, ignore_errors=True)
        _move(names, folder, folder / BEFORE)
    except OSError as error:
        raise OutputError(f"the files of an earlier study in {folder} cannot be set aside: {error.strerror}") from None


def take_back(folder: Path, mark: str) -> None:
    """Move the files in `BEFORE` back if they have a mark: the study and its runs are the same."""
    before = folder / BEFORE
    if _told(before).get("mark") != mark:
        return
    try:
        _move(reversed(list(_made(before))), before, folder)  # the summary last, as it has the verdict
    except OSError as error:
        raise OutputError(f"the files of the study in {before} cannot be put back: {error.strerror}") from None
    shutil.rmtree(before, ignore_errors=True)


def replaced(folder: Path, mark: str) -> None:
    """Remove the files of an earlier study, as there are new ones with a mark; another command may have moved these."""
    if _told(folder / BEFORE).get("mark") != mark:
        shutil.rmtree(folder / BEFORE, ignore_errors=True)


def remove_other_results(folder: Path, rows: Iterable[Row]) -> None:
    """Remove full results under the numbers of rows that are of other runs, such as before a change of the scenario."""
    for row in rows if (folder / KEPT).is_dir() else ():
        here = folder / KEPT / f"run_{row.number}"
        if here.is_dir() and key_in(here) != row.key:
            for name in (RESULT, SUMMARY, SCENARIO):
                (here / name).unlink(missing_ok=True)


def tuned_name(case: str) -> str:
    """Return the name of the file with the best values of a case, a scenario, without its suffix."""
    return "-".join(["tuned", *case.split()])


def _made(folder: Path) -> Iterator[str]:
    """Return the names of the files that are there, of those that are made from the rows; others are the user's."""
    yield from (name for name in (*_FILES, *_tuned(folder)) if (folder / name).is_file())
    yield from (f"{TO_SEE}/{path.name}" for path in (folder / TO_SEE).glob("run_*.xml"))


def _tuned(folder: Path) -> list[str]:
    found = _told(folder).get("tuned")
    cases = [one.get("case") for one in found if isinstance(one, dict)] if isinstance(found, list) else []
    names = [f"{tuned_name(case)}.xml" for case in cases if isinstance(case, str)]
    return [name for name in names if name == os.path.basename(name) and "\0" not in name]


def _told(folder: Path) -> dict[str, object]:
    """Return the summary of a study; empty if there is none."""
    try:
        told = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return told if isinstance(told, dict) else {}


def _move(names: Iterable[str], folder: Path, place: Path) -> None:
    for name in names:
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(folder / name, place / name)
