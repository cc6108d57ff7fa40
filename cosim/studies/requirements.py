"""What must hold of all runs of a study together: each kind checked before the study, and judged after it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

from cosim.errors import InputError, nearest
from cosim.results.verdict import Verdict
from cosim.scenario.written_element import Written
from cosim.studies import bounds
from cosim.studies.designs import METHODS
from cosim.studies.draws import AT_RANDOM, Draws, EarlyTest, check_two_cases, draws_of, is_seed, value_named
from cosim.studies.row import BROKEN, PASSED, Row
from cosim.studies.study import Measured, Requirement, Study, Vary
from cosim.studies.values import Finite, has_spread


@dataclass(frozen=True)
class Judged:
    """A requirement that is understood.

    Attributes
    ----------
    text : str
        It in words.
    judge : callable
        Returns the verdict from the rows, in the order of their runs.
    early : callable or None
        Returns the test that ends the study early.
    """

    text: str
    judge: Callable[[Sequence[Row]], Verdict]
    early: Callable[[], EarlyTest] | None = None


def requirements_of(study: Study) -> list[Judged]:
    """Return what must hold.

    Raises
    ------
    InputError
        A number is out of its range, a measure or a case does not exist, a unit does not fit, or a confidence is asked
        for of runs that are no draws independent of each other; with its place.
    """
    for one in study.requirements:
        if study.sample.method in METHODS and one.kind != "worst":
            raise InputError(
                f'the runs of method="{study.sample.method}" of <sample> depend on each other, so that <{one.kind}> '
                "can say nothing of them with confidence: only <worst> can be asked of a sensitivity",
                one.where,
            )
        if study.search is not None and one.kind != "worst":
            raise InputError(
                f"the runs of a <search> are sought where they are bad, so that <{one.kind}> can say nothing of others "
                "with confidence: only <worst> can be asked of a search",
                one.where,
            )
    return [_judged(study, one) for one in study.requirements]


def _judged(study: Study, requirement: Requirement) -> Judged:
    given = [Written("given", own.attributes, own.where, Path()) for own in requirement.given]
    written = Written(requirement.kind, requirement.attributes, requirement.where, Path())
    draws = draws_of(study, given)
    if requirement.kind == "worst":
        return _worst(study, written, replace(draws, once=False))
    judged = _KINDS[requirement.kind](study, written, draws)
    _check_drawn(study, written, draws)
    return judged


def _check_drawn(study: Study, written: Written, draws: Draws) -> None:
    """Refuse a confidence if what counts as a draw differs from others in more than its seed, and not by chance."""
    method = study.sample.method
    if not draws.single and method in AT_RANDOM:
        _check_different(study, written, draws)
        return
    if draws.single and (study.sample.runs or 1) > 1:
        raise InputError(
            'every value is crossed, so that all draws are the same: give method="grid"', study.sample.where
        )
    chosen = {index for index, _ in draws.given}
    seeds = []
    for index, vary in enumerate(study.vary):
        if index in chosen or vary.name == written.get("vary") or (vary.crossed and not draws.single):
            continue
        if _has_one_value(vary) and (vary.crossed or method != "one_at_a_time"):  # which has the scenario's own, too
            continue
        if is_seed(vary):
            seeds += [vary] * (isinstance(vary.values, Finite) and _counts(study, written, draws, vary))
            continue
        crossed = "vary the seed besides, not crossed" if draws.single else 'add cross="yes" to it, and vary the seed'
        raise written.error(
            f"the values of {vary.name!r} are not drawn by chance, so that <{written.kind}> can say nothing of them "
            f'with confidence: {crossed}; or name one of them by <given>, give a method that draws, such as "random", '
            "or ask <worst>"
        )
    if len(seeds) > 1:
        raise written.error(
            f"the seeds {seeds[0].name!r} and {seeds[1].name!r} do not vary together, so that runs which share one of "
            f"them depend on each other, and <{written.kind}> can say nothing of them with confidence: let one <vary> "
            "have both places, by <also>"
        )


def _check_different(study: Study, written: Written, draws: Draws) -> None:
    """Refuse a confidence if nothing is drawn by which those draws differ that count."""
    chosen = {index for index, _ in draws.given} | set(study.tune.values if study.tune else ())
    for index, vary in enumerate(study.vary):
        crossed = vary.crossed or vary.name == written.get("vary")
        if index in chosen or crossed or not has_spread(vary.values):
            continue
        if _counts(study, written, draws, vary):
            return
    raise written.error(
        f"nothing is drawn by which runs differ, so that <{written.kind}> can say nothing of them with confidence: "
        "vary the seed besides"
    )


def _counts(study: Study, written: Written, draws: Draws, vary: Vary) -> bool:
    """Return whether a value is one of the runs that count: not of a case alone that none of them has."""
    given = dict(draws.given)
    for index, one in enumerate(study.vary):
        if one.cases and isinstance(one.values, Finite) and vary.case in one.values.texts:
            compared = (written.get("case"), written.get("than")) if one.name == written.get("vary") else ()
            counting = [given[index]] if index in given else compared or one.values.texts
            if vary.case in counting:
                return True
    return not vary.case


def _has_one_value(vary: Vary) -> bool:
    return isinstance(vary.values, Finite) and len(vary.values) == 1


def _probability(study: Study, written: Written, draws: Draws) -> Judged:
    bound, confidence = _share(written, "above"), _share(written, "confidence")
    completed = written.get("of") == "completed"
    of = f"probability of {written.get('of')}{_given(study, draws)}"
    text = f"{of} above {bound:.12g}, with confidence {confidence:.12g}"

    def passes(row: Row) -> bool:
        return row.status != BROKEN if completed else row.status == PASSED

    def judge(rows: Sequence[Row]) -> Verdict:
        all_draws = draws.of(rows)
        if not all_draws:
            return _verdict(written, text, math.nan, bound, "", False, "no run")
        good, number = sum(all(map(passes, own)) for own in all_draws), len(all_draws)
        least = bounds.probability_at_least(good, number, confidence)
        detail = f"{good} of {draws.told(number)}"
        if good == number and least <= bound:
            detail += f"; {bounds.trials_for(bound, confidence)} without a failure would show it"
        return _verdict(written, text, least, bound, "", least > bound, detail)

    def early() -> EarlyTest:
        return EarlyTest(draws, passes, bound, confidence)

    def judge_early(rows: Sequence[Row]) -> Verdict:
        test = early()
        for row in rows:
            test.add(row)
        share = test.passed / test.trials if test.trials else math.nan
        how = {True: "decided", False: "decided against it", None: "still open"}[test.above]
        detail = f"share of {test.passed} of {draws.told(test.trials)}; {how} by the sequential test"
        return _verdict(written, text, share, bound, "", test.above is True, detail)

    return Judged(text, judge_early, early) if "stop" in written else Judged(text, judge)


def _quantile(study: Study, written: Written, draws: Draws) -> Judged:
    at = _share(written, "at")
    return _of_measure(
        study,
        written,
        draws,
        f"{at:.12g} quantile",
        lambda values, confidence: bounds.quantile_at_most(list(map(max, values)), at, confidence),
        lambda values, confidence: bounds.quantile_at_least(list(map(min, values)), at, confidence),
    )


def _mean(study: Study, written: Written, draws: Draws) -> Judged:
    return _of_measure(
        study,
        written,
        draws,
        "mean",
        lambda values, confidence: bounds.mean_at_most(list(map(_mean_of, values)), confidence),
        lambda values, confidence: bounds.mean_at_least(list(map(_mean_of, values)), confidence),
    )


def _worst(study: Study, written: Written, draws: Draws) -> Judged:
    return _of_measure(
        study, written, draws, "worst", lambda values, _: max(map(max, values)), lambda values, _: min(map(min, values))
    )


def _of_measure(
    study: Study,
    written: Written,
    draws: Draws,
    what: str,
    at_most: Callable[[Sequence[Sequence[float]], float], float],
    at_least: Callable[[Sequence[Sequence[float]], float], float],
) -> Judged:
    """Return a requirement on the figures of a measure, those of a draw together."""
    index, measured = _measure(study, written)
    if ("below" in written) == ("above" in written):
        raise written.error(f"<{written.kind}> needs one bound: below=... or above=...")
    below = "below" in written
    name = "below" if below else "above"
    bound = written.quantity(name, measured.unit or "1")
    confidence = _share(written, "confidence") if "confidence" in written else 0.0
    sure = f", with confidence {confidence:.12g}" if confidence else ""
    of = f"{what} of {measured.name}{_given(study, draws)}"
    text = f"{of} {name} {f'{bound:.12g} {measured.unit}'.strip()}{sure}"

    def figure_of(row: Row) -> float:
        nothing = math.inf if below else -math.inf  # a run without a figure has the worst one
        return row.measures[index] if row.status != BROKEN and math.isfinite(row.measures[index]) else nothing

    def judge(rows: Sequence[Row]) -> Verdict:
        all_draws = draws.of(rows)
        if not all_draws:
            return _verdict(written, text, math.nan, bound, measured.unit, False, "no run")
        values = [[figure_of(row) for row in own] for own in all_draws]
        figure = (at_most if below else at_least)(values, confidence)
        margin = bound - figure if below else figure - bound
        counted = [row for own in all_draws for row in own]
        own_run = "" if confidence else f"run {next(row.number for row in counted if figure_of(row) == figure)} "
        details = [f"{own_run}of {draws.told(len(all_draws))}"]
        broken = sum(row.status == BROKEN for row in counted)
        without = sum(row.status != BROKEN and math.isinf(figure_of(row)) for row in counted)
        details += [f"{_runs(broken)} broken"] * bool(broken) + [f"{_runs(without)} without a figure"] * bool(without)
        if confidence and math.isinf(figure) and not broken and not without:
            details[-1] += ": too few for this confidence"
        if confidence and what == "mean" and len(set(map(_mean_of, values))) == 1 < len(values):
            details[-1] += ", all with the same figure: nothing is known of rarer ones"
        return _verdict(written, text, figure, bound, measured.unit, margin > 0, ", ".join(details), margin)

    return Judged(text, judge)


def _better(study: Study, written: Written, draws: Draws) -> Judged:
    index, measured = _measure(study, written)
    confidence = _share(written, "confidence")
    name, case, than = (written.get(key) for key in ("vary", "case", "than"))
    place = value_named(study, written, name)
    check_two_cases(study, written, place, case, than, "nothing is better than itself")
    if place in dict(draws.given):
        raise written.error(f"{name!r} is compared, so that none of its values can be given: leave <given> out")
    others = [index for index in draws.crossed if index != place]
    each = draws.size // len(getattr(study.vary[place].values, "texts", ()))
    what = f"draws, each by most of its {each} pairs" if others and not draws.single else "pairs"
    sign = -1.0 if written.get("by") == "more" else 1.0
    text = f"{case} better than {than} in {measured.name}{_given(study, draws)}, with confidence {confidence:.12g}"

    def figure_of(row: Row) -> float:
        return sign * row.measures[index] if row.status != BROKEN and math.isfinite(row.measures[index]) else math.inf

    def judge(rows: Sequence[Row]) -> Verdict:
        pairs: dict[tuple[object, ...], dict[str, Row]] = {}
        for row in filter(draws.counts, rows):
            of: tuple[object, ...] = (0 if draws.single else row.draw, *(row.values[other] for other in others))
            pairs.setdefault(of, {})[str(row.values[place])] = row
        found: dict[object, list[Row]] = {}  # of each draw, its pairs one after the other
        for named, own in pairs.items():
            if case in own and than in own:
                found.setdefault(named if draws.single else named[0], []).extend((own[case], own[than]))
        figures = [list(map(figure_of, own)) for own in draws.different(found.values())]
        won = [sum((one < two) - (one > two) for one, two in zip(own[::2], own[1::2], strict=True)) for own in figures]
        least, detail = bounds.sign_test([(-more, 0) for more in won], confidence, what)
        return _verdict(written, text, least, 0.5, "", least > 0.5, detail)

    return Judged(text, judge)


def _given(study: Study, draws: Draws) -> str:
    """Return which values count alone, in words."""
    told = " and ".join(f"{study.vary[index].name} {text}" for index, text in draws.given)
    return f" given {told}" if told else ""


def _runs(number: int) -> str:
    return "1 run" if number == 1 else f"{number} runs"


def _mean_of(values: Sequence[float]) -> float:
    """Return a mean; infinite if a value is."""
    return sum(values) / len(values) if any(map(math.isinf, values)) else math.fsum(values) / len(values)


_KINDS: Mapping[str, Callable[[Study, Written, Draws], Judged]] = {
    "probability": _probability,
    "quantile": _quantile,
    "mean": _mean,
    "better": _better,
}


def _share(written: Written, name: str) -> float:
    value = float(written.get(name))
    if not 0.0 < value < 1.0:
        raise written.error(f'{name}="{written.get(name)}" of <{written.kind}> is not between 0 and 1')
    return value


def _measure(study: Study, written: Written) -> tuple[int, Measured]:
    name = written.get("of")
    names = [measured.name for measured in study.measures]
    if name not in names:
        _refuse(written, name, names)
    return names.index(name), study.measures[names.index(name)]


def _refuse(written: Written, name: str, names: Sequence[str]) -> NoReturn:
    if not names:
        raise InputError(f"the study has no measure {name!r}: add <measure name={name!r} .../>", written.where)
    raise written.error(f"the study has no measure {name!r}: {nearest(name, list(names))}")


def _verdict(
    written: Written,
    text: str,
    figure: float,
    bound: float,
    unit: str,
    passed: bool,
    detail: str,
    margin: float | None = None,
) -> Verdict:
    return Verdict(
        expectation=text,
        robot="",
        figure=figure,
        bound=bound,
        unit=unit,
        margin=figure - bound if margin is None else margin,
        passed=passed,
        known_failure=written.get("fails"),
        detail=detail,
        where=written.where,
    )
