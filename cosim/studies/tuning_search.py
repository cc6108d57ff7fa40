"""One search of a study that tunes: batches of trials, each of which it asks for when the one before has come."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import count, takewhile

import numpy as np
from scipy.optimize import brentq

from cosim.quantity import quantity
from cosim.studies.cases import cases_at, own_text, tuned_in
from cosim.studies.seeking import Point, Seeker, seeker
from cosim.studies.study import Study, Tune
from cosim.studies.trial import Trial, is_worse, score
from cosim.studies.values import Random

_EDGE = 0.02
"""How near to an end of its range a value is at a bound, of the range's length in the search."""


class TuningSearch:
    """One search in one case: its trials, in batches.

    Parameters
    ----------
    study
        A study that tunes.
    case
        The index of the combination of cases.
    restart
        The number of the search, from 0.

    Attributes
    ----------
    case : int
        The index of the case.
    waiting : deque
        Trials and draws whose runs were not asked for.
    ended : list of Trial
        All trials whose runs have come.
    """

    def __init__(self, study: Study, tune: Tune, case: int, restart: int) -> None:
        cases = cases_at(study, case)
        each, more = divmod(tune.evaluations, tune.restarts)
        self._study, self._tune = study, tune
        self._tuned = tuned_in(study, tune, cases)
        self._restart = restart
        self._size = each + (restart < more)
        self._first = case * tune.evaluations + restart * each + min(restart, more) + 1
        self._stages, self._error = stages_of(tune)
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
            trial.pruned = is_worse(self._tune, trial, self._best, self._error)
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


def stages_of(tune: Tune) -> tuple[list[int], float]:
    """Return after how many draws trials may be dropped and the number of all draws, and the error of each such test.

    A trial may be tested several times, and all of its tests together may err as often as the study allows.
    """
    draws, allowed = len(tune.training), tune.prune
    if allowed is None:
        return [draws], 0.0
    tests = 1
    while True:
        error = allowed / tests
        fewest = max(math.ceil(-math.log2(error)), 2)  # with fewer pairs the test never decides
        stages = list(takewhile(lambda stage: stage < draws, (fewest << power for power in count())))
        if len(stages) <= tests:
            return [*stages, draws], error
        tests += 1


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


def at_bounds(study: Study, best: Trial) -> Iterator[str]:
    """Yield a sentence on each value of the best trial that is at an end of its range."""
    for (index, value), fraction in zip(best.values.items(), () if best.point is None else best.point, strict=False):
        if _EDGE <= fraction <= 1.0 - _EDGE:
            continue
        end = "least" if fraction < _EDGE else "greatest"
        yield f"{study.vary[index].name} = {value} is at the {end} value of its range: widen it"
