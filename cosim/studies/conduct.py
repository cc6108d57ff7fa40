"""A study from its file to its verdicts: runs that are kept are taken over, the others are made."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from pathlib import Path

from cosim.errors import InputError
from cosim.master.setup import set_up
from cosim.results.verdict import Verdict
from cosim.studies.bundles import Bundle, bundles_of
from cosim.studies.compared_cases import check_compared
from cosim.studies.courses import check_envelopes
from cosim.studies.crews import crew_of
from cosim.studies.duration import keep_pace
from cosim.studies.earlier_files import mark_of, remove_other_results, set_aside, take_back
from cosim.studies.held_out import to_judge, tuned_values, with_cost
from cosim.studies.horizons import timed_scenarios, told_for
from cosim.studies.keys import RunKeys
from cosim.studies.making import Maker, in_order
from cosim.studies.plan import Plan
from cosim.studies.possible import check_possible
from cosim.studies.read_keep import check_keep
from cosim.studies.requirements import Judged, requirements_of
from cosim.studies.row import Row
from cosim.studies.searching import Searching, Worst, check_search, search_verdict
from cosim.studies.sensitivity import Sensitivity, check_installed, sensitivities
from cosim.studies.store import Store
from cosim.studies.study import Search, Study, Tune
from cosim.studies.tuning import Tuned, Tuning, check_tuning, most_runs


@dataclass(frozen=True)
class StudyOutcome:
    """What has come of a study.

    Attributes
    ----------
    rows : tuple of Row
        The runs, in their order.
    planned : int
        How many runs it has.
    verdicts : tuple of Verdict
        On what must hold; empty if only a part of the runs was asked for.
    made : int
        How many runs were made now; others were kept from before, or are the same as one that was made.
    early : bool
        Whether it has ended early, because the verdict is certain enough.
    tuned : tuple of Tuned
        The best values of each case, in a study that tunes.
    worst : Worst or None
        The worst case that was found, in a study that searches.
    bundles : tuple of Bundle
        The courses of all runs, for each envelope and case.
    before : int
        How many of the runs were kept from before.
    code : dict
        The code of the runs; see `cosim.master.code`.
    """

    study: Study
    rows: tuple[Row, ...]
    planned: int
    verdicts: tuple[Verdict, ...]
    made: int
    early: bool
    tuned: tuple[Tuned, ...] = ()
    worst: Worst | None = None
    bundles: tuple[Bundle, ...] = ()
    before: int = 0
    code: Mapping[str, str] = field(default_factory=dict)

    @property
    def shown(self) -> tuple[Row, ...]:
        """The runs that tables are about: all, or of a study that tunes, the best values on held-out draws."""
        if self.study.tune is None:
            return self.rows
        return tuple(row for one in self.tuned for row in one.held_out)

    @property
    def passed(self) -> bool:
        """Whether everything holds that must."""
        return all(verdict.passed for verdict in self.verdicts)

    @cached_property
    def mark(self) -> str:
        """A mark of the study and its runs, by which files are known to belong together."""
        return mark_of(self.study.document.text, self.rows)

    @cached_property
    def sensitivities(self) -> list[Sensitivity]:
        """What each measure depends on, if the study asks for it."""
        return sensitivities(self.study, self.rows)


def check_study(study: Study) -> tuple[Plan, RunKeys, list[Judged]]:
    """Check everything that can be checked before a run; return the runs, their keys, and what must hold.

    Raises
    ------
    InputError
        A scenario cannot be run, there are too many runs, or what must hold makes no sense.
    """
    judged = requirements_of(with_cost(study))
    plan = Plan(study)
    if study.tune is not None:
        check_tuning(study, study.tune)
    if study.search is not None:
        check_search(study, study.search)
    check_keep(study, planned_runs(study, plan))
    check_compared(study)
    if plan.design is not None:
        check_installed(study.sample.where)
    keys = RunKeys(study)
    for cases, timed in timed_scenarios(study, plan).items():
        with ExitStack() as cleanup:
            for scenario in timed:
                try:
                    setup = set_up(scenario, cleanup, {})
                    check_envelopes(study.envelopes, scenario, setup.signals)
                except InputError as error:
                    raise told_for(error, study, cases, scenario) from None
            keys.add(cases, setup)
    check_possible(study, plan)
    return plan, keys, judged


def planned_runs(study: Study, plan: Plan) -> int:
    """Return how many runs a study has, at most."""
    if study.tune is not None:
        return most_runs(study, study.tune)
    return len(plan) if study.search is None else study.search.runs


def conduct(
    study: Study,
    folder: Path,
    *,
    store: Store | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    scheduler: str | None = None,
    runs: int | None = None,
    progress: Callable[[Sequence[Row], int], None] | None = None,
) -> StudyOutcome:
    """Make the runs of a study that its folder does not hold, and judge all of them.

    Before that, the files of an earlier study are set aside; see `cosim.studies.earlier_files`.

    Parameters
    ----------
    study
        The study.
    folder
        Where its rows are kept; it exists.
    store
        Its rows, of a caller who keeps other commands off the folder beyond this call.
    workers, executor, scheduler
        Who makes the runs; see `cosim.studies.crew.crew_of`.
    runs
        Only the first ones, for a first look; nothing is judged then.
    progress
        Told, after each chunk, its rows and how many runs are left.

    Raises
    ------
    InputError
        The study makes no sense, or the folder holds another one.
    OutputError
        The rows cannot be written, or files of an earlier study cannot be set aside.
    KeyboardInterrupt
        The user pressed Ctrl-C; the rows so far are kept.
    """
    with ExitStack() as ending:
        if store is None:
            store = ending.enter_context(Store(folder, study.name))
        set_aside(folder)  # also if the study is refused
        plan, keys, requirements = check_study(study)
        crew = ending.enter_context(crew_of(workers, executor, scheduler))
        kept = frozenset(store.rows)
        maker = Maker(study, keys, store, crew)
        try:
            if study.tune is not None:
                outcome = _tune(study, study.tune, maker, requirements, runs, progress)
            elif study.search is not None:
                outcome = _search(study, study.search, maker, requirements, runs, progress)
            else:
                outcome = _sample(study, plan, maker, requirements, runs, progress)
        finally:
            keep_pace(folder, maker.pace)
        before = sum(row.key in kept for row in outcome.rows)
        remove_other_results(folder, outcome.rows)
        take_back(folder, outcome.mark)
        bundles = bundles_of(study, outcome.shown, store)
        return replace(outcome, bundles=bundles, before=before, code=keys.code)


def _sample(
    study: Study,
    plan: Plan,
    maker: Maker,
    requirements: Sequence[Judged],
    runs: int | None,
    progress: Callable[[Sequence[Row], int], None] | None,
) -> StudyOutcome:
    """Make the runs of a plan, and judge them."""
    wanted = min(len(plan), runs or len(plan))
    rows: dict[int, Row] = {}
    ending = _Ending(requirements, rows)

    def take(some: Sequence[Row]) -> bool:
        rows.update((row.number, row) for row in some)
        if progress is not None:
            progress(some, wanted - len(rows))
        return not ending.reached()

    maker.make(in_order(islice(plan, wanted)), take)
    last = ending.last if ending.reached() else wanted
    ordered = tuple(rows[number] for number in range(1, last + 1))
    judged = wanted == len(plan) or ending.reached()
    return StudyOutcome(
        study=study,
        rows=ordered,
        planned=len(plan),
        verdicts=tuple(one.judge(ordered) for one in requirements) if judged else (),
        made=maker.made,
        early=last < wanted,
    )


def _search(
    study: Study,
    search: Search,
    maker: Maker,
    requirements: Sequence[Judged],
    runs: int | None,
    progress: Callable[[Sequence[Row], int], None] | None,
) -> StudyOutcome:
    """Search for the worst case, and judge all runs of the search."""
    wanted = min(search.runs, runs or search.runs)
    searching = Searching(study, search, wanted)

    def take(some: Sequence[Row]) -> bool:
        goes_on = searching.take(some)
        if progress is not None:
            progress(some, wanted - len(searching.rows))
        return goes_on

    maker.make(searching.ask, take)
    rows = tuple(searching.rows[number] for number in sorted(searching.rows))
    worst = searching.worst()
    found = [search_verdict(study, search, worst, len(rows))] if worst is not None else []
    judged = wanted == search.runs or bool(worst and worst.failing)
    return StudyOutcome(
        study=study,
        rows=rows,
        planned=search.runs,
        verdicts=(*found, *(one.judge(rows) for one in requirements)) if judged else (),
        made=maker.made,
        early=len(rows) < wanted,
        worst=worst,
    )


def _tune(
    study: Study,
    tune: Tune,
    maker: Maker,
    requirements: Sequence[Judged],
    runs: int | None,
    progress: Callable[[Sequence[Row], int], None] | None,
) -> StudyOutcome:
    """Tune each case, and judge the best values on the draws that were held out."""
    planned = most_runs(study, tune)
    tuning = Tuning(study, tune, runs)
    rows: dict[int, Row] = {}

    def told(some: Sequence[Row]) -> bool:
        rows.update((row.number, row) for row in some)
        if progress is not None:
            progress(some, min(planned, runs or planned) - len(rows))
        return True

    maker.make(tuning.ask, lambda some: told(some) and tuning.take(some))
    judged = runs is None or runs >= planned
    found = tuned_values(study, tune, maker, tuning, told) if judged else tuning.found()
    to_look_at = to_judge(study, tune, found)
    own = tuple(one.verdict for one in found if one.verdict is not None)
    return StudyOutcome(
        study=study,
        rows=tuple(rows[number] for number in sorted(rows)),
        planned=planned,
        verdicts=(*own, *(one.judge(to_look_at) for one in requirements)) if judged else (),
        made=maker.made,
        early=False,
        tuned=tuple(found),
    )


class _Ending:
    """Whether a study may end early: everything that must hold allows it, and is decided.

    Only runs count before which none is missing, so that it ends with the same run on any number of workers.
    """

    def __init__(self, judged: Sequence[Judged], rows: dict[int, Row]) -> None:
        self._rows = rows
        self._tests = [one.early() for one in judged if one.early is not None]
        self._possible = bool(judged) and len(self._tests) == len(judged)
        self.last = 0

    def reached(self) -> bool:
        """Return whether it may end after the run `last`."""
        if not self._possible:
            return False
        while not self._decided() and (row := self._rows.get(self.last + 1)) is not None:
            self.last += 1
            for test in self._tests:
                test.add(row)
        return self._decided()

    def _decided(self) -> bool:
        return all(test.above is not None for test in self._tests)
