"""The trials of a study that tunes: several searches in each case, and the best trial of each case.

A search asks for a batch of trials, and for the next batch when all runs of this one have come. It sees no other
search. So the trials are the same on any number of processes, and a study that goes on takes their runs from the store.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from cosim.errors import InputError
from cosim.results.verdict import Verdict
from cosim.studies.cases import case_name, cases_at, names_of, tuned_in
from cosim.studies.plan import Plan, Run, run_of
from cosim.studies.row import Row
from cosim.studies.seeking import check_seeking
from cosim.studies.sizes import MOST_RUNS, too_many
from cosim.studies.study import COST, Study, Tune
from cosim.studies.trial import Trial
from cosim.studies.tuning_search import TuningSearch, at_bounds


@dataclass(frozen=True)
class Tuned:
    """What has come of tuning one case.

    Attributes
    ----------
    cases : tuple of int
        The indices of the cases.
    name : str
        Their names; empty without cases.
    trials : tuple of Trial
        In their order; the first one has the scenario's own values.
    best : Trial
        The one with the least score on the draws of training.
    at_bounds : tuple of str
        Of each value of the best trial that is at an end of its range, a sentence.
    held_out, own : tuple of Row
        The runs of the best trial and of the scenario's own values on the other draws; none yet after a first look.
    verdict : Verdict or None
        Whether the best trial is better there.
    """

    cases: tuple[int, ...]
    name: str
    trials: tuple[Trial, ...]
    best: Trial
    at_bounds: tuple[str, ...]
    held_out: tuple[Row, ...] = ()
    own: tuple[Row, ...] = ()
    verdict: Verdict | None = None


def check_tuning(study: Study, tune: Tune) -> None:
    """Refuse what could not be tuned; raises InputError with its place."""
    for cases in study.bases:
        tuned = tuned_in(study, tune, cases)
        if not tuned:
            raise InputError(f"nothing is tuned in the case {case_name(study, cases)!r}", tune.where)
        check_seeking(tune.method, len(tuned), tune.batch, tune.where)
    if COST in [measured.name for measured in study.measures]:
        raise InputError(f"a measure is named {COST!r}, as is the sum of all costs: give it another name", tune.where)
    draws_of_values(study, tune)
    size = most_runs(study, tune)
    if size > MOST_RUNS:
        raise InputError(f"the study has up to {size:,} runs, {too_many(size)}", tune.where)


def most_runs(study: Study, tune: Tune) -> int:
    """Return how many runs a study has, if none is pruned."""
    return len(study.bases) * (tune.evaluations * len(tune.training) + 2 * len(tune.held_out))


class Tuning:
    """The trials of all cases, whose runs are asked for and taken; see `cosim.studies.making`.

    Parameters
    ----------
    study
        A study that tunes.
    most
        How many runs are asked for, at most.
    """

    def __init__(self, study: Study, tune: Tune, most: int | None = None) -> None:
        self._study, self._tune = study, tune
        self._draws = draws_of_values(study, tune)
        self._left = most_runs(study, tune) if most is None else most
        self._searches = [
            TuningSearch(study, tune, case, restart)
            for case in range(len(study.bases))
            for restart in range(tune.restarts)
        ]
        self._of: dict[int, tuple[TuningSearch, Trial]] = {}

    def ask(self, most: int) -> list[Run]:
        """Return runs to begin next."""
        asked: list[Run] = []
        for search in self._searches:
            while search.waiting and len(asked) < most and self._left:
                trial, draw = search.waiting.popleft()
                run = self.run(trial, draw)
                self._of[run.number] = search, trial
                self._left -= 1
                asked.append(run)
        return asked

    def take(self, rows: Sequence[Row]) -> bool:
        """Take rows; return that the study goes on."""
        for row in rows:
            search, trial = self._of.pop(row.number)
            trial.rows[row.draw] = row
            search.go_on()
        return True

    def run(self, trial: Trial, draw: int) -> Run:
        """Return the run of a trial on a draw of training."""
        tune = self._tune
        number = (trial.number - 1) * len(tune.training) + tune.training.index(draw) + 1
        return self._run(number, trial, draw)

    def held_out(self, trial: Trial) -> list[Run]:
        """Return the runs of a trial on the draws that were held out."""
        tune, cases = self._tune, len(self._study.bases)
        of = 2 * trial.case + (trial.point is not None)
        begin = cases * tune.evaluations * len(tune.training) + of * len(tune.held_out)
        return [self._run(begin + place, trial, draw) for place, draw in enumerate(tune.held_out, 1)]

    def found(self) -> list[Tuned]:
        """Return the best trial of each case whose own values have all their runs, of the trials that have them."""
        found = []
        for index, cases in enumerate(self._study.bases):
            trials = [trial for search in self._searches if search.case == index for trial in search.ended]
            if trials and trials[0].point is None:
                best = min((t for t in trials if not t.pruned), key=lambda trial: trial.score)
                name = case_name(self._study, cases)
                found.append(Tuned(cases, name, tuple(trials), best, tuple(at_bounds(self._study, best))))
        return found

    def _run(self, number: int, trial: Trial, draw: int) -> Run:
        cases = cases_at(self._study, trial.case)
        names = iter(names_of(self._study, cases))
        values = [next(names) if vary.cases else None for vary in self._study.vary]
        for index, value in (*self._draws[draw].items(), *trial.values.items()):
            values[index] = value
        return run_of(self._study, number, draw, values)


def draws_of_values(study: Study, tune: Tune) -> Mapping[int, Mapping[int, str | None]]:
    """Return the values of each draw that are not tuned, by the index of the value.

    Raises
    ------
    InputError
        A draw that is held out has the same values as one of training.
    """
    drawn = [index for index, vary in enumerate(study.vary) if index not in tune.values and not vary.cases]
    plan = Plan(replace(study, vary=tuple(study.vary[index] for index in drawn)))
    found = {draw: dict(zip(drawn, plan[draw - 1].values, strict=True)) for draw in (*tune.training, *tune.held_out)}
    trained = {tuple(found[draw].values()): draw for draw in reversed(tune.training)}
    for draw in tune.held_out:
        same = trained.get(tuple(found[draw].values()))
        if same is not None:
            values = ", ".join(f"{study.vary[index].name} {value}" for index, value in found[draw].items())
            raise InputError(
                f"draw {draw} is held out and has the same values as draw {same} of training"
                + (f": {values}" if values else ", as nothing is drawn: let a seed vary, by <count>"),
                tune.where,
            )
    return found
