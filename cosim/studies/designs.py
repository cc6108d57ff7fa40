"""Designs of a sensitivity: draws in groups, within which one value is changed at a time.

`saltelli` is for Sobol's indices: a group has two points of Sobol's sequence, and points between them that have one
value of the other point each (Saltelli et al. 2010). `morris` is for elementary effects: a group is a trajectory that
changes each value once, by two thirds of its range (Morris 1991).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.studies.study import Sample, Study, Vary
from cosim.studies.values import Count, Finite, Random

METHODS = ("saltelli", "morris")
LEVELS = 4
"""Of a value in trajectories: at 0, 1/3, 2/3 and 1 of its range."""
STEP = 2.0 / 3.0
"""By which a trajectory changes a value, of its range."""
FEWEST = 4
"""Groups, at least: with fewer, nothing can be said about how sure the figures are."""


@dataclass(frozen=True)
class Design:
    """The draws of a sensitivity.

    Attributes
    ----------
    sample : Sample
        How the study says that they are chosen.
    counted : tuple of bool
        Of each value, whether it is a count, such as a seed: it has one number at the first point of a group, and
        the next one where it is changed.
    groups : int
        How many groups.
    """

    sample: Sample
    counted: tuple[bool, ...]
    groups: int

    @property
    def size(self) -> int:
        """How many draws a group has."""
        return _size(self.sample, len(self.counted))

    def __str__(self) -> str:
        kind = "pairs of points" if self.sample.method == "saltelli" else "trajectories"
        return f"{self.groups:,} {kind} for {len(self.counted)} values, {self.size} draws each"

    def count_at(self, draw: int, fraction: float) -> int:
        """Return what a count adds to its first number, in a draw from 0."""
        return 2 * (draw // self.size) + (fraction > 0.5)

    def fractions(self) -> NDArray[np.float64]:
        """Return numbers between 0 and 1 (draws, values); more groups add rows. A count has 0, or 1 if changed."""
        generator = np.random.default_rng(self.sample.seed)
        make = _saltelli if self.sample.method == "saltelli" else _morris
        return make(self, generator).reshape(self.groups * self.size, len(self.counted))


def design_of(study: Study) -> Design | None:
    """Return the design of a study that asks for a sensitivity; None if it asks for none.

    Raises
    ------
    InputError
        It cannot be made of these values, or of so few runs; with its place.
    """
    sample = study.sample
    if sample.method not in METHODS:
        return None
    values = [vary for vary in study.vary if not vary.crossed]
    method = f'method="{sample.method}" of <sample>'
    if len(values) < 2:
        raise InputError(f"{method} compares values, so that two or more have to vary, not {len(values)}", sample.where)
    for vary in values:
        _check(vary, sample.method)
    size = _size(sample, len(values))
    groups = (sample.runs or 0) // size
    if sample.method == "saltelli":
        groups = 1 << groups.bit_length() >> 1  # a whole power of 2 is balanced
    if groups < FEWEST:
        raise InputError(
            f"{method} needs {size} runs at a time for {len(values)} values, and at least {FEWEST} times: "
            f'give runs="{FEWEST * size}" or more, better hundreds of times',
            sample.where,
        )
    return Design(sample, tuple(isinstance(vary.values, Count) for vary in values), groups)


def _size(sample: Sample, values: int) -> int:
    if sample.method == "morris":
        return values + 1
    return 2 * values + 2 if sample.second_order else values + 2


def _check(vary: Vary, method: str) -> None:
    values = vary.values
    if isinstance(values, Finite):
        if len(values) < 2:
            raise InputError(
                f"the value {vary.name!r} is always the same: give two or more, or take it out", vary.where
            )
        if method == "morris":
            raise InputError(
                f'the value {vary.name!r} has no range that method="morris" of <sample> could step over: '
                'give <uniform>, cross it, or use method="saltelli"',
                vary.where,
            )
    if method == "morris" and isinstance(values, Random) and not np.isfinite([values.least, values.greatest]).all():
        raise InputError(
            f'the value {vary.name!r} has no end, to which method="morris" of <sample> would change it: give from=... '
            "and to=... of <normal>",
            vary.where,
        )


def _saltelli(design: Design, generator: np.random.Generator) -> NDArray[np.float64]:
    """Return the draws (group, draw, value): a point, it with one value of the other, vice versa, the other point."""
    from scipy.stats import qmc  # takes a second to import: workers do without

    values = len(design.counted)
    drawn = np.flatnonzero(~np.array(design.counted))
    points = np.zeros((design.groups, 2, values))
    points[:, 1] = 1.0  # of counts
    if len(drawn):
        sobol = qmc.Sobol(2 * len(drawn), seed=generator)
        both = sobol.random_base2(design.groups.bit_length() - 1).reshape(design.groups, 2, len(drawn))
        points[:, :, drawn] = both
    one, other = points[:, :1], points[:, 1:]
    own = np.eye(values, dtype=bool)
    mixed = [np.where(own, other, one)]
    if design.sample.second_order:
        mixed.append(np.where(own, one, other))
    return np.concatenate([one, *mixed, other], axis=1)


def _morris(design: Design, generator: np.random.Generator) -> NDArray[np.float64]:
    """Return the draws (group, draw, value): each changes one value of the draw before, in random order."""
    values = len(design.counted)
    low, up, order = np.moveaxis(generator.random((design.groups, 3, values)), 1, 0)
    begin = np.where(low < 0.5, 0.0, 1.0 / 3.0)
    end = np.where(low < 0.5, STEP, 1.0)
    begin, end = np.where(up < 0.5, begin, end), np.where(up < 0.5, end, begin)
    counted = np.array(design.counted)
    begin, end = np.where(counted, 0.0, begin), np.where(counted, 1.0, end)
    changed_at = np.argsort(np.argsort(order, axis=1), axis=1)
    steps = np.arange(values + 1)[None, :, None]
    return np.where(steps > changed_at[:, None, :], end[:, None, :], begin[:, None, :])
