"""What must hold of all runs of a study together: each kind checked before the study, and judged after it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from cosim.errors import InputError, nearest
from cosim.results.verdict import Verdict
from cosim.scenario.written_element import Written
from cosim.studies import bounds
from cosim.studies.bounds import Sequential
from cosim.studies.designs import METHODS
from cosim.studies.row import BROKEN, PASSED, Row
from cosim.studies.study import Measured, Study


@dataclass(frozen=True)
class Judged:
    """A requirement that is understood.

    Attributes
    ----------
    text : str
        It in words.
    judge : callable
        Returns the verdict from the rows, in the order of their runs.
    test : Sequential or None
        What ends the study early.
    """

    text: str
    judge: Callable[[Sequence[Row]], Verdict]
    test: Sequential | None = None
    counts: Callable[[Row], bool] = lambda row: row.status == PASSED


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
    return [_KINDS[one.kind](study, Written(one.kind, one.attributes, one.where, Path())) for one in study.requirements]


def _probability(study: Study, written: Written) -> Judged:
    bound, confidence = _share(written, "above"), _share(written, "confidence")
    completed = written.get("of") == "completed"
    early = "stop" in written
    text = f"probability of {written.get('of')} above {bound:g}, with confidence {confidence:g}"

    def counts(row: Row) -> bool:
        return row.status != BROKEN if completed else row.status == PASSED

    def judge(rows: Sequence[Row]) -> Verdict:
        good = sum(map(counts, rows))
        if not rows:
            return _verdict(written, text, math.nan, bound, "", False, "no run")
        least = bounds.probability_at_least(good, len(rows), confidence)
        detail = f"{good} of {len(rows)} runs"
        if good == len(rows) and least <= bound:
            detail += f"; {bounds.trials_for(bound, confidence)} without a failure would show it"
        return _verdict(written, text, least, bound, "", least > bound, detail)

    def judge_early(rows: Sequence[Row]) -> Verdict:
        sequential = Sequential(bound, confidence)
        good = 0
        for row in rows:
            sequential.add(counts(row))
            good += counts(row)
            if sequential.above is not None:
                break
        share = good / sequential.trials if rows else math.nan
        how = {True: "decided", False: "decided against it", None: "still open"}[sequential.above]
        detail = f"share of {good} of {sequential.trials} runs; {how} by the sequential test"
        return _verdict(written, text, share, bound, "", sequential.above is True, detail)

    return Judged(text, judge_early if early else judge, Sequential(bound, confidence) if early else None, counts)


def _quantile(study: Study, written: Written) -> Judged:
    at = _share(written, "at")
    return _of_measure(
        study,
        written,
        f"{at:g} quantile",
        lambda values, confidence: bounds.quantile_at_most(values, at, confidence),
        lambda values, confidence: bounds.quantile_at_least(values, at, confidence),
    )


def _mean(study: Study, written: Written) -> Judged:
    return _of_measure(study, written, "mean", bounds.mean_at_most, bounds.mean_at_least)


def _worst(study: Study, written: Written) -> Judged:
    return _of_measure(study, written, "worst", lambda values, _: max(values), lambda values, _: min(values))


def _of_measure(
    study: Study,
    written: Written,
    what: str,
    at_most: Callable[[Sequence[float], float], float],
    at_least: Callable[[Sequence[float], float], float],
) -> Judged:
    index, measured = _measure(study, written)
    if ("below" in written) == ("above" in written):
        raise written.error(f"<{written.kind}> needs one bound: below=... or above=...")
    below = "below" in written
    name = "below" if below else "above"
    bound = written.quantity(name, measured.unit or "1")
    confidence = _share(written, "confidence") if "confidence" in written else 0.0
    sure = f", with confidence {confidence:g}" if confidence else ""
    text = f"{what} of {measured.name} {name} {f'{bound:g} {measured.unit}'.strip()}{sure}"

    def judge(rows: Sequence[Row]) -> Verdict:
        nothing = math.inf if below else -math.inf  # a broken run has the worst figure
        values = [nothing if row.status == BROKEN else row.measures[index] for row in rows]
        if not values:
            return _verdict(written, text, math.nan, bound, measured.unit, False, "no run")
        figure = (at_most if below else at_least)(values, confidence)
        margin = bound - figure if below else figure - bound
        detail = f"of {len(rows)} runs"
        broken = sum(row.status == BROKEN for row in rows)
        if broken:
            detail += f", {broken} of them broken"
        if confidence and math.isinf(figure) and not broken:
            detail += ": too few for this confidence"
        if not confidence:
            detail += f", number {rows[values.index(figure)].number}"
        return _verdict(written, text, figure, bound, measured.unit, margin > 0, detail, margin)

    return Judged(text, judge)


def _better(study: Study, written: Written) -> Judged:
    index, measured = _measure(study, written)
    confidence = _share(written, "confidence")
    choices = {vary.name: (place, vary) for place, vary in enumerate(study.vary)}
    name = written.get("vary")
    if name not in choices:
        raise written.error(f"nothing varies that is named {name!r}: {nearest(name, list(choices))}")
    place, vary = choices[name]
    if not vary.crossed:
        raise written.error(f'{name!r} is not crossed, so no two runs have the same draw: add cross="yes" to it')
    texts = list(getattr(vary.values, "texts", ()))
    for case in (written.get("case"), written.get("than")):
        if case not in texts:
            raise written.error(f"{name!r} has no value {case!r}: {nearest(case, texts)}")
    if written.get("case") == written.get("than"):
        raise written.error("nothing is better than itself: name two cases")
    crossed = [index for index, other in enumerate(study.vary) if other.crossed and index != place]
    sign = -1.0 if written.get("by") == "more" else 1.0
    text = f"{written.get('case')} better than {written.get('than')} in {measured.name}, with confidence {confidence:g}"

    def judge(rows: Sequence[Row]) -> Verdict:
        figures: dict[tuple[object, ...], dict[str, float]] = {}
        for row in rows:
            case = row.values[place]
            others = row.draw, *(row.values[other] for other in crossed)
            figure = math.inf if row.status == BROKEN else sign * row.measures[index]
            figures.setdefault(others, {})[str(case)] = figure
        pairs = [(own[written.get("case")], own[written.get("than")]) for own in figures.values() if _both(own)]
        least, detail = bounds.sign_test(pairs, confidence)
        return _verdict(written, text, least, 0.5, "", least > 0.5, detail)

    def _both(own: Mapping[str, float]) -> bool:
        return written.get("case") in own and written.get("than") in own

    return Judged(text, judge)


_KINDS: Mapping[str, Callable[[Study, Written], Judged]] = {
    "probability": _probability,
    "quantile": _quantile,
    "mean": _mean,
    "worst": _worst,
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
