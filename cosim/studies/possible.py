"""Whether the runs of a study can begin: a unit that does not fit is told before a thousand runs break by it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack

from cosim.errors import InputError
from cosim.master.setup import set_up
from cosim.scenario.scenario import Scenario
from cosim.studies.plan import Plan, Run
from cosim.studies.study import Study

_TRIED, _LOOKED_AT, _MOST_CASES = 10, 1000, 20
"""Runs of a case that are tried at most; runs among which those of each case are; and cases that are tried."""


def check_possible(study: Study, plan: Plan) -> None:
    """Refuse a study in which, of some case, no run can begin of several that lie evenly among all.

    Of other runs, one that cannot begin is broken, and no more.

    Raises
    ------
    InputError
        Why the first run cannot begin, and with which values.
    """
    for cases, runs in list(_some(study, plan).items())[:_MOST_CASES]:
        first = _problem(study.bases[cases], runs[0])
        if first is None or any(_problem(study.bases[cases], run) is None for run in runs[1:]):
            continue
        named = zip(study.vary, runs[0].values, strict=True)
        values = ", ".join(f"{vary.name} {value}" for vary, value in named if value is not None)
        others = ", and no other that was tried" if len(runs) > 1 else ""
        raise InputError(f"{first.message} (run {runs[0].number} cannot begin, with {values}{others})", first.where)


def _some(study: Study, plan: Plan) -> Mapping[tuple[int, ...], Sequence[Run]]:
    """Return runs of each case, evenly among all: the first one, some between, and the last."""
    if len(study.bases) == 1:
        return {next(iter(study.bases)): [plan[index] for index in _evenly(len(plan))]}
    found: dict[tuple[int, ...], list[Run]] = {}
    for index in range(min(len(plan), _LOOKED_AT)):
        run = plan[index]
        found.setdefault(run.cases, []).append(run)
    return {cases: [runs[index] for index in _evenly(len(runs))] for cases, runs in found.items()}


def _evenly(count: int) -> list[int]:
    return sorted({round(place * (count - 1) / (_TRIED - 1)) for place in range(_TRIED)})


def _problem(scenario: Scenario, run: Run) -> InputError | None:
    try:
        with ExitStack() as cleanup:
            set_up(scenario.edited(run.changes), cleanup, {})
    except InputError as error:
        return error
    return None
