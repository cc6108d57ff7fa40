"""The horizons and steps that the runs of a study have: what is measured has to be within each."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress

from cosim.errors import InputError
from cosim.quantity import quantity
from cosim.scenario.edits import split_setting
from cosim.scenario.scenario import Scenario
from cosim.studies.cases import case_name
from cosim.studies.plan import Plan, computed
from cosim.studies.study import Sample, Study, Vary
from cosim.studies.values import Finite

_TIMING = ("horizon", "step", "period")
"""Attributes of <simulation>, which no other element has."""
_LOOKED_AT, _MOST = 1000, 8
"""Runs that are looked at; and scenarios of each case that are set up, those with the shortest horizons."""


def timed_scenarios(study: Study, plan: Plan) -> Mapping[tuple[int, ...], list[Scenario]]:
    """Return the scenarios of each case with the horizons and steps of its runs, whatever else varies.

    Raises
    ------
    InputError
        A window of time is not within a run; with its place.
    """
    timed = any(is_timing(target.select) for vary in study.vary for target in vary.targets)
    if not timed:
        return {cases: [scenario] for cases, scenario in study.bases.items()}
    found: dict[tuple[int, ...], dict[tuple[str, ...], None]] = {cases: {} for cases in study.bases}
    for index in range(min(len(plan), _LOOKED_AT)):
        run = plan[index]
        found[run.cases].setdefault(tuple(change for change in run.changes if is_timing(split_setting(change)[0])))
    return {cases: list(_edited(study.bases[cases], timings)) for cases, timings in found.items()}


def _edited(scenario: Scenario, timings: Mapping[tuple[str, ...], None]) -> Iterator[Scenario]:
    for changes in sorted(timings, key=lambda changes: [_seconds(scenario, change) for change in changes])[:_MOST]:
        try:
            yield scenario.edited(changes)
        except InputError as error:
            raise InputError(f"{error.message} (with {', '.join(changes)})", error.where) from None
    if not timings:
        yield scenario


def told_for(error: InputError, study: Study, cases: tuple[int, ...], scenario: Scenario) -> InputError:
    """Return an error about a scenario of a study with what makes it another one than the study's: case and timing."""
    base = study.bases[cases]
    told = [f"in the case {name}"] if (name := case_name(study, cases)) else []
    if (scenario.ticks, scenario.step) != (base.ticks, base.step):
        told.append(f"with a horizon of {scenario.horizon:.12g} s in steps of {scenario.step:.12g} s")
    return InputError(f"{error.message} ({', '.join(told)})", error.where) if told else error


def longest_horizon(vary: Iterable[Vary], sample: Sample, cases: Collection[str]) -> str:
    """Return the change to the longest horizon that every run of some cases has in place of the scenario's own.

    Empty if runs may have the scenario's own.
    """
    found: dict[str, float] = {}
    for one in vary:
        always = one.crossed or sample.method != "one_at_a_time"
        if not (always and isinstance(one.values, Finite) and one.case in ("", *cases)):
            continue
        for target in one.targets:
            for value in one.values.texts[:_LOOKED_AT] if _attribute(target.select) == "horizon" else ():
                with suppress(InputError, ValueError):  # which its run will tell
                    text = computed(target, value)
                    found[f"{target.select}={text}"] = quantity(text, "s")
    return max(found, key=found.__getitem__, default="")


def is_timing(select: str) -> bool:
    """Return whether an XPath selects the horizon or the step of a scenario."""
    return _attribute(select) in _TIMING


def _attribute(select: str) -> str:
    return select.rpartition("/@")[2]


def _seconds(scenario: Scenario, change: str) -> float:
    try:
        return quantity(split_setting(change)[1], "s")
    except ValueError:  # which its run will tell
        return scenario.horizon
