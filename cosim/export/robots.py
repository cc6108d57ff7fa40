"""The robots of a result as a tree of frames: where each is, and the parts that turn against it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cosim.export.courses import own_names
from cosim.results.outlines import outlines_of
from cosim.results.result import Result
from cosim.scenario.scenario import LEADER
from cosim.vehicle.outline import Outline, Point

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Moving:
    """A frame that turns against another one of the same robot.

    Attributes
    ----------
    name, on : str
        Its name, and that of the other; "" for the robot's own frame.
    at : Point
        Its origin in the other [m].
    angle : ndarray (T,)
        Its heading in the other [rad].
    """

    name: str
    on: str
    at: Point
    angle: Floats = field(repr=False)


@dataclass(frozen=True)
class Shape:
    """A part to be drawn: the name of its frame, "" for the robot's own, and its corners there [m]."""

    name: str
    frame: str
    corners: tuple[Point, ...]
    wheel: bool


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot over time.

    Attributes
    ----------
    id : str
        Its id; "leader" for the leader.
    x, y, heading : ndarray (T,)
        Its pose [m, rad]: that of its reference point, and of the part there.
    measured : tuple of ndarray or None
        The same as measured.
    speed : ndarray (T,)
        The forward velocity of its reference point [m/s].
    turning : ndarray (T,)
        The rate of its heading [rad/s], as central differences of it.
    moving : tuple of Moving
        The frames of parts that turn against it or each other; a part comes after the one that carries it.
    shapes : tuple of Shape
        Its outline; empty if it has none.
    """

    id: str
    x: Floats = field(repr=False)
    y: Floats = field(repr=False)
    heading: Floats = field(repr=False)
    measured: tuple[Floats, Floats, Floats] | None
    speed: Floats = field(repr=False)
    turning: Floats = field(repr=False)
    moving: tuple[Moving, ...]
    shapes: tuple[Shape, ...]


def robots_of(result: Result) -> list[Robot]:
    """Return the leader and the followers of a result."""
    outlines = outlines_of(result)
    robots = enumerate((LEADER, *result.robots))
    return [_robot(result, robot, row, outlines.get(robot, ())) for row, robot in robots]


def _robot(result: Result, robot: str, row: int, outline: Outline) -> Robot:
    pose = _entries(result, "pose", row)
    names = list(pose)
    turned_by = outline[0].turned_by if outline else tuple(names[2:3])
    x, y, heading = pose[names[0]], pose[names[1]], _sum(pose, turned_by)
    measured = _entries(result, "measured_pose", row)
    frames: dict[str, tuple[str, Point, tuple[str, ...]]] = {}  # of each part: its frame, its place there, its heading
    moving: list[Moving] = []
    shapes = []
    for part in outline:
        on, (left, ahead), carried_by = frames.get(part.on, ("", (0.0, 0.0), turned_by))
        at = (left + part.at[0], ahead + part.at[1])
        if Counter(part.turned_by) != Counter(carried_by):
            moving.append(Moving(part.name, on, at, _difference(pose, part.turned_by, carried_by)))
            on, at = part.name, (0.0, 0.0)
        frames[part.name] = (on, at, part.turned_by)
        corners = tuple((at[0] + x, at[1] + y) for x, y in part.corners)
        shapes.append(Shape(part.name, on, corners, wheel=not part.collides))
    return Robot(
        id=robot,
        x=x,
        y=y,
        heading=heading,
        measured=(measured[names[0]], measured[names[1]], _sum(measured, turned_by)) if measured else None,
        speed=_speed(result, row, x, y, heading),
        turning=_rate(result["time"].values, _unwrapped(heading)),
        moving=tuple(moving),
        shapes=tuple(shapes),
    )


def _entries(result: Result, signal: str, row: int) -> dict[str, Floats]:
    """Return the components of a signal of a vehicle by its own names for them; none if it is not in the result."""
    name = signal if row else (signal.replace("pose", "leader_pose") if "pose" in signal else f"leader_{signal}")
    if name not in result:
        return {}
    variable = result[name]
    values = variable.values[:, row - 1] if row else variable.values
    names = own_names(result, variable, row)
    return {own: values[:, k] for k, own in enumerate(names) if own is not None}


def _sum(pose: dict[str, Floats], names: tuple[str, ...]) -> Floats:
    first, *others = [pose[name] for name in names] or [np.zeros_like(next(iter(pose.values())))]
    return sum(others, start=first)


def _difference(pose: dict[str, Floats], names: tuple[str, ...], less: tuple[str, ...]) -> Floats:
    ours, theirs = Counter(names) - Counter(less), Counter(less) - Counter(names)
    own = _sum(pose, tuple(ours.elements()))
    return own - _sum(pose, tuple(theirs.elements())) if theirs else own


def _speed(result: Result, row: int, x: Floats, y: Floats, heading: Floats) -> Floats:
    """Return the recorded velocity v; central differences of the place, if there is none."""
    velocity = _entries(result, "velocity", row)
    if "v" in velocity and not np.isnan(velocity["v"]).all():
        return velocity["v"]
    time = result["time"].values
    return np.cos(heading) * _rate(time, x) + np.sin(heading) * _rate(time, y)


def _unwrapped(heading: Floats) -> Floats:
    """Return a heading that counts its turns, as that of an FMU may not; gaps stay."""
    found, known = heading.copy(), np.isfinite(heading)
    found[known] = np.unwrap(heading[known])
    return found


def _rate(time: Floats, values: Floats) -> Floats:
    rate: Floats = np.gradient(values, time) if len(time) > 1 else np.zeros_like(values)
    return rate
