"""The smallest distance between the bodies of followers: their outlines, not their reference points."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.results import convex
from cosim.results.metrics import Nearest
from cosim.results.outlines import Outlined, outlined_followers
from cosim.results.result import Result
from cosim.storage import blocks
from cosim.vehicle.outline import Floats, frames
from plants import arrays

Indices: TypeAlias = NDArray[np.intp]

_SAMPLES, _PAIRS = 50, 20_000
"""Samples that are looked at together, or more of them where they have fewer pairs of bodies than this."""
_ROUNDING = 1e-12
"""Part of a distance, more than by which rounding makes a lower bound too large."""
_NOWHERE = 1e100
"""Coordinate [m] beyond all measure."""


def smallest_body_distance(result: Result, robots: Collection[str] = ()) -> Nearest | None:
    """Return where the bodies of two followers came nearest to each other.

    Bodies of one follower, such as a tractor and its trailer, do not count against each other.

    Parameters
    ----------
    result
        A result, or a window of it.
    robots
        If any are given, only pairs that one of these belongs to.

    Returns
    -------
    Nearest or None
        The distance is 0 where bodies overlap, and the time then the first one. None if there is no sample or no pair,
        or a follower has no outline.
    """
    followers = outlined_followers(result)
    if not followers or not result.sizes["time"]:
        return None
    names, time = list(followers), result["time"].values
    owner = _owners(followers)
    one, other = np.triu_indices(len(owner), k=1)
    counts = owner[one] != owner[other]
    if robots:
        chosen = np.array([name in robots for name in names])[owner]
        counts &= chosen[one] | chosen[other]
    one, other = one[counts], other[counts]
    if not len(one):
        return None
    found = (math.inf, 0, 0, 0)
    for block in blocks(len(time), len(owner)):
        with np.errstate(invalid="ignore"):  # the cosine of a heading that is not finite
            bodies = _bodies(own.within(block) for own in followers.values())
        if (nowhere := _without_place(bodies, one, other)) is not None:
            found = (math.nan, block.start + nowhere[0], *nowhere[1:])
            break
        if found[0] > 0:
            near = _smallest(bodies, one, other, found[0])
            found = (near[0], block.start + near[1], *near[2:]) if near[0] < found[0] else found
    distance, sample, i, j = found
    return Nearest(distance, (names[owner[i]], names[owner[j]]), float(time[sample]))


def nearest_bodies(followers: Mapping[str, Outlined]) -> Floats:
    """Return the distance (T, N) from the bodies of each follower to the nearest other follower's; NaN without a place.

    Parameters
    ----------
    followers
        At least two, at the same samples.
    """
    owner = _owners(followers)
    with np.errstate(invalid="ignore"):
        bodies = _bodies(followers.values())
    found: list[Floats] = []
    for block in blocks(len(bodies.cos), len(owner) ** 2):
        found.append(_nearest_of_each(bodies, owner, block))
    return np.concatenate(found)


def _nearest_of_each(bodies: _Bodies, owner: Indices, block: slice) -> Floats:
    x, y = bodies.middle[:, block]
    apart = np.sqrt((x[:, :, np.newaxis] - x[:, np.newaxis]) ** 2 + (y[:, :, np.newaxis] - y[:, np.newaxis]) ** 2)
    apart[:, owner[:, np.newaxis] == owner] = np.inf
    apart[np.isnan(apart)] = np.inf
    # A middle lies within its body, so the nearest middle is not nearer than the nearest body.
    within = apart - (bodies.radius[:, np.newaxis] + bodies.radius) <= apart.min(axis=2, keepdims=True)
    within &= np.isfinite(apart)
    pairs = _Pairs(*np.nonzero(within))
    of_bodies = np.full(apart.shape[:2], np.inf)
    np.fmin.at(
        of_bodies,
        (pairs.sample, pairs.one),
        bodies.distances(pairs._replace(sample=pairs.sample + block.start), np.inf),
    )
    nearest = np.full((len(x), owner[-1] + 1), np.inf)
    for body, follower in enumerate(owner.tolist()):
        np.minimum(nearest[:, follower], of_bodies[:, body], out=nearest[:, follower])
    return np.where(np.isinf(nearest), np.nan, nearest)


class _Pairs(NamedTuple):
    """Pairs of bodies at some samples: the sample and the numbers of both bodies, each (pairs,)."""

    sample: Indices
    one: Indices
    other: Indices

    def chosen(self, which: NDArray[np.bool_] | Indices) -> _Pairs:
        return _Pairs(self.sample[which], self.one[which], self.other[which])


def _owners(followers: Mapping[str, Outlined]) -> Indices:
    """Return the number of the follower that has each body."""
    return np.array([number for number, own in enumerate(followers.values()) for part in own.outline if part.collides])


@dataclass(frozen=True)
class _Bodies:
    """The bodies of all followers, one after the other.

    Attributes
    ----------
    corners : ndarray
        In the body's frame, from the middle of a circle about it, (2, n, bodies); the last one may be repeated.
    radius : ndarray
        Of that circle.
    middle : ndarray
        Of that circle over time, (2, T, bodies).
    cos, sin : ndarray
        Of the body's heading, (T, bodies).
    """

    corners: Floats
    radius: Floats
    middle: Floats
    cos: Floats
    sin: Floats

    def bounds(self, pairs: _Pairs) -> Floats:
        """Return lower bounds (pairs,) of the distances: the gaps along the lines from middle to middle."""
        x, y = self.middle[:, pairs.sample, pairs.other] - self.middle[:, pairs.sample, pairs.one]
        apart = np.sqrt(x**2 + y**2)
        reach = self._reach(pairs.sample, pairs.one, x, y) + self._reach(pairs.sample, pairs.other, -x, -y)
        bounds: Floats = np.full_like(apart, -np.inf)
        np.subtract((1 - _ROUNDING) * apart, reach / np.where(apart > 0, apart, 1.0), out=bounds, where=apart > 0)
        return bounds

    def _reach(self, samples: Indices, bodies: Indices, x: Floats, y: Floats) -> Floats:
        """Return how far bodies reach from their middles in directions (x, y), times the length of these."""
        cos, sin = self.cos[samples, bodies], self.sin[samples, bodies]
        ahead, left = cos * x + sin * y, cos * y - sin * x
        corners = self.corners[..., bodies]
        reach: Floats = (corners[0] * ahead + corners[1] * left).max(axis=0)
        return reach

    def distances(self, pairs: _Pairs, limit: float) -> Floats:
        """Return the distances (pairs,); above a limit a lower bound of them."""
        origin = self.middle[:, pairs.sample, pairs.one]  # near both, so that no digit is lost far away from (0, 0)
        one = self._place(pairs.sample, pairs.one, origin)
        other = self._place(pairs.sample, pairs.other, origin)
        found = convex.gaps(one, other)
        apart = np.flatnonzero((found >= 0) & (found <= limit))
        found[apart] = convex.distances(one[..., apart], other[..., apart])
        return np.maximum(found, 0.0)

    def _place(self, samples: Indices, bodies: Indices, origin: Floats) -> Floats:
        """Return the corners (2, n, pairs) of bodies at some samples, from an origin (2, pairs)."""
        cos, sin = self.cos[samples, bodies], self.sin[samples, bodies]
        x, y = self.corners[..., bodies]
        east, north = self.middle[:, samples, bodies] - origin
        return np.stack([east + cos * x - sin * y, north + sin * x + cos * y])


def _bodies(followers: Iterable[Outlined]) -> _Bodies:
    corners, middles, headings = [], [], []
    for follower in followers:
        for part, frame in zip(follower.outline, frames(follower.outline, follower.pose), strict=True):
            if part.collides:
                points = np.array(part.corners)
                middle = (points.min(axis=0) + points.max(axis=0)) / 2
                corners.append(points - middle)
                middles.append(frame.place(middle)[..., 0, :])
                headings.append(frame.heading)
    most = max(map(len, corners))
    padded = np.stack([np.pad(points, ((0, most - len(points)), (0, 0)), "edge") for points in corners])
    heading = np.stack(headings, axis=1)
    return _Bodies(
        corners=np.ascontiguousarray(padded.transpose(2, 1, 0)),
        radius=np.sqrt(np.square(padded).sum(axis=-1).max(axis=1)),
        middle=np.ascontiguousarray(np.stack(middles, axis=1).transpose(2, 0, 1)),
        cos=arrays.cos(heading),
        sin=arrays.sin(heading),
    )


def _without_place(bodies: _Bodies, one: Indices, other: Indices) -> tuple[int, int, int] | None:
    """Return the first sample at which a body of some pair has no place, and the pair."""
    placed = (np.abs(bodies.middle) < _NOWHERE).all(axis=0) & np.isfinite(bodies.cos)
    for sample in np.flatnonzero(~placed.all(axis=1)):
        pairs = np.flatnonzero(~(placed[sample, one] & placed[sample, other]))
        if len(pairs):
            return int(sample), int(one[pairs[0]]), int(other[pairs[0]])
    return None


def _smallest(bodies: _Bodies, one: Indices, other: Indices, below: float) -> tuple[float, int, int, int]:
    """Return the smallest distance below a limit, at which sample, and of which pair; of equal ones the first."""
    x, y = bodies.middle[:, 0]
    apart = np.sqrt((x[one] - x[other]) ** 2 + (y[one] - y[other]) ** 2)  # a middle lies within its body
    limit = float((1 + _ROUNDING) * apart.min())
    if limit < below:
        best = _smallest_below(bodies, one, other, limit)
        if best[0] < limit:
            return best
    return _smallest_below(bodies, one, other, below)


def _smallest_below(bodies: _Bodies, one: Indices, other: Indices, below: float) -> tuple[float, int, int, int]:
    """Return the same: ever tighter and dearer lower bounds leave ever fewer pairs for the exact distance."""
    best = (below, 0, 0, 0)
    length = max(_SAMPLES, _PAIRS // len(one))
    for start in range(0, bodies.middle.shape[1], length):
        near = _near(bodies, one, other, slice(start, start + length), best[0])
        if not len(near.sample):
            continue
        least = bodies.bounds(near)
        limit = min(best[0], float(bodies.distances(near.chosen(least.argsort()[:1]), best[0])[0]))
        near = near.chosen(least <= limit)
        found = bodies.distances(near, limit)
        if len(found) and found.min() < best[0]:
            k = found.argmin()
            best = float(found[k]), int(near.sample[k]), int(near.one[k]), int(near.other[k])
        if best[0] == 0:
            break
    return best


def _near(bodies: _Bodies, one: Indices, other: Indices, block: slice, limit: float) -> _Pairs:
    """Return the pairs, at samples of a block, that may be as near as a limit by the circles about their bodies.

    A pair is left out at once where circles about all places of its bodies in the block are farther apart.
    """
    x, y = bodies.middle[:, block]
    mean_x, mean_y = x.mean(axis=0), y.mean(axis=0)
    spread = np.sqrt((x - mean_x) ** 2 + (y - mean_y) ** 2).max(axis=0) + bodies.radius
    apart = np.sqrt((mean_x[one] - mean_x[other]) ** 2 + (mean_y[one] - mean_y[other]) ** 2)
    close = np.flatnonzero(apart - spread[one] - spread[other] <= limit)
    one, other = one[close], other[close]
    apart = np.sqrt((x[:, one] - x[:, other]) ** 2 + (y[:, one] - y[:, other]) ** 2)
    sample, pair = np.nonzero(apart - (bodies.radius[one] + bodies.radius[other]) <= limit)
    return _Pairs(block.start + sample, one[pair], other[pair])
