"""The trials of a study that tunes: several searches in each case, and the test of the best trial on other draws.

A search asks for a batch of trials, and for the next batch when all runs of this one have come. It sees no other
search. So the trials are the same on any number of processes, and a study that goes on takes their runs from the store.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from cosim.errors import InputError
from cosim.quantity import quantity
from cosim.results.verdict import Verdict
from cosim.studies.bounds import sign_test
from cosim.studies.making import Maker, Take, in_order
from cosim.studies.plan import MOST_RUNS, Plan, Run, run_of
from cosim.studies.row import PASSED, Row
from cosim.studies.seeking import Point, Seeker, check_seeking, seeker
from cosim.studies.study import Measured, Study, Tune
from cosim.studies.trial import Trial, cost_of, is_worse, mean_cost, passes, score
from cosim.studies.values import Finite, Random

COST = "cost"
"""The name of what is made least, for requirements."""
_EDGE = 0.02
"""How near to an end of its range a value is at a bound, of the range's length in the search."""


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


def with_cost(study: Study) -> Study:
    """Return the study with the cost as its last measure, for requirements on the tuned values."""
    if study.tune is None:
        return study
    cost = Measured(COST, over="worst", greatest_is_worst=True, unit="", where=study.tune.where)
    return replace(study, measures=(*study.measures, cost))


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
        raise InputError(f"the study has up to {size:,} runs, more than {MOST_RUNS:,}, the most of a study", tune.where)


def most_runs(study: Study, tune: Tune) -> int:
    """Return how many runs a study has, if none is pruned."""
    return len(study.bases) * (tune.evaluations * len(tune.training) + 2 * len(tune.held_out))


def case_name(study: Study, cases: tuple[int, ...]) -> str:
    """Return the names of cases, with spaces between them."""
    return " ".join(_named(study, cases))


def own_text(study: Study, cases: tuple[int, ...], index: int) -> str:
    """Return what the scenario of some cases has where a value goes; empty where it has nothing or no such place."""
    target = study.vary[index].targets[0]
    text = study.own[cases].get(target.select, "")
    return text.split()[target.entry - 1] if target.entry and text else text


def tuned_in(study: Study, tune: Tune, cases: tuple[int, ...]) -> list[int]:
    """Return which of the values are tuned in a case."""
    named = _named(study, cases)
    return [index for index in tune.values if study.vary[index].case in ("", *named)]


def _named(study: Study, cases: tuple[int, ...]) -> list[str]:
    having = [vary.values for vary in study.vary if vary.cases]
    return [values.texts[index] for values, index in zip(having, cases, strict=True) if isinstance(values, Finite)]


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
            _Search(self, cases, restart) for cases in range(len(study.bases)) for restart in range(tune.restarts)
        ]
        self._of: dict[int, tuple[_Search, Trial]] = {}

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
                found.append(Tuned(cases, name, tuple(trials), best, tuple(_at_bounds(self._study, best))))
        return found

    def _run(self, number: int, trial: Trial, draw: int) -> Run:
        cases = list(self._study.bases)[trial.case]
        names = iter(_named(self._study, cases))
        values = [next(names) if vary.cases else None for vary in self._study.vary]
        for index, value in (*self._draws[draw].items(), *trial.values.items()):
            values[index] = value
        return run_of(self._study, number, draw, values)


class _Search:
    """One search in one case: its trials, in batches.

    Attributes
    ----------
    case : int
        The index of the case.
    waiting : deque
        Trials and draws whose runs were not asked for.
    ended : list of Trial
        All trials whose runs have come.
    """

    def __init__(self, tuning: Tuning, case: int, restart: int) -> None:
        study, tune = tuning._study, tuning._tune
        cases = list(study.bases)[case]
        each, more = divmod(tune.evaluations, tune.restarts)
        self._study, self._tune = study, tune
        self._tuned = tuned_in(study, tune, cases)
        self._restart = restart
        self._size = each + (restart < more)
        self._first = case * tune.evaluations + restart * each + min(restart, more) + 1
        self._stages = list(_stages(tune))
        self.case = case
        self.waiting: deque[tuple[Trial, int]] = deque()
        self.ended: list[Trial] = []
        self._batch: list[Trial] = []
        self._running: list[Trial] = []
        self._stage = 0
        start = None if restart else _own_point(study, cases, self._tuned)
        self._seeker: Seeker = seeker(tune.method, len(self._tuned), tune.batch, start, (tune.seed, case, restart))
        self._best: Trial | None = None
        if restart == 0:
            self._begin([Trial(self._first, case, 1, None, dict.fromkeys(self._tuned))])
        else:
            self._begin(self._asked())

    def go_on(self) -> None:
        """Go on if all runs of this stage have come: with the next draws, or with the next batch."""
        if self.waiting or any(len(trial.rows) < self._stages[self._stage] for trial in self._running):
            return
        self._stage += 1
        if self._stage < len(self._stages):
            self._drop_worse()
            self._wait()
        if self._stage == len(self._stages) or not self._running:
            self._end()

    def _drop_worse(self) -> None:
        if self._best is None or self._tune.prune is None:
            return
        for trial in self._running:
            trial.pruned = is_worse(self._tune, trial, self._best, self._tune.prune)
        self._running = [trial for trial in self._running if not trial.pruned]

    def _end(self) -> None:
        """End a batch: tell the search, and begin the next one."""
        for trial in self._batch:
            trial.score = score(self._tune, [trial.rows[draw] for draw in self._tune.training if draw in trial.rows])
            if not trial.pruned and (self._best is None or trial.score < self._best.score):
                self._best = trial
        if self.ended or self._restart:  # else it is of the scenario's own values, where the search begins
            self._seeker.tell([trial.score for trial in self._batch])
        self.ended += self._batch
        self._batch = []
        if len(self.ended) < self._size:
            self._begin(self._asked())

    def _asked(self) -> list[Trial]:
        count = min(self._tune.batch, self._size - len(self.ended))
        first = self._first + len(self.ended)
        return [
            Trial(first + place, self.case, self._restart + 1, point, self._values(point))
            for place, point in enumerate(self._seeker.ask(count))
        ]

    def _values(self, point: Point) -> dict[int, str | None]:
        found: dict[int, str | None] = {}
        for index, fraction in zip(self._tuned, point.tolist(), strict=True):
            found[index] = _range(self._study, index).at(fraction)
        return found

    def _begin(self, batch: list[Trial]) -> None:
        self._batch = self._running = batch
        self._stage = 0
        self._wait()

    def _wait(self) -> None:
        begin = self._stages[self._stage - 1] if self._stage else 0
        draws = self._tune.training[begin : self._stages[self._stage]]
        self.waiting.extend((trial, draw) for trial in self._running for draw in draws)


def _stages(tune: Tune) -> Iterator[int]:
    """Return after how many draws trials may be dropped, and the number of all draws at last."""
    if tune.prune is not None:
        fewest = max(math.ceil(-math.log2(tune.prune)), 2)  # with fewer pairs the test never decides
        while fewest < len(tune.training):
            yield fewest
            fewest *= 2
    yield len(tune.training)


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


def _range(study: Study, index: int) -> Random:
    values = study.vary[index].values
    assert isinstance(values, Random)
    return values


# Where the search begins and ends -----------------------------------------------------------------------------


def _own_point(study: Study, cases: tuple[int, ...], tuned: Sequence[int]) -> Point:
    """Return where the scenario's own values are; in the middle of a range if it has none, at its end if outside."""
    return np.array([_own_fraction(study, cases, index) for index in tuned])


def _own_fraction(study: Study, cases: tuple[int, ...], index: int) -> float:
    target, values = study.vary[index].targets[0], _range(study, index)
    try:
        own = quantity(own_text(study, cases, index), values.unit)
    except ValueError:
        return 0.5
    if target.factor is not None or target.offset is not None:
        return 0.5
    if own <= values.quantile(0.0):
        return 0.0
    if own >= values.quantile(1.0):
        return 1.0
    return float(brentq(lambda fraction: values.quantile(fraction) - own, 0.0, 1.0))


def _at_bounds(study: Study, best: Trial) -> Iterator[str]:
    for (index, value), fraction in zip(best.values.items(), () if best.point is None else best.point, strict=False):
        if _EDGE <= fraction <= 1.0 - _EDGE:
            continue
        end = "least" if fraction < _EDGE else "greatest"
        yield f"{study.vary[index].name} = {value} is at the {end} value of its range: widen it"


# The verdict --------------------------------------------------------------------------------------------------


def tuned_values(study: Study, tune: Tune, maker: Maker, tuning: Tuning, take: Take) -> list[Tuned]:
    """Make the runs of the best trials and of the scenario's own values on the draws that were held out; judge them."""
    found = tuning.found()
    rows: dict[int, Row] = {}

    def keep(some: Sequence[Row]) -> bool:
        rows.update((row.number, row) for row in some)
        return take(some)

    wanted = {one.cases: (tuning.held_out(one.trials[0]), tuning.held_out(one.best)) for one in found}
    maker.make(in_order({run.number: run for both in wanted.values() for runs in both for run in runs}.values()), keep)
    judged = []
    for one in found:
        own, best = (tuple(rows[run.number] for run in runs) for runs in wanted[one.cases])
        judged.append(replace(one, own=own, held_out=best, verdict=_verdict(tune, one, own, best)))
    return judged


def _verdict(tune: Tune, tuned: Tuned, own: Sequence[Row], best: Sequence[Row]) -> Verdict:
    of = f" of {tuned.name}" if tuned.name else ""
    pairs = [(score(tune, [one]), score(tune, [other])) for one, other in zip(best, own, strict=True)]
    least, told = sign_test(pairs, tune.confidence)
    details = [f"{told} of held-out draws", f"mean cost {mean_cost(tune, best):.4g}, was {mean_cost(tune, own):.4g}"]
    if not passes(best):
        details.append(f"{sum(row.status != PASSED for row in best)} of these runs do not pass")
    if not passes(tuned.best.rows.values()):
        details.append("in training, no trial passes on all draws")
    return Verdict(
        expectation=f"tuned values{of} better than the scenario's own, with confidence {tune.confidence:g}",
        robot="",
        figure=least,
        bound=0.5,
        unit="",
        margin=least - 0.5,
        passed=least > 0.5,
        known_failure=tune.fails,
        detail="; ".join(details),
        where=tune.where,
    )


def to_judge(study: Study, tune: Tune, found: Sequence[Tuned]) -> list[Row]:
    """Return the runs of all tuned cases that were held out, for requirements: with their cost, and paired by draws."""
    return [
        replace(
            row,
            measures=(*row.measures, cost_of(tune, row)),
            values=tuple(None if index in tune.values else value for index, value in enumerate(row.values)),
        )
        for one in found
        for row in one.held_out
    ]
