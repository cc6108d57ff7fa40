"""Which of the varied values a measure depends on: Sobol's indices and elementary effects, computed by SALib.

Rows come in groups (see `cosim.studies.designs`), and a group counts only if each of its runs has a figure.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from itertools import combinations, product
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError, Location
from cosim.studies.designs import FEWEST, LEVELS, STEP, Design, design_of
from cosim.studies.row import BROKEN, PASSED, Row
from cosim.studies.study import Study
from cosim.studies.values import Finite

CONFIDENCE = 0.95
"""Of the intervals about the figures."""
MOST_LEFT_OUT = 0.2
"""The share of groups that may be left out."""
FIGURES: Mapping[str, tuple[str, ...]] = {
    "saltelli": ("first", "first_plus_minus", "total", "total_plus_minus"),
    "morris": ("mean_absolute", "mean_absolute_plus_minus", "mean", "deviation"),
}
"""Of each method: the figures of a value, with half the width of the interval after what it belongs to."""
_RESAMPLES = 200
_PACKAGE = "SALib"
_Found: TypeAlias = tuple[dict[str, tuple[float, ...]], dict[tuple[str, str], tuple[float, float]]]


@dataclass(frozen=True)
class Sensitivity:
    """What a measure depends on.

    Attributes
    ----------
    measure, unit : str
        The measure; ``passed`` is 1 for a run that passes and 0 for another.
    cases : tuple of str
        Of each value that is crossed: the one that these runs have.
    names : tuple of str
        Of the varied values.
    figures : dict of tuple of float
        Each of `FIGURES`, for each value; none if nothing can be said.
    pairs : dict of tuple of float
        Of two values: the index of second order, and half the width of its interval.
    groups, left_out : int
        Groups of runs that count; and those that do not, as a run of each has no figure.
    note : str
        Why nothing is said, or that groups are left out.
    """

    measure: str
    unit: str
    cases: tuple[str, ...]
    names: tuple[str, ...]
    figures: Mapping[str, tuple[float, ...]]
    pairs: Mapping[tuple[str, str], tuple[float, float]]
    groups: int
    left_out: int
    note: str

    def order(self) -> list[int]:
        """Return the indices of the values, the most important one first."""
        importance = self.figures.get("total") or self.figures.get("mean_absolute") or (0.0,) * len(self.names)
        return sorted(range(len(self.names)), key=lambda index: -importance[index])

    def as_data(self) -> dict[str, Any]:
        """Return it for JSON."""
        values = [
            {"name": name, **{figure: own[index] for figure, own in self.figures.items()}}
            for index, name in enumerate(self.names)
        ]
        pairs = [
            {"names": list(names), "second": index, "second_plus_minus": plus_minus}
            for names, (index, plus_minus) in self.pairs.items()
        ]
        kept = ("measure", "unit", "cases", "groups", "left_out", "note")
        return {**{name: getattr(self, name) for name in kept}, "values": values, "pairs": pairs}


def check_installed(where: Location) -> None:
    """Refuse a sensitivity without the package that computes it; raises InputError with its place."""
    try:
        import_module(_PACKAGE)
    except ImportError:
        raise InputError(
            f"a sensitivity needs the package {_PACKAGE!r}, which is not installed: "
            'pip install "formation-cosim[study]"',
            where,
        ) from None


def sensitivities(study: Study, rows: Sequence[Row]) -> list[Sensitivity]:
    """Return what each measure depends on, for each of the values that are crossed; none if it was not asked for."""
    design = design_of(study)
    return [] if design is None else list(_each(study, design, rows))


def _each(study: Study, design: Design, rows: Sequence[Row]) -> Iterator[Sensitivity]:
    crossed = [index for index, vary in enumerate(study.vary) if vary.crossed]
    names = tuple(vary.name for vary in study.vary if not vary.crossed)
    choices = [vary.values.texts for vary in study.vary if vary.crossed and isinstance(vary.values, Finite)]
    measures: list[tuple[str, str, int | None]] = [
        (one.name, one.unit, index) for index, one in enumerate(study.measures)
    ]
    if len({row.status == PASSED for row in rows}) > 1:
        measures.append(("passed", "", None))
    fractions = design.fractions().reshape(design.groups, design.size, len(names))
    for cases in product(*choices):
        own = [row for row in rows if tuple(row.values[index] for index in crossed) == cases]
        begun = len(own) // design.size  # the last one may lack runs, after a first look
        for name, unit, index in measures:
            figures = np.array([_figure(row, index) for row in own[: begun * design.size]]).reshape(begun, design.size)
            whole = np.isfinite(figures).all(axis=1)
            known, left_out = figures[whole], int((~whole).sum())
            why = _why_not(known, left_out)
            found: _Found = {}, {}
            if not why:
                counted = fractions[:begun][whole].reshape(-1, len(names))
                found = _ANALYSES[study.sample.method](design, names, known.ravel(), counted)
            note = why or (f"said of the others only: {_lost(len(known), left_out)}" if left_out else "")
            yield Sensitivity(name, unit, cases, names, *found, len(known), left_out, note)


def _figure(row: Row, index: int | None) -> float:
    if index is None:
        return float(row.status == PASSED)
    return math.nan if row.status == BROKEN else row.measures[index]


def _why_not(known: NDArray[np.float64], left_out: int) -> str:
    """Return why nothing can be said; empty if something can."""
    if left_out > MOST_LEFT_OUT * (len(known) + left_out):
        return f"{_lost(len(known), left_out)}, which is too many"
    if len(known) < FEWEST:
        return f"only {len(known)} groups of runs are there, and {FEWEST} are needed"
    if np.ptp(known) <= 1e-9 * np.abs(known).max():
        return "the same in all runs"
    return ""


def _lost(known: int, left_out: int) -> str:
    return f"{left_out} of {known + left_out} groups of runs have a run without a figure"


# By SALib -----------------------------------------------------------------------------------------------------


def _indices(
    design: Design, names: Sequence[str], figures: NDArray[np.float64], fractions: NDArray[np.float64]
) -> _Found:
    from SALib.analyze import sobol

    second = design.sample.second_order
    found = _quietly(sobol.analyze, _problem(names), figures, calc_second_order=second, **_intervals(design))
    told = {
        ours: tuple(map(float, found[theirs]))
        for ours, theirs in zip(FIGURES["saltelli"], ("S1", "S1_conf", "ST", "ST_conf"), strict=True)
    }
    pairs = {
        (names[one], names[other]): (float(found["S2"][one, other]), float(found["S2_conf"][one, other]))
        for one, other in (combinations(range(len(names)), 2) if second else ())
    }
    return told, pairs


def _effects(
    design: Design, names: Sequence[str], figures: NDArray[np.float64], fractions: NDArray[np.float64]
) -> _Found:
    from SALib.analyze import morris

    found = _quietly(morris.analyze, _problem(names), fractions, figures, num_levels=LEVELS, **_intervals(design))
    both = zip(FIGURES["morris"], ("mu_star", "mu_star_conf", "mu", "sigma"), strict=True)
    scale = np.where(design.counted, STEP, 1.0)  # a count has no range: what tells is the change to its next number
    return {ours: tuple((found[theirs] * scale).tolist()) for ours, theirs in both}, {}


_ANALYSES = {"saltelli": _indices, "morris": _effects}


def _problem(names: Sequence[str]) -> dict[str, Any]:
    return {"num_vars": len(names), "names": list(names), "groups": None, "bounds": [[0.0, 1.0]] * len(names)}


def _intervals(design: Design) -> dict[str, Any]:
    return {"num_resamples": _RESAMPLES, "conf_level": CONFIDENCE, "seed": design.sample.seed + 1}  # 0 would be none


def _quietly(analyze: Any, *given: Any, **named: Any) -> Any:
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        return analyze(*given, **named)
