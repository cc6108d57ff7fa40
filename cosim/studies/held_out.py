"""The verdict on a tuning: the best trial of each case against the scenario's own values, on draws held out for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cosim.results.verdict import Verdict
from cosim.studies.bounds import sign_test
from cosim.studies.making import Maker, Take, in_order
from cosim.studies.row import PASSED, Row
from cosim.studies.study import COST, Measured, Study, Tune
from cosim.studies.trial import cost_of, mean_cost, passes, score
from cosim.studies.tuning import Tuned, Tuning


def with_cost(study: Study) -> Study:
    """Return the study with the cost as its last measure, for requirements on the tuned values."""
    if study.tune is None:
        return study
    cost = Measured(COST, over="worst", greatest_is_worst=True, unit="", where=study.tune.where)
    return replace(study, measures=(*study.measures, cost))


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
        expectation=f"tuned values{of} better than the scenario's own, with confidence {tune.confidence:.12g}",
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
