"""What a figure shows over time, as plain data: a panel for each quantity that the run has."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.results.body_distance import nearest_bodies
from cosim.results.display_units import displayed
from cosim.results.expectations.distance import BODIES, REFERENCE_POINTS
from cosim.results.expectations.recorded import units_by_component
from cosim.results.groups import GROUPS, group_of
from cosim.results.outlines import outlined_followers
from cosim.results.result import Result, by_robot
from cosim.storage import blocks
from cosim.vehicle.outline import Outline

Floats: TypeAlias = NDArray[np.float64]

_DRAWN_OTHERWISE = {"pose", "range", "bearing", "desired_range", "desired_bearing"}
"""Signals of followers that the paths, the errors and the angles show."""
_ESTIMATED = {"speed_estimate": ("velocity", 0), "steering_rate_estimate": ("velocity", 1)}
"""The signal that an estimate is of, and the place among its components, where its name does not say so."""
_COMPARISONS, _FEWEST = 20_000, 20
"""Pairs of bodies, and samples, among which a panel looks for the nearest ones."""


@dataclass(frozen=True)
class Panel:
    """A quantity over time.

    Attributes
    ----------
    title, unit : str
        Its name in words, and the unit of its numbers.
    time : ndarray
        The times [s], (T,).
    courses : ndarray
        A course for each follower, (T, N), NaN where it has no number; (T, 0) if it is not recorded.
    leader : ndarray or None
        The leader's course (T,), if it has one.
    signal, component : str
        The signal of the result that it shows as it is; empty if it shows none.
    factor : float
        What the signal's numbers are multiplied by.
    """

    title: str
    unit: str
    time: Floats
    courses: Floats
    leader: Floats | None = None
    signal: str = ""
    component: str = ""
    factor: float = 1.0

    @property
    def constant(self) -> bool:
        """Whether no follower's number changes."""
        return bool(((self.courses == self.courses[:1]) | np.isnan(self.courses)).all())


def panels(result: Result) -> tuple[Panel, ...]:
    """Return the panels of all that the followers of a run have, of any law and kind of vehicle, by groups.

    Estimates of recorded signals and measured poses are shown as their errors.
    """
    groups: dict[str, list[Panel]] = {group: [] for group in GROUPS}
    for name in _courses(result):
        groups[group_of(name, result[name].attrs)] += of_signal(result, name)
    groups["motion"] += [*_angles(result), *_distances(result)]
    return tuple(panel for group in groups.values() for panel in group)


def panels_by_sample(result: Result) -> Iterator[Panel]:
    """Yield the panels whose numbers follow from those of the same sample alone and cost little: not the distances."""
    for name in _courses(result):
        yield from of_signal(result, name)
    yield from _angles(result)


def paper_panels(result: Result) -> tuple[Panel, ...]:
    """Return the panels (c) to (h) of the paper's Figure 6, two in a row; one of a signal that a run lacks is empty."""

    def one(title: str, name: str, place: int = 0) -> Panel:
        found = of_signal(result, name)[place : place + 1] if name in result else []
        time = result["time"].values
        return replace(found[0], title=title) if found else Panel(title, "", time, np.empty((len(time), 0)))

    command = "torque" if "torque" in result else "command"
    first, second, *_ = (*result.components(command), "", "")
    return (
        one("(c) range error", "range_error"),
        one(f"(d) {command} as applied, {first}", command),
        one("(c) bearing error", "bearing_error"),
        one(f"(d) {command} as applied, {second}", command, 1),
        one("(e) error of the estimated range", "range_estimate"),
        one("(f) error of the estimated v", "speed_estimate"),
        one("(e) error of the estimated bearing", "bearing_estimate"),
        one("(f) error of the estimated omega", "steering_rate_estimate"),
        one("(g) Frobenius norm of the weights", "weight_norm"),
        one("(h) estimate of the robust gain", "gain_estimate"),
    )


def _courses(result: Result) -> list[str]:
    """Return the followers' signals over time; without commands of laws that are applied as they are."""
    found = []
    for name, signal in result.data_vars.items():
        applied = name.removesuffix("_command")
        if not {"time", "robot"} <= set(signal.dims) or name in _DRAWN_OTHERWISE:
            continue
        if applied == name or applied not in result or not _equal(signal.values, result[applied].values):
            found.append(name)
    return found


def _equal(one: Floats, other: Floats) -> bool:
    return one.shape == other.shape and np.array_equal(one, other, equal_nan=True)


# Signals ----------------------------------------------------------------------------------------------------


def of_signal(result: Result, name: str) -> list[Panel]:
    """Return the panels of a signal: one for each component."""
    if name.startswith("measured_") and (true := name.removeprefix("measured_")) in result:
        return _deviations(result, name, true)
    found = _components(result, name)
    true, place = _ESTIMATED.get(name, (name.removesuffix("_estimate"), 0))
    if true == name or true not in result or "robot" not in result[true].dims:
        return found
    estimated = _components(result, true)[place : place + len(found)]
    errors = [
        replace(panel, title=f"error of {panel.title}", courses=actual.courses - panel.courses, signal="")
        for panel, actual in zip(found, estimated, strict=False)
        if panel.unit == actual.unit
    ]
    if len(errors) < len(found) or all(np.isnan(panel.courses).all() for panel in errors):
        return found  # it is the estimate of something else, or of what the law of another follower tells
    return errors


def _components(result: Result, name: str) -> list[Panel]:
    signal, labels = result[name], result.components(name)
    units = units_by_component(labels, str(signal.attrs.get("units", "")))
    courses = by_robot(signal)
    courses = courses.reshape(*courses.shape[:2], -1)
    leader = _of_leader(result, name, len(labels))
    found = []
    for k, label in enumerate(labels):
        unit, factor = displayed(units[label])
        found.append(
            Panel(
                title=f"{_words(name)} {label}".strip(),
                unit="" if unit == "1" else unit,
                time=result["time"].values,
                courses=factor * courses[..., k],
                leader=None if leader is None else factor * leader[:, k],
                signal=name,
                component=label,
                factor=factor,
            )
        )
    return found


def _of_leader(result: Result, name: str, components: int) -> Floats | None:
    """Return the leader's course (T, components) of a signal that it has, too, if all are of one kind of vehicle."""
    its = f"leader_{name}"
    one_kind = "vehicle_kind" not in result or len(set(result["vehicle_kind"].values.tolist())) == 1
    if its not in result or not one_kind:
        return None
    course = result[its].values.reshape(result.sizes["time"], -1)
    return course if course.shape[1] == components else None


def _deviations(result: Result, name: str, true: str) -> list[Panel]:
    """Return how far measured components are from the true ones; angles by the shorter way."""
    found = []
    for panel, actual in zip(_components(result, name), _components(result, true), strict=False):
        deviation = panel.courses - actual.courses
        if panel.unit == "deg":
            deviation -= 360 * np.round(deviation / 360)
        title = f"error of measured {panel.component or _words(true)}"
        found.append(Panel(title, panel.unit, panel.time, deviation))
    return found


def _words(name: str) -> str:
    return name.replace("_", " ")


# What follows from poses ------------------------------------------------------------------------------------


def _angles(result: Result) -> Iterator[Panel]:
    """Yield the angles [deg] between the parts of each follower, such as those of steered wheels and of a hitch."""
    followers = outlined_followers(result) or {}
    turns = {robot: _turns(own.outline) for robot, own in followers.items()}
    for place in range(max(map(len, turns.values()), default=0)):
        courses, names = np.full((result.sizes["time"], len(turns)), np.nan), []
        for column, (robot, own) in enumerate(turns.items()):
            if place < len(own):
                name, ahead, behind = own[place]
                pose = followers[robot].pose
                courses[:, column] = np.degrees(sum(pose[one] for one in ahead) - sum(pose[one] for one in behind))
                names.append(name)
        yield Panel(f"angle of {' or '.join(dict.fromkeys(names))}", "deg", result["time"].values, courses)


def _turns(outline: Outline) -> list[tuple[str, tuple[str, ...], tuple[str, ...]]]:
    """Return what turns against the part that carries it: the name, and the angles to add and to subtract."""
    turned_by = {part.name: part.turned_by for part in outline}
    found: dict[tuple[tuple[str, ...], tuple[str, ...]], str] = {}
    for part in outline:
        carrier = turned_by[part.on or part.name]
        ahead = tuple(entry for entry in part.turned_by if entry not in carrier)
        behind = tuple(entry for entry in carrier if entry not in part.turned_by)
        if ahead or behind:
            found.setdefault((ahead, behind), part.name if part.collides else "steering")
    return [(name, *angles) for angles, name in found.items()]


def _distances(result: Result) -> Iterator[Panel]:
    """Yield the distances from each follower to the nearest other one: of reference points, and of bodies.

    Those of many samples or followers are at evenly spaced samples.
    """
    if len(result.robots) < 2:
        return
    followers = outlined_followers(result) or {}
    bodies = sum(part.collides for own in followers.values() for part in own.outline)
    most = max(_COMPARISONS // max(bodies, len(result.robots)) ** 2, _FEWEST)
    samples = result.sizes["time"]
    chosen = np.unique(np.linspace(0, samples - 1, min(samples, most)).round().astype(int))
    time = result["time"].values[chosen]
    points = _nearest_points(result["pose"].values[chosen][..., :2])
    yield Panel("distance to the nearest follower", "m", time, points, signal=REFERENCE_POINTS)
    if followers:
        nearest = nearest_bodies({robot: own.within(chosen) for robot, own in followers.items()})
        yield Panel("distance to the nearest body", "m", time, nearest, signal=BODIES)


def _nearest_points(positions: Floats) -> Floats:
    """Return the distance (T, N) from each of some points (T, N, 2) to the nearest other one."""
    nearest, own = np.empty(positions.shape[:2]), np.arange(positions.shape[1])
    for block in blocks(len(positions), positions.shape[1] ** 2):
        x, y = np.moveaxis(positions[block], -1, 0)
        squares = (x[:, :, np.newaxis] - x[:, np.newaxis]) ** 2
        squares += (y[:, :, np.newaxis] - y[:, np.newaxis]) ** 2
        squares[:, own, own] = np.inf
        squares[np.isnan(squares)] = np.inf
        nearest[block] = np.sqrt(squares.min(axis=2))
    return np.where(np.isinf(nearest), np.nan, nearest)
