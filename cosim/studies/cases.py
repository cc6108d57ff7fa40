"""Combinations of cases: their names, and what the scenario of each has where values go."""

from __future__ import annotations

from cosim.studies.study import Study, Tune
from cosim.studies.values import Finite


def cases_at(study: Study, index: int) -> tuple[int, ...]:
    """Return a combination of cases by its index among all."""
    return tuple(study.bases)[index]


def names_of(study: Study, cases: tuple[int, ...]) -> list[str]:
    """Return the names of the cases of a combination."""
    having = [vary.values for vary in study.vary if vary.cases]
    return [values.texts[index] for values, index in zip(having, cases, strict=True) if isinstance(values, Finite)]


def case_name(study: Study, cases: tuple[int, ...]) -> str:
    """Return the names of cases, with spaces between them."""
    return " ".join(names_of(study, cases))


def own_text(study: Study, cases: tuple[int, ...], index: int) -> str:
    """Return what the scenario of some cases has where a value goes; empty where it has nothing or no such place."""
    target = study.vary[index].targets[0]
    text = study.own[cases].get(target.select, "")
    return text.split()[target.entry - 1] if target.entry and text else text


def tuned_in(study: Study, tune: Tune, cases: tuple[int, ...]) -> list[int]:
    """Return which of the values are tuned in a case."""
    named = names_of(study, cases)
    return [index for index in tune.values if study.vary[index].case in ("", *named)]
