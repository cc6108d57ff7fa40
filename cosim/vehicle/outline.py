"""The outline of a vehicle: the convex polygons that are drawn to scale, and those of them that collide.

An outline is plain data, computed from a vehicle's geometry once; a pose places it. So a result can hold it, and a page
can draw it without the package that brings the kind of vehicle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plants import arrays

Floats = NDArray[np.float64]
Point: TypeAlias = tuple[float, float]

_ROUNDING = 1e-9
"""Part of its size by which a corner may lie inside of a polygon that counts as convex."""


@dataclass(frozen=True)
class Part:
    """A rigid part of a vehicle, seen from above: a body, or a wheel.

    Its own frame has x ahead and y to the left.

    Attributes
    ----------
    name : str
        Its name, such as ``body`` or ``trailer``.
    corners : tuple of Point
        Of a convex polygon, counter-clockwise, in its own frame [m].
    turned_by : tuple of str
        Entries of the pose whose sum is its heading, from X.
    on : str
        The part before it that carries it; empty: the origin of its frame is the reference point (x, y).
    at : Point
        The origin of its frame in that of the part that carries it [m].
    collides : bool
        Whether it counts for the distance of bodies; other parts are only drawn.
    """

    name: str
    corners: tuple[Point, ...]
    turned_by: tuple[str, ...]
    on: str = ""
    at: Point = (0.0, 0.0)
    collides: bool = True


Outline: TypeAlias = tuple[Part, ...]


class Frame(NamedTuple):
    """Where a part is over time: the origin of its frame (..., 2) [m] and its heading (...) [rad]."""

    origin: Floats
    heading: Floats

    def place(self, points: Sequence[Point] | Floats) -> Floats:
        """Return points (n, 2) of the part's frame in the plane, (..., n, 2)."""
        x, y = np.asarray(points, dtype=np.float64).reshape(-1, 2).T
        cos, sin = arrays.cos(self.heading)[..., np.newaxis], arrays.sin(self.heading)[..., np.newaxis]
        return self.origin[..., np.newaxis, :] + np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def frames(outline: Outline, pose: Mapping[str, Floats]) -> list[Frame]:
    """Return where each part of an outline is, from the entries of poses by their names, each (...) in SI units."""
    found: dict[str, Frame] = {}
    for part in outline:
        heading = sum((pose[entry] for entry in part.turned_by), start=np.zeros_like(pose["x"]))
        reference = np.stack([pose["x"], pose["y"]], axis=-1)
        origin = found[part.on].place([part.at])[..., 0, :] if part.on else reference
        found[part.name] = Frame(origin, heading)
    return list(found.values())


def placed(outline: Outline, pose: Mapping[str, Floats]) -> list[Floats]:
    """Return the corners (..., n, 2) [m] of each part of an outline for some poses, as `frames` takes them."""
    return [frame.place(part.corners) for part, frame in zip(outline, frames(outline, pose), strict=True)]


def box(rear: float, front: float, half_width: float) -> tuple[Point, ...]:
    """Return the corners of a rectangle along the x axis, which it lies about."""
    return (rear, -half_width), (front, -half_width), (front, half_width), (rear, half_width)


def wheels(axle: str, on: str, turned_by: tuple[str, ...], at: Point, radius: float) -> Outline:
    """Return the two wheels of an axle, which are only drawn, at (x, y) and (x, -y) of a part; 0.3 diameters wide."""
    x, y = at
    tread = box(-radius, radius, 0.3 * radius)
    return tuple(
        Part(f"{axle} {side} wheel".strip(), tread, turned_by, on, (x, place), collides=False)
        for side, place in (("left", y), ("right", -y))
    )


def outline_fault(outline: object, pose: Sequence[str]) -> str:
    """Return the fault of an outline of a kind whose pose has these entries, as the end of a sentence; empty if none.

    Parameters
    ----------
    outline
        What the kind has returned.
    pose
        The names of the entries of its pose.
    """
    if not (isinstance(outline, tuple) and outline and all(isinstance(part, Part) for part in outline)):
        return f"is {outline!r}: expected is a tuple of cosim.vehicle.outline.Part"
    before: list[str] = []
    for part in outline:
        if fault := _part_fault(part, before, pose):
            return f"has the part {part.name!r}, {fault}"
        before.append(part.name)
    if not any(part.collides for part in outline):
        return "has no part that collides: expected is one at least"
    return ""


def _part_fault(part: Part, before: Sequence[str], pose: Sequence[str]) -> str:
    if not part.name or part.name in before:
        return "whose name is empty or another's: expected is a name for each part"
    if part.on and part.on not in before:
        return f"which is on {part.on!r}: expected is the name of a part before it"
    if not part.on and tuple(part.at) != (0.0, 0.0):
        return f"which is on no other part but at {part.at}: expected is (0, 0), the reference point"
    for entry in part.turned_by:
        if entry not in pose[2:]:
            return f"which is turned by {entry!r}: expected is an angle of the pose, one of {', '.join(pose[2:])}"
    if not all(math.isfinite(number) for point in (*part.corners, part.at) for number in point):
        return "which has a coordinate that is not a finite number"
    return "" if _is_convex(part.corners) else "whose corners are not those of a convex polygon, counter-clockwise"


def _is_convex(corners: Sequence[Point]) -> bool:
    """Return whether every corner lies to the left of every edge or on it, and some to the left of each."""
    points = np.array(corners, dtype=np.float64)
    if points.ndim != 2 or len(points) < 3:
        return False
    edges = np.roll(points, -1, axis=0) - points
    offsets = points[np.newaxis] - points[:, np.newaxis]
    left = edges[:, np.newaxis, 0] * offsets[..., 1] - edges[:, np.newaxis, 1] * offsets[..., 0]
    size = np.ptp(points, axis=0).max() ** 2
    return bool((left >= -_ROUNDING * size).all() and (left.max(axis=1) > _ROUNDING * size).all())
