"""Which runs a study has: of each, the cases and the values, by its number alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError, shown
from cosim.quantity import spelled, split
from cosim.studies.designs import Design, design_of
from cosim.studies.sizes import MOST_RUNS, too_many
from cosim.studies.study import Study, Target, Vary
from cosim.studies.values import NEXT_TO_0, NEXT_TO_1, Count, Finite
from plants import UnitError, units


@dataclass(frozen=True)
class Run:
    """One run of a study.

    Attributes
    ----------
    number : int
        Its number, from 1.
    draw : int
        The number of its draw, from 1; runs that are compared with each other share it.
    cases : tuple of int
        The index of each case; see `Study.bases`.
    values : tuple of str or None
        Of each varied value; of cases, the name. None leaves the scenario's own value.
    changes : tuple of str
        What gives the scenario these values, as ``XPATH=VALUE``.
    """

    number: int
    draw: int
    cases: tuple[int, ...]
    values: tuple[str | None, ...]
    changes: tuple[str, ...]


class Plan:
    """All runs of a study, each of which is made when it is asked for.

    Attributes
    ----------
    design : Design or None
        That of a sensitivity.

    Raises
    ------
    InputError
        There would be too many runs, or a value cannot be computed.
    """

    def __init__(self, study: Study) -> None:
        self._study = study
        self._vary = study.vary
        self._crossed = [index for index, vary in enumerate(study.vary) if vary.crossed]
        drawn = [index for index in range(len(study.vary)) if index not in self._crossed]
        sizes = {index: _size(vary) for index, vary in enumerate(study.vary)}
        self._cross_shape = tuple(sizes[index] for index in self._crossed)
        self._copies = math.prod(self._cross_shape)
        method = study.sample.method
        self.design = design_of(study)
        if method == "grid":
            self._shape = tuple(sizes[index] for index in drawn)
            draws = math.prod(self._shape)
        elif method == "one_at_a_time":
            self._steps = [(index, step) for index in drawn for step in range(sizes[index])]
            draws = 1 + len(self._steps)
        elif self.design is not None:
            draws = self.design.groups * self.design.size
        else:
            draws = study.sample.runs or 0
        if draws * self._copies > MOST_RUNS:
            copies = f" x {self._copies} that are crossed" if self._copies > 1 else ""
            raise InputError(
                f"the study has {draws:,} draws{copies}, which is {too_many(draws * self._copies)}",
                study.sample.where,
            )
        self._drawn = drawn
        self._draws = draws
        random = [index for index in drawn if not self._counts(index)]
        self._fractions = self.design.fractions() if self.design else _fractions(study, draws, random, method)

    def __len__(self) -> int:
        return self._draws * self._copies

    def __iter__(self) -> Iterator[Run]:
        return (self[index] for index in range(len(self)))

    def __getitem__(self, index: int) -> Run:
        draw, copy = divmod(index, self._copies)
        chosen = self._chosen(draw)
        if self._crossed:
            of_copy = np.unravel_index(copy, self._cross_shape)
            chosen |= {at: int(value) for at, value in zip(self._crossed, of_copy, strict=True)}
        values: list[str | None] = []
        for at, vary in enumerate(self._vary):
            pick = chosen[at]
            if isinstance(pick, int):
                assert isinstance(vary.values, Finite)
                pick = vary.values.texts[pick]
            values.append(pick)
        return run_of(self._study, index + 1, draw + 1, values)

    def _counts(self, index: int) -> bool:
        return isinstance(self._vary[index].values, Count)

    def _chosen(self, draw: int) -> dict[int, int | str | None]:
        """Return the value of each one that is not crossed: an index, a text, or None for the scenario's own."""
        if self.design is not None:
            return self._of_design(self.design, draw)
        chosen: dict[int, int | str | None] = {}
        column = 0
        method = self._study.sample.method
        steps = np.unravel_index(draw, self._shape) if method == "grid" and self._shape else ()
        for place, at in enumerate(self._drawn):
            values = self._vary[at].values
            if isinstance(values, Count):
                chosen[at] = values.at(draw)
            elif method == "grid":
                chosen[at] = int(steps[place])
            elif method == "one_at_a_time":
                own = self._steps[draw - 1] if draw else (-1, 0)
                chosen[at] = own[1] if own[0] == at else None
            else:
                fraction = float(self._fractions[draw, column])
                chosen[at] = values.at(min(max(fraction, NEXT_TO_0), NEXT_TO_1))
            column += not isinstance(values, Count)
        return chosen

    def _of_design(self, design: Design, draw: int) -> dict[int, int | str | None]:
        """Return the value of each one that is not crossed, in a sensitivity."""
        chosen: dict[int, int | str | None] = {}
        for at, fraction in zip(self._drawn, self._fractions[draw].tolist(), strict=True):
            values = self._vary[at].values
            if isinstance(values, Count):
                chosen[at] = values.at(design.count_at(draw, fraction))
            else:
                chosen[at] = values.at(min(max(fraction, NEXT_TO_0), NEXT_TO_1))
        return chosen


def run_of(study: Study, number: int, draw: int, values: Sequence[str | None]) -> Run:
    """Return the run in which the varied values are given ones; of cases, their names, and None for the first.

    Raises
    ------
    InputError
        A value cannot be computed from them.
    """
    texts = [list(vary.values.texts) if vary.cases and isinstance(vary.values, Finite) else [] for vary in study.vary]
    cases = tuple(own.index(value) if value in own else 0 for own, value in zip(texts, values, strict=True) if own)
    named = [own[index] for own, index in zip(filter(None, texts), cases, strict=True)]
    kept = [
        None if vary.case and vary.case not in named else value for vary, value in zip(study.vary, values, strict=True)
    ]
    given: dict[str, str] = {}
    for vary, value in zip(study.vary, kept, strict=True):
        for target in vary.targets if value is not None else ():
            text = computed(target, str(value))
            if target.entry:
                entries = given.get(target.select, study.own[cases][target.select]).split()
                entries[target.entry - 1] = text
                text = " ".join(entries)
            given[target.select] = text
    own = study.own.get(cases, {})  # a change to it is none: the run is the scenario's own
    changes = tuple(f"{select}={text}" for select, text in given.items() if text != own.get(select))
    return Run(number, draw, cases, tuple(kept), changes)


def _size(vary: Vary) -> int:
    return len(vary.values) if isinstance(vary.values, Finite) else 1


def _fractions(study: Study, draws: int, columns: list[int], method: str) -> NDArray[np.float64]:
    """Return numbers between 0 and 1 (draws, columns); of the random ones and of Sobol's, more draws add rows."""
    if method in ("grid", "one_at_a_time") or not columns:
        return np.empty((draws, 0))
    generator = np.random.default_rng(study.sample.seed)
    if method == "random":
        return generator.random((draws, len(columns)))
    from scipy.stats import qmc  # takes a second to import: workers do without

    if method == "latin_hypercube":
        return np.asarray(qmc.LatinHypercube(len(columns), seed=generator).random(draws))
    power = max(draws - 1, 0).bit_length()  # a whole power of 2 is balanced
    return np.asarray(qmc.Sobol(len(columns), seed=generator).random_base2(power)[:draws])


def computed(target: Target, text: str) -> str:
    """Return what a target gets for a value."""
    if target.factor is None and target.offset is None:
        return text
    try:
        number, unit = split(text)
        factor, in_factor = target.factor or (1.0, "1")
        number *= factor
        if in_factor != "1":
            both = units.parse(unit) * units.parse(in_factor)
            number, unit = number * both.factor, str(units.Unit(both.exponents))
        if target.offset is not None:
            offset, in_offset = target.offset
            number, unit = units.convert(number, unit, in_offset) + offset, in_offset
    except (ValueError, UnitError) as error:
        raise InputError(f"{shown(text)} times the factor plus the offset: {error}", target.where) from None
    return spelled(float(f"{number:.10g}"), unit)
