"""Full results of runs of a study: which runs have them, and what makes those that are missing."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from pathlib import Path

from cosim.errors import FormationError, OutputError
from cosim.results.files import write
from cosim.studies.conduct import StudyOutcome
from cosim.studies.crews import processes, usual_workers
from cosim.studies.earlier_files import KEPT
from cosim.studies.kept_run import RESULT, SCENARIO, KeptRun
from cosim.studies.plan import run_of
from cosim.studies.reproduce import as_variant
from cosim.studies.row import BROKEN, Row
from cosim.studies.study import Keep
from cosim.studies.worker_process import Ended, Processes
from cosim.unforeseen import lack_of

_WORTHWHILE = 5.0
"""Time [s] of runs for which processes are worth their start."""


def keep_results(outcome: StudyOutcome, folder: Path, workers: int | None = None) -> list[Path]:
    """Make the full results that the study keeps, as far as they are not there.

    Each is a folder with the run as a scenario, its summary, and its result, which is written last, whole or not at
    all. A run that could not begin has none.

    Parameters
    ----------
    outcome
        What has come of the study.
    folder
        The folder of the study.
    workers
        How many are made at a time, in processes of this machine; without it, one a processor. 0: this process makes
        them, as it does if there is little to do.

    Returns
    -------
    list of Path
        The folders of the runs.

    Raises
    ------
    OutputError
        They cannot be written, or there is no room for them.
    KeyboardInterrupt
        The user pressed Ctrl-C; the results so far are kept.
    """
    place = folder.absolute() / KEPT
    rows = kept_rows(outcome)
    missing = [row for row in rows if not (_of(place, row) / RESULT).exists()]
    count = usual_workers() if workers is None else workers
    usual = 0.0
    while missing:
        if count > 1 and usual * (len(missing) - 1) > _WORTHWHILE:
            _make_elsewhere(outcome, missing, place, usual, count)
            break
        began = time.perf_counter()
        try:
            _prepared(outcome, missing[0], place, len(missing), usual).make()
        except FormationError as error:
            if isinstance(error, OutputError) or lack_of(error):
                raise
            # its row says why it could not begin
        usual = max(usual, time.perf_counter() - began)
        del missing[0]
    return [_of(place, row) for row in rows if (_of(place, row) / RESULT).exists()]


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
        yield ranked[_middle(outcome, keep.of, len(ranked))]
    for first, last in keep.ranges:
        yield from (row for row in outcome.rows if first <= row.number <= last)


def _ranked(outcome: StudyOutcome, of: int | None) -> list[Row]:
    """Return the runs, the worst first, by a measure that they have, or by their least margins."""
    if of is None:
        return sorted(outcome.shown, key=lambda row: (row.least, row.number))
    sign = -1.0 if outcome.study.measures[of].greatest_is_worst else 1.0
    ended = [row for row in outcome.shown if row.status != BROKEN]
    return sorted(ended, key=lambda row: (sign * row.measures[of], row.number))


def _middle(outcome: StudyOutcome, of: int | None, runs: int) -> int:
    """Return the place of the median among ranked runs: of an even number, the lower of the two, as tables have it."""
    falling = of is not None and outcome.study.measures[of].greatest_is_worst
    return runs // 2 if falling else (runs - 1) // 2


def _of(place: Path, row: Row) -> Path:
    return place / f"run_{row.number}"


def _prepared(outcome: StudyOutcome, row: Row, place: Path, runs: int, usual: float) -> KeptRun:
    """Write a run as a scenario, and return what makes it."""
    here = _of(place, row)
    study = outcome.study
    text = as_variant(study, run_of(study, row.number, row.draw, row.values), here)
    try:
        here.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{here} cannot be made: {error.strerror}") from None
    write(here / SCENARIO, text.encode())
    return KeptRun(here, row.key, runs, usual, outcome.code)


def _make_elsewhere(outcome: StudyOutcome, missing: Sequence[Row], place: Path, usual: float, count: int) -> None:
    """Make results in processes of this machine; raises OutputError."""
    left = list(reversed(missing))
    flying: set[Future[str]] = set()
    with processes(count) as (threads, own):
        while left or flying:
            while left and len(flying) < count:
                task = _prepared(outcome, left.pop(), place, len(left) + len(flying) + 1, usual)
                flying.add(threads.submit(_made, own, task))
            done, flying = wait(flying, return_when=FIRST_COMPLETED)
            for problem in filter(None, (future.result() for future in done)):
                raise OutputError(problem)


def _made(own: Processes, task: KeptRun) -> str:
    """Return why a result cannot be written; empty if it is, or if its run cannot begin."""
    try:
        return "".join(text for text in own.answers(task, str) if isinstance(text, str))
    except Ended:  # as its row says
        return ""
