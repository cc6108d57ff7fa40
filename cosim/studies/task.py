"""A chunk of runs of a study, and how it is made: a scenario is prepared once, and run with the values of each."""

from __future__ import annotations

import math
import pickle
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from cosim.errors import FormationError, InputError, Location, OtherStructure
from cosim.master.code import OtherCode, check_code, check_laws, code_of
from cosim.master.other_runs import run_other
from cosim.master.prepared import Prepared
from cosim.master.supervised import whole_run
from cosim.plant.interpreter import tells_of_kill
from cosim.results.expectations import judge
from cosim.results.outcome import RunOutcome
from cosim.results.result import Result
from cosim.results.verdict import Verdict
from cosim.scenario.reader import Variations
from cosim.scenario.scenario import Expectation, Scenario
from cosim.studies.courses import Envelope
from cosim.studies.measuring import figure_over
from cosim.studies.plan import Run
from cosim.studies.row import BROKEN, FAILED, PASSED, Row
from cosim.studies.study import Measured
from cosim.unforeseen import lack_of

_KEPT = 16
"""How many scenarios a process keeps prepared."""


@dataclass(frozen=True)
class Task:
    """A chunk of runs.

    Attributes
    ----------
    study : str
        Marks the tasks of one study, which share what is prepared.
    bases : dict
        Of these runs, see `Study.bases`; each pickled.
    measures : tuple of Measured
        Those that a run gives; see `cosim.studies.measuring`.
    envelopes : tuple of Expectation
        See `Study.envelopes`.
    usual : float
        The time [s] that a run takes, about.
    runs : tuple of Run
        The runs.
    keys : tuple of str
        Of each run.
    code : dict
        With which the runs have to be made; see `cosim.master.code`.
    alone : bool
        Whether each is run as ``formation run`` does, where a process of its own shows which FMU has ended it.
    """

    study: str
    bases: Mapping[tuple[int, ...], bytes]
    measures: tuple[Measured, ...]
    envelopes: tuple[Expectation, ...]
    usual: float
    runs: tuple[Run, ...]
    keys: tuple[str, ...]
    code: Mapping[str, str]
    alone: bool = False

    def answers(self) -> Iterator[str]:
        """Make the runs, and return each row as JSON as it comes."""
        return (row.to_json() for row in rows_of(self))


class _Base:
    """A scenario of a study, and what of it is kept for the next run.

    Attributes
    ----------
    prepared : Prepared or None
        With the structure of the last run.
    envelopes : tuple of Envelope
        Those of the study, in this scenario.
    """

    def __init__(self, scenario: Scenario, envelopes: Iterable[Expectation]) -> None:
        self.scenario = scenario
        self.envelopes = tuple(Envelope(written, scenario) for written in envelopes)
        self._record = {name for envelope in self.envelopes for name in envelope.signals({})} or None
        self.variations = Variations(scenario)
        self.prepared: Prepared | None = None
        self._code: Mapping[str, str] = {}
        self._looked_for: Mapping[str, str] | None = None

    def run(self, scenario: Scenario, code: Mapping[str, str]) -> RunOutcome:
        """Run a scenario with the code that is wanted; raises as `Prepared.run`, and OtherCode."""
        if self.prepared is not None:
            check_code(code, self._code)
            try:
                return self.prepared.run(scenario)
            except OtherStructure:
                self.close()
        # This process may end, at the cost of one run
        self.prepared = Prepared(scenario, self._record, isolate=False)
        self._code = code_of(self.prepared.setup)
        check_code(code, self._code)
        return self.prepared.run(scenario)

    def check_laws(self, code: Mapping[str, str]) -> None:
        """Refuse to say that the scenario cannot be run if its laws are others than is wanted; raises OtherCode."""
        if self.prepared is None and self._looked_for != code:
            check_laws(code, self.scenario)
            self._looked_for = code

    def placed(self, row: Row, where: Location | None) -> Row:
        """Return a row whose message begins with a place; with its element, if it is one of the scenario's."""
        element = None if where is None else self._elements.get(where)
        return row if element is None else replace(row, where=str(where), element=element)

    @cached_property
    def _elements(self) -> Mapping[Location, int]:
        return {where: element for element, where in enumerate(self.scenario.places)}

    def close(self) -> None:
        prepared, self.prepared = self.prepared, None
        if prepared is not None:
            prepared.close()


_bases: OrderedDict[tuple[str, tuple[int, ...]], _Base] = OrderedDict()


def rows_of(task: Task) -> Iterator[Row]:
    """Run a chunk, and return each row as it comes.

    What is prepared is kept for the next one; one thread at a time may do this. A run of which a process was killed is
    made once more, as that need not be its own doing.

    Raises
    ------
    FormationError
        The machine lacks what a run needs, or has other code, which says nothing about the run: it has no row.
    """
    for run, key in zip(task.runs, task.keys, strict=True):
        base = _base(task, run.cases)
        row = _alone(task, base, run, key) if task.alone else _together(task, base, run, key)
        yield _alone(task, base, run, key) if tells_of_kill(row.message) else row


def _base(task: Task, cases: tuple[int, ...]) -> _Base:
    kept = task.study, cases
    if kept not in _bases:
        _bases[kept] = _Base(pickle.loads(task.bases[cases]), task.envelopes)  # from the process that has made the task
    _bases.move_to_end(kept)
    while len(_bases) > _KEPT:
        _bases.popitem(last=False)[1].close()
    return _bases[kept]


def close_all() -> None:
    """End all that is prepared."""
    while _bases:
        _bases.popitem()[1].close()


def _together(task: Task, base: _Base, run: Run, key: str) -> Row:
    """Run with the plants of the run before, where the structure is the same."""
    try:
        scenario = base.variations.edited(run.changes)
        outcome = base.run(scenario, task.code)
    except FormationError as error:
        return _broken_by(task, base, run, key, error)
    if outcome.failure is not None:
        return broken_row(task, run, key, outcome.message)
    return _judged(task, base, run, key, outcome.verdicts, outcome.result)


def _alone(task: Task, base: _Base, run: Run, key: str) -> Row:
    """Run as one scenario by itself, its FMUs in a process that is supervised."""
    try:
        scenario = base.scenario.edited(run.changes)
        with whole_run(scenario) as whole:
            check_code(task.code, code_of(whole.setup))
            result = whole.run_to_end()
            verdicts = judge(scenario.expectations, result, lambda path: run_other(whole.setup, path))
    except FormationError as error:
        return _broken_by(task, base, run, key, error)
    return _judged(task, base, run, key, verdicts, result)


def _courses(base: _Base, result: Result | None) -> tuple[str, ...]:
    return () if result is None else tuple(envelope.course(result) for envelope in base.envelopes)


def _judged(task: Task, base: _Base, run: Run, key: str, verdicts: Sequence[Verdict], result: Result | None) -> Row:
    places: dict[Location, list[Verdict]] = {measured.where: [] for measured in task.measures}
    own: list[Verdict] = []
    for verdict in verdicts:
        places.get(verdict.where, own).append(verdict)
    failed = sorted((verdict for verdict in own if not verdict.passed), key=_over_bound)  # the worst is told
    row = Row(
        key=key,
        number=run.number,
        draw=run.draw,
        values=run.values,
        status=FAILED if failed else PASSED,
        measures=tuple(figure_over(measured, places[measured.where]) for measured in task.measures),
        margins=_margins(own),
        message=f"{failed[0].where}: {failed[0]}" if failed else "",
        least=min(map(_over_bound, own), default=math.inf),
        courses=_courses(base, result),
    )
    return base.placed(row, failed[0].where) if failed else row


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


def _broken_by(task: Task, base: _Base, run: Run, key: str, error: FormationError) -> Row:
    """Return the row of a run that an error has ended, unless it says nothing about the run: then raise it.

    Raises
    ------
    FormationError
        The machine lacks something.
    OtherCode
        The code here is not the one that is wanted, or it lacks a law.
    """
    if lack_of(error) or isinstance(error, OtherCode):
        raise error
    if isinstance(error, InputError):
        base.check_laws(task.code)
    row = broken_row(task, run, key, str(error))
    return base.placed(row, error.where) if isinstance(error, InputError) else row


def broken_row(task: Task, run: Run, key: str, message: str) -> Row:
    """Return the row of a run that has not reached its end."""
    nothing = (math.nan,) * len(task.measures)
    return Row(key, run.number, run.draw, run.values, BROKEN, nothing, (), message, -math.inf)
