"""Whether the runs of a study can begin: a unit that does not fit is told before a thousand runs break by it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack

from cosim.errors import InputError
from cosim.master.setup import set_up
from cosim.scenario.scenario import Scenario
from cosim.studies.plan import Plan, Run
from cosim.studies.study import Study

_LOOKED_AT, _MOST_CASES = 1000, 20
"""Runs among which those of each case are looked for; and cases that are tried."""


def check_possible(study: Study, plan: Plan) -> None:
    """Refuse a study in which, of some case, the first run cannot begin, nor the last, nor one between.

    Of other runs, one that cannot begin is broken, and no more.

    Raises
    ------
    InputError
        Why its first run cannot begin, and with which values.
    """
    for cases, runs in list(_some(plan).items())[:_MOST_CASES]:
        problems = []
        for run in runs:
            problem = _problem(study.bases[cases], run)
            if problem is None:
                break
            problems.append(problem)
        else:
            first = problems[0]
            values = ", ".join(
                f"{vary.name} {value}" for vary, value in zip(study.vary, runs[0].values, strict=True) if value
            )
            others = ", and no other that was tried" if len(runs) > 1 else ""
            raise InputError(f"{first.message} (run {runs[0].number} cannot begin, with {values}{others})", first.where)


def _some(plan: Plan) -> Mapping[tuple[int, ...], Sequence[Run]]:
    """Return the first run of each case, one between, and the last."""
    looked_at = min(len(plan), _LOOKED_AT)
    found: dict[tuple[int, ...], list[Run]] = {}
    for index in (*range(looked_at), *range(max(len(plan) - looked_at, looked_at), len(plan))):
        run = plan[index]
        found.setdefault(run.cases, []).append(run)
    return {
        cases: list({run.number: run for run in (runs[0], runs[len(runs) // 2], runs[-1])}.values())
        for cases, runs in found.items()
    }


def _problem(scenario: Scenario, run: Run) -> InputError | None:
    try:
        with ExitStack() as cleanup:
            set_up(scenario.edited(run.changes), cleanup, {})
    except InputError as error:
        return error
    return None
