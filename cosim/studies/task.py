"""What a worker does: it prepares a scenario once, and runs it with the values of some runs.

A worker is a process of its own. What an FMU does to it costs a run, never the study.
"""

from __future__ import annotations

import faulthandler
import math
import os
import pickle
import signal
import struct
import threading
import time
from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TypeAlias

from cosim.errors import FormationError, Location
from cosim.master.other_runs import run_other
from cosim.master.prepared import Prepared
from cosim.master.supervised import whole_run
from cosim.results.expectations import judge
from cosim.results.verdict import Verdict
from cosim.scenario.reader import Variations
from cosim.scenario.scenario import Scenario
from cosim.studies.plan import Run
from cosim.studies.row import BROKEN, FAILED, PASSED, Row
from cosim.studies.study import Measured

_KEPT = 4
"""How many prepared scenarios a worker keeps."""
_SLOW = 20.0
"""How many times longer than a usual run one may take before the worker ends itself."""
_LEAST_LIMIT = 60.0
"""The least limit of time [s] for a run."""
_LOOK = 1.0
"""Time [s] between two looks at the process that has started this one."""


@dataclass(frozen=True)
class Job:
    """What all tasks of a study share.

    Attributes
    ----------
    bases : dict
        See `Study.bases`.
    measures : tuple of Measured
        See `Study.measures`.
    usual : float
        The time [s] that a run takes, about.
    """

    bases: Mapping[tuple[int, ...], Scenario]
    measures: tuple[Measured, ...]
    usual: float


@dataclass(frozen=True)
class Task:
    """A chunk of runs.

    Attributes
    ----------
    job_id, job : str, bytes
        The `Job`, pickled, and its checksum.
    runs : tuple of Run
        The runs.
    keys : tuple of str
        Of each run.
    alone : bool
        Whether each is run as ``formation run`` does, where a process of its own shows which FMU has ended it.
    """

    job_id: str
    job: bytes
    runs: tuple[Run, ...]
    keys: tuple[str, ...]
    alone: bool = False


_Kept: TypeAlias = "OrderedDict[tuple[str, tuple[int, ...]], Prepared]"
_jobs: dict[str, Job] = {}
_prepared: _Kept = OrderedDict()
_variations: dict[tuple[str, tuple[int, ...]], Variations] = {}
_note: list[int] = []
"""The descriptor of the file in which this worker notes which run it is about, if it has one."""


def begin_worker(notes: str, parent: int) -> None:
    """Begin a process that makes runs.

    Ctrl-C is left to the process that has started it, with which it ends.

    Parameters
    ----------
    notes
        The folder for the file in which it notes the number of the run it is about.
    parent
        The process that has started it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _note.append(os.open(f"{notes}/about-{os.getpid()}", os.O_CREAT | os.O_WRONLY, 0o600))
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process when another one has ended, which cannot tell any more."""
    while os.getppid() == parent:
        time.sleep(_LOOK)
    os._exit(1)


@cache
def _nowhere() -> int:
    return os.open(os.devnull, os.O_WRONLY)


def _about(run: int) -> None:
    for descriptor in _note:
        os.lseek(descriptor, 0, os.SEEK_SET)
        os.write(descriptor, struct.pack("<q", run))


def run_task(task: Task) -> tuple[list[Row], float]:
    """Run a chunk; return its rows, and the time [s] that it took."""
    if task.job_id not in _jobs:
        _close_all()
        _jobs.clear()
        _variations.clear()
        _jobs[task.job_id] = pickle.loads(task.job)  # from the process that has started this one
    job = _jobs[task.job_id]
    rows = []
    began = time.perf_counter()
    for run, key in zip(task.runs, task.keys, strict=True):
        _about(run.number)
        # an FMU that hangs holds Python's lock, but not this watch's thread
        faulthandler.dump_traceback_later(_LEAST_LIMIT + _SLOW * job.usual, exit=True, file=_nowhere())
        try:
            rows.append(row_of(job, run, key) if task.alone else _together(task.job_id, job, run, key))
        finally:
            faulthandler.cancel_dump_traceback_later()
    _about(0)
    return rows, time.perf_counter() - began


def _together(job_id: str, job: Job, run: Run, key: str) -> Row:
    """Run with the plants of the run before, where the structure is the same."""
    try:
        scenario = _variations_of(job_id, job, run).edited(run.changes)
        prepared = _prepare(job_id, job, run, scenario)
        outcome = prepared.run(scenario)
    except FormationError as error:
        return broken_row(job, run, key, str(error))
    if outcome.failure is not None:
        return broken_row(job, run, key, outcome.message)
    return _judged(job, run, key, outcome.verdicts)


def _variations_of(job_id: str, job: Job, run: Run) -> Variations:
    kept = job_id, run.cases
    if kept not in _variations:
        _variations[kept] = Variations(job.bases[run.cases])
    return _variations[kept]


def _prepare(job_id: str, job: Job, run: Run, scenario: Scenario) -> Prepared:
    kept = job_id, run.cases
    prepared = _prepared.pop(kept, None)
    if prepared is not None and not prepared.accepts(scenario):
        prepared.close()
        prepared = None
    if prepared is None:
        prepared = Prepared(scenario)
    _prepared[kept] = prepared
    while len(_prepared) > _KEPT:
        _prepared.popitem(last=False)[1].close()
    return prepared


def row_of(job: Job, run: Run, key: str) -> Row:
    """Return the row of a run that is made as one scenario by itself, its FMUs in a process that is supervised."""
    try:
        scenario = job.bases[run.cases].edited(run.changes)
        with whole_run(scenario) as whole:
            result = whole.run_to_end()
            verdicts = judge(scenario.expectations, result, lambda path: run_other(whole.setup, path))
    except FormationError as error:
        return broken_row(job, run, key, str(error))
    return _judged(job, run, key, verdicts)


def _judged(job: Job, run: Run, key: str, verdicts: Sequence[Verdict]) -> Row:
    places: dict[Location, list[Verdict]] = {measured.where: [] for measured in job.measures}
    own: list[Verdict] = []
    for verdict in verdicts:
        places.get(verdict.where, own).append(verdict)
    failed = [verdict for verdict in own if not verdict.passed]
    return Row(
        key=key,
        number=run.number,
        draw=run.draw,
        values=run.values,
        status=FAILED if failed else PASSED,
        measures=tuple(_figure(measured, places[measured.where]) for measured in job.measures),
        margins=_margins(own),
        message=f"{failed[0].where}: {failed[0]}" if failed else "",
        least=min(map(_over_bound, own), default=math.inf),
    )


def _figure(measured: Measured, verdicts: Iterable[Verdict]) -> float:
    """Return the figure of a measure over the robots; one without a figure is the worst there is."""
    worst = math.inf if measured.greatest_is_worst else -math.inf
    figures = [worst if math.isnan(verdict.figure) else verdict.figure for verdict in verdicts]
    if not figures:
        return worst
    if measured.over == "count":
        return float(sum(map(math.isfinite, figures)))
    if measured.over == "mean":
        return math.fsum(figures) / len(figures)
    return max(figures) if measured.greatest_is_worst else min(figures)


def _margins(verdicts: Iterable[Verdict]) -> tuple[float, ...]:
    """Return the least margin of each expectation; that of one without a figure is minus infinity."""
    least: dict[object, float] = {}
    for verdict in verdicts:
        least[verdict.where] = min(_margin(verdict), least.get(verdict.where, math.inf))
    return tuple(least.values())


def _margin(verdict: Verdict) -> float:
    if math.isnan(verdict.margin):
        return math.inf if verdict.passed else -math.inf
    return verdict.margin


def _over_bound(verdict: Verdict) -> float:
    """Return the margin over the magnitude of the bound, so that margins in different units can be compared.

    It is below zero if the expectation fails, and not if it holds, whatever rounding its judgement allows for.
    """
    bound = abs(verdict.bound) if math.isfinite(verdict.bound) and verdict.bound else 1.0
    margin = _margin(verdict) / bound
    return max(margin, 0.0) if verdict.passed else min(margin, -1e-12)


def broken_row(job: Job, run: Run, key: str, message: str) -> Row:
    """Return the row of a run that has not reached its end."""
    nothing = (math.nan,) * len(job.measures)
    return Row(key, run.number, run.draw, run.values, BROKEN, nothing, (), message, -math.inf)


def _close_all() -> None:
    while _prepared:
        _prepared.popitem()[1].close()
