"""Full results of runs of a study: each run is made again as ``formation run`` makes it, in a folder of its own."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path

from cosim.errors import FormationError, OutputError, SimulationError
from cosim.master.other_runs import run_other
from cosim.master.setup import Setup, set_up, size_of_result
from cosim.master.supervised import whole_run
from cosim.results.files import save, write
from cosim.results.netcdf import attributes_of
from cosim.results.summary import summarise
from cosim.scenario.reader import read_scenario
from cosim.scenario.scenario import Scenario
from cosim.storage import Storage
from cosim.studies.conduct import StudyOutcome
from cosim.studies.plan import run_of
from cosim.studies.reproduce import as_variant
from cosim.studies.row import BROKEN, Row
from cosim.studies.study import Keep, Study

FOLDER = "kept"
_SCENARIO, _SUMMARY, _RESULT = "scenario.xml", "summary.json", "result.nc"
_KEY = "study_run"
"""The attribute of a result that has the key of its run."""


def keep_results(outcome: StudyOutcome, folder: Path) -> list[Path]:
    """Make the full results that the study keeps, as far as they are not there.

    Each is a folder with the run as a scenario, its summary, and its result, which is written last, whole or not at
    all. A run that could not begin has none.

    Parameters
    ----------
    outcome
        What has come of the study.
    folder
        The folder of the study.

    Returns
    -------
    list of Path
        The folders of the runs.

    Raises
    ------
    OutputError
        They cannot be written, or there is no room for them.
    RunInterrupted
        The user pressed Ctrl-C; the results so far are kept.
    """
    place = folder.absolute() / FOLDER
    _remove_others(place, outcome.rows)
    rows = kept_rows(outcome)
    missing = [row for row in rows if not (_of(place, row) / _RESULT).exists()]
    for index, row in enumerate(missing):
        try:
            _make(outcome.study, row, _of(place, row), len(missing) - index)
        except OutputError:
            raise
        except FormationError:  # its row says why it could not begin
            continue
    return [_of(place, row) for row in rows if (_of(place, row) / _RESULT).exists()]


def kept_rows(outcome: StudyOutcome) -> list[Row]:
    """Return the runs whose full results are kept, of those that were made."""
    chosen = {row.number for keep in outcome.study.keep for row in _rows(outcome, keep)}
    return [row for row in outcome.rows if row.number in chosen]


def _rows(outcome: StudyOutcome, keep: Keep) -> Iterator[Row]:
    if "all" in keep.words:
        yield from outcome.shown
    ranked = _ranked(outcome, keep.of)
    if "worst" in keep.words and ranked:
        yield ranked[0]
    if "median" in keep.words and ranked:
        yield ranked[len(ranked) // 2]
    for first, last in keep.ranges:
        yield from (row for row in outcome.rows if first <= row.number <= last)


def _ranked(outcome: StudyOutcome, of: int | None) -> list[Row]:
    """Return the runs, the worst first, by a measure that they have, or by their least margins."""
    if of is None:
        return sorted(outcome.shown, key=lambda row: (row.least, row.number))
    sign = -1.0 if outcome.study.measures[of].greatest_is_worst else 1.0
    ended = [row for row in outcome.shown if row.status != BROKEN]
    return sorted(ended, key=lambda row: (sign * row.measures[of], row.number))


def _of(place: Path, row: Row) -> Path:
    return place / f"run_{row.number}"


def _remove_others(place: Path, rows: Iterable[Row]) -> None:
    """Remove results of these numbers that are of other runs, such as before a change of the scenario."""
    for row in rows if place.is_dir() else ():
        here = _of(place, row)
        if here.is_dir() and _key(here / _RESULT) != row.key:
            for name in (_RESULT, _SUMMARY, _SCENARIO):
                (here / name).unlink(missing_ok=True)


def _key(path: Path) -> str:
    try:
        return str(attributes_of(path).get(_KEY, ""))
    except OSError:  # none that is whole
        return ""


def _make(study: Study, row: Row, here: Path, runs: int) -> None:
    """Make one result; so many of its size shall find room."""
    run = run_of(study, row.number, row.draw, row.values)
    text = as_variant(study, run, here)
    try:
        here.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{here} cannot be made: {error.strerror}") from None
    write(here / _SCENARIO, text.encode())
    scenario = read_scenario(here / _SCENARIO)
    with ExitStack() as cleanup:
        setup = set_up(scenario, cleanup, {}, storage=Storage(here))
        _check_room(scenario, setup, here, runs)
        simulation = whole_run(scenario, setup)
        cleanup.callback(simulation.close)
        try:
            result = simulation.run_to_end()
        except SimulationError as error:
            if error.recorded is None:
                raise
            result = error.recorded
        summary = summarise(scenario, result, partial(run_other, simulation.setup))
        told = {"verdicts": summary.verdicts_as_json()} if summary.verdicts else {}
        write(here / _SUMMARY, summary.to_json().encode())
        save(replace(result, attrs={**result.attrs, **told, _KEY: row.key}), here / _RESULT)


def _check_room(scenario: Scenario, setup: Setup, here: Path, runs: int) -> None:
    needed, free = runs * size_of_result(scenario, setup.result_variables), shutil.disk_usage(here).free
    if needed > free:
        raise OutputError(
            f"the full results of {runs} runs need {needed / 1e9:.3g} GB, and {here.parent} has room for "
            f"{free / 1e9:.3g} GB: ask for fewer runs, or give another folder"
        )
