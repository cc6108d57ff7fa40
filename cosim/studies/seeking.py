"""Searches for the least score in the unit cube, which ask for a batch of points at a time.

Each depends on its seed and on the scores that it was told, and on nothing else, so that it is the same search on any
number of processes and after any interruption.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Sequence
from importlib import import_module
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError, Location

Point: TypeAlias = NDArray[np.float64]
_FIRST_STEP = 0.2
"""Standard deviation of the first points about the start of CMA-ES, of edges of length 1."""
FEWEST = 4
"""Points of a generation of CMA-ES, at least."""


class Seeker(ABC):
    """A search in the unit cube."""

    @abstractmethod
    def ask(self, count: int) -> list[Point]:
        """Return points to be scored next."""

    @abstractmethod
    def tell(self, scores: Sequence[float]) -> None:
        """Take the scores, which are finite, of all points that were asked for last."""


def check_seeking(method: str, size: int, batch: int, where: Location) -> None:
    """Refuse a search that cannot begin.

    Raises
    ------
    InputError
        Its package is not installed, or it needs more values or a larger batch; with its place.
    """
    try:
        import_module(_PACKAGES[method])
    except ImportError:
        raise InputError(
            f'method="{method}" needs the package {_PACKAGES[method]!r}, which is not installed: '
            'pip install "formation-cosim[study]"',
            where,
        ) from None
    if method == "cma_es" and size < 2:
        raise InputError('method="cma_es" needs two values or more: use method="tpe"', where)
    if method == "cma_es" and batch < FEWEST:
        raise InputError(f'batch="{batch}" is too small for method="cma_es": {FEWEST} are needed', where)


def seeker(method: str, size: int, batch: int, start: Point | None, seed: Sequence[int]) -> Seeker:
    """Return a search.

    Parameters
    ----------
    method
        ``cma_es`` or ``tpe``.
    size
        How many values there are.
    batch
        How many points are asked for at once; fewer at the very end.
    start
        Where it begins; None for a random point.
    seed
        Whole numbers, which together are its seed.
    """
    return _METHODS[method](size, batch, start, np.random.SeedSequence(list(seed)))


class CmaEs(Seeker):
    """CMA-ES (Hansen 2016), by the package that Optuna uses: there each trial would hold the whole state in a text.

    Points outside the cube are scored at the nearest point in it, and worse than that by how far outside they are, so
    that the search comes to a least score at a bound as well as to any other (Hansen et al. 2009, section III.B).
    """

    def __init__(self, size: int, batch: int, start: Point | None, seed: np.random.SeedSequence) -> None:
        self._size, self._batch = size, batch
        self._random = np.random.default_rng(seed)
        self._own = self._begun(start)
        self._asked: Point = np.empty((0, size))

    def _begun(self, start: Point | None) -> Any:
        from cmaes import CMA

        mean = self._random.random(self._size) if start is None else start
        return CMA(mean=mean, sigma=_FIRST_STEP, seed=int(self._random.integers(2**31)), population_size=self._batch)

    def ask(self, count: int) -> list[Point]:
        """Return points to be scored next."""
        self._asked = np.array([self._own.ask() for _ in range(count)])
        return list(np.clip(self._asked, 0.0, 1.0))

    def tell(self, scores: Sequence[float]) -> None:
        """Take the scores; a search that has come to its end begins anew from a random point."""
        if len(scores) < self._batch:  # the last ones
            return
        outside = self._asked - np.clip(self._asked, 0.0, 1.0)
        spread = self._asked.std(axis=0) + np.finfo(float).tiny
        quarter, three_quarters = np.quantile(scores, [0.25, 0.75])
        penalties = (three_quarters - quarter) * np.mean((outside / spread) ** 2, axis=1)
        self._own.tell(list(zip(self._asked, scores + penalties, strict=True)))
        if self._own.should_stop():
            self._own = self._begun(None)


class Tpe(Seeker):
    """Tree-structured Parzen estimator (Bergstra et al. 2011), by Optuna."""

    def __init__(self, size: int, batch: int, start: Point | None, seed: np.random.SeedSequence) -> None:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # its options are marked as experimental
            sampler = optuna.samplers.TPESampler(
                seed=int(seed.generate_state(1)[0]),
                multivariate=True,
                constant_liar=True,
                n_startup_trials=max(10, batch),
            )
        self._study = optuna.create_study(sampler=sampler)
        edge = optuna.distributions.FloatDistribution(0.0, 1.0)
        self._axes: dict[str, Any] = {f"x{index}": edge for index in range(size)}
        self._trials: list[Any] = []
        if start is not None:
            self._study.enqueue_trial(dict(zip(self._axes, map(float, start), strict=True)))

    def ask(self, count: int) -> list[Point]:
        """Return points to be scored next."""
        self._trials = [self._study.ask(self._axes) for _ in range(count)]
        return [np.array([trial.params[axis] for axis in self._axes]) for trial in self._trials]

    def tell(self, scores: Sequence[float]) -> None:
        """Take the scores."""
        for trial, score in zip(self._trials, scores, strict=True):
            self._study.tell(trial, score)


_METHODS = {"cma_es": CmaEs, "tpe": Tpe}
_PACKAGES = {"cma_es": "cmaes", "tpe": "optuna"}
