"""The outlines of robots in a result: written as coordinates of it, and read again.

A stranger draws the robots from these alone; `cosim.vehicle.outline` says what each fact means.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.results.result import Result, Variable
from cosim.vehicle.outline import Floats, Outline, Part

Coordinates = dict[str, Variable]

_PART = ("vehicle", "outline_part")
_ABOUT: Mapping[str, tuple[str, Callable[[Part], Any], Any]] = {
    "outline_name": ("name of the part; empty where the vehicle has no more", lambda part: part.name, ""),
    "outline_on": ("part that carries it; empty: it is at the reference point x, y", lambda part: part.on, ""),
    "outline_turned_by": (
        "entries of the pose whose sum is its heading, from X",
        lambda part: " ".join(part.turned_by),
        "",
    ),
    "outline_collides": (
        "1: counts for the distance of bodies, 0: is only drawn",
        lambda part: int(part.collides),
        0,
    ),
}
FORM: Mapping[str, tuple[tuple[str, ...], bool]] = {
    "outline_axis": (("outline_axis",), True),
    **{name: (_PART, isinstance(otherwise, str)) for name, (_, _, otherwise) in _ABOUT.items()},
    "outline_at": ((*_PART, "outline_axis"), False),
    "outline_corners": ((*_PART, "outline_corner", "outline_axis"), False),
}
"""By the name of a coordinate its dimensions, and whether it holds texts."""
_OWN = re.compile("outline_(part|corner|axis|name|on|turned_by|collides|at|corners)")


def is_taken(name: str) -> bool:
    """Return whether a name in a result is for outlines."""
    return _OWN.fullmatch(name) is not None


def coordinates_of(outlines: Mapping[str, Outline | None]) -> Coordinates:
    """Return the coordinates that hold the outlines of all robots, by their names; none if no robot has any."""
    rows = [outline or () for outline in outlines.values()]
    parts = max(map(len, rows), default=0)
    if not parts:
        return {}
    found: Coordinates = {
        "outline_axis": Variable(
            ("outline_axis",), np.array(["ahead", "left"]), {"long_name": "axis of a part's own frame"}
        )
    }
    for name, (about, fact, otherwise) in _ABOUT.items():
        table = [[*map(fact, row), *[otherwise] * (parts - len(row))] for row in rows]
        unit = {} if isinstance(otherwise, str) else {"units": "1"}
        found[name] = Variable(_PART, np.array(table), unit | {"long_name": about})
    at = np.full((len(rows), parts, 2), np.nan)
    most = max(len(part.corners) for row in rows for part in row)
    corners = np.full((len(rows), parts, most, 2), np.nan)
    for i, row in enumerate(rows):
        for j, part in enumerate(row):
            at[i, j] = part.at
            corners[i, j] = (*part.corners, *[part.corners[-1]] * (most - len(part.corners)))
    about = "origin of the part's frame in that of the part that carries it"
    found["outline_at"] = Variable((*_PART, "outline_axis"), at, {"units": "m", "long_name": about})
    about = "corners of the part in its own frame, counter-clockwise; the last one may be repeated"
    dims = (*_PART, "outline_corner", "outline_axis")
    found["outline_corners"] = Variable(dims, corners, {"units": "m", "long_name": about})
    return found


@dataclass(frozen=True)
class Outlined:
    """A vehicle that has an outline, in a result.

    Attributes
    ----------
    outline : Outline
        Its parts.
    pose : dict
        The entries of its pose by their names, each (T,).
    """

    outline: Outline
    pose: Mapping[str, Floats]

    def within(self, block: slice | NDArray[np.int_]) -> Outlined:
        """Return it at some of the samples."""
        return Outlined(self.outline, {name: course[block] for name, course in self.pose.items()})


def outlines_of(result: Result) -> dict[str, Outline]:
    """Return the outline of each vehicle in a result that has one; none in files of earlier versions."""
    if "outline_corners" not in result:
        return {}
    facts = {name: result[name].values for name in (*_ABOUT, "outline_at", "outline_corners")}
    found = {}
    for row, vehicle in enumerate(result["vehicle"].values):
        about = {name: values[row] for name, values in facts.items()}
        if outline := tuple(_part(about, j) for j, name in enumerate(about["outline_name"]) if name):
            found[str(vehicle)] = outline
    return found


def outlined_vehicles(result: Result) -> dict[str, Outlined]:
    """Return the vehicles of a result that have an outline, the leader among them."""
    outlines = outlines_of(result)
    found = {}
    for row, vehicle in enumerate(map(str, result["vehicle"].values) if outlines else ()):
        if vehicle in outlines:
            course = result.of_robot("pose", vehicle) if vehicle in result.robots else result["leader_pose"].values
            names = result["pose_name"].values[row]
            pose = {str(name): course[:, k] for k, name in enumerate(names) if name}
            found[vehicle] = Outlined(outlines[vehicle], pose)
    return found


def outlined_followers(result: Result) -> dict[str, Outlined] | None:
    """Return the followers of a result with their outlines; None if any has none, as in files of earlier versions."""
    found = outlined_vehicles(result)
    return {robot: found[robot] for robot in result.robots} if found.keys() >= set(result.robots) else None


def _part(about: Mapping[str, Any], j: int) -> Part:
    ahead, left = about["outline_at"][j]
    return Part(
        name=str(about["outline_name"][j]),
        corners=tuple((float(x), float(y)) for x, y in about["outline_corners"][j]),
        turned_by=tuple(str(about["outline_turned_by"][j]).split()),
        on=str(about["outline_on"][j]),
        at=(float(ahead), float(left)),
        collides=bool(about["outline_collides"][j]),
    )
