"""A search for narrow places where a function of the unit cube is least, with few evaluations.

Half of the points fill the cube evenly (Sobol). From then on, points are spent on descents: about a point, a few random
ones; the best of them is the next centre; where none is better, the next ones are nearer. After two such steps the
descent is given up. Descents begin, in turn, at the least point and at the one that is deepest below its neighbours,
as a narrow pit may lie on high ground; none begins near an earlier one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.stats import qmc

from cosim.studies.seeking import Point

_SHARE = 0.5
"""Of the points, those that fill the cube."""
_REACH, _SHRINK = 0.4, 0.6
"""Standard deviation of a descent's first step, of the distance of points that fill the cube; and how it goes down."""
_APART = 0.6
"""Least distance of the beginnings of two descents, of the same distance."""
_BETTER = 0.01
"""Share by which a step has to be better."""
_PATIENCE = 2
"""Steps without anything better with which a descent ends."""


class Descents:
    """A search in the unit cube.

    Parameters
    ----------
    size
        How many values there are.
    points
        How many will be asked for.
    seed
        Seed of all that is random.
    """

    def __init__(self, size: int, points: int, seed: int) -> None:
        self._random = np.random.default_rng(seed)
        filling = max(int(_SHARE * points), 1)
        power = max(filling - 1, 0).bit_length()
        self._filling: list[Point] = list(qmc.Sobol(size, seed=self._random).random_base2(power)[:filling])
        self._apart = filling ** (-1.0 / size)
        self._size = size
        self._points: list[Point] = []
        self._scores: list[float] = []
        self._asked: list[tuple[Point, _Descent | None]] = []
        self._running: list[_Descent] = []
        self._begun: list[Point] = []

    def ask(self, count: int) -> list[Point]:
        """Return points to be scored next."""
        if self._filling:
            self._asked = [(point, None) for point in self._filling[:count]]
            del self._filling[:count]
        else:
            self._asked = list(self._steps(count))
        return [point for point, _ in self._asked]

    def tell(self, scores: Sequence[float]) -> None:
        """Take the scores, which are finite, of all points that were asked for last."""
        for descent in self._running:
            own = [(score, point) for (point, of), score in zip(self._asked, scores, strict=True) if of is descent]
            descent.step(own)
        self._running = [descent for descent in self._running if descent.patience]
        self._points += [point for point, _ in self._asked]
        self._scores += scores

    def _steps(self, count: int) -> list[tuple[Point, _Descent | None]]:
        """Return the next points of as many descents as there is room for; the last one gets what is left."""
        each = min(4 + self._size, count)
        steps: list[tuple[Point, _Descent | None]] = []
        for place in range(max(count // each, 1)):
            if place == len(self._running):
                self._running.append(self._next())
            descent = self._running[place]
            number = each if place < count // each - 1 else count - len(steps)
            around = descent.centre + descent.reach * self._random.normal(size=(number, self._size))
            steps += [(point, descent) for point in np.clip(around, 0.0, 1.0)]
        return steps

    def _next(self) -> _Descent:
        points, scores = np.array(self._points), np.array(self._scores)
        ranks = scores if len(self._begun) % 2 == 0 else -_depths(points, scores)
        chosen = int(np.argmin(ranks))
        for index in np.argsort(ranks, kind="stable").tolist():
            if all(np.abs(points[index] - other).max() > _APART * self._apart for other in self._begun):
                chosen = index
                break
        self._begun.append(points[chosen])
        return _Descent(points[chosen], float(scores[chosen]), _REACH * self._apart)


class _Descent:
    def __init__(self, centre: Point, score: float, reach: float) -> None:
        self.centre, self.score, self.reach = centre, score, reach
        self.patience = _PATIENCE

    def step(self, scored: Sequence[tuple[float, Point]]) -> None:
        if not scored:
            return
        score, point = min(scored, key=lambda one: one[0])
        if score < self.score - _BETTER * abs(self.score):
            self.centre, self.score, self.patience = point, score, _PATIENCE
        else:
            self.reach *= _SHRINK
            self.patience -= 1


def _depths(points: NDArray[np.float64], scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far each point is below the mean of its nearest ones."""
    near = min(2 * points.shape[1], len(points) - 1)
    if near < 1:
        return np.zeros(len(points))
    _, indices = KDTree(points).query(points, near + 1)
    depths: NDArray[np.float64] = scores[indices[:, 1:]].mean(axis=1) - scores
    return depths
