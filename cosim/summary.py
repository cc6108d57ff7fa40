"""A run in a few figures, and whether it did what was expected."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import numpy as np
import xarray as xr

from cosim.errors import InputError, nearest
from cosim.scenario import Expectation, Scenario
from plants import UnitError, units

RANGE_BAND = 0.1
BEARING_BAND = math.radians(2.0)
STEADY_PART = 0.2
SETTLED_PART = 0.05


@dataclass(frozen=True)
class FollowerFigures:
    """How well one follower kept its place.

    Attributes
    ----------
    settling_time : float or None
        From when on [s] the range error stays within 0.1 m and the bearing error within 2 degrees; None if they do not
        for at least the last twentieth of the horizon.
    range_rms, bearing_rms : float
        Root mean square of the errors [m], [rad] over the last fifth of the horizon.
    peak_torque : float
        Largest magnitude of a torque as applied [N.m].
    """

    robot: str
    settling_time: float | None
    range_rms: float
    bearing_rms: float
    peak_torque: float


@dataclass(frozen=True)
class Verdict:
    """An expectation and what came of it; figures in the unit in which the bound is written."""

    expectation: str
    robot: str
    figure: float
    bound: float
    unit: str
    passed: bool


@dataclass(frozen=True)
class Summary:
    """The figures of a run.

    Attributes
    ----------
    smallest_distance : float or None
        Between the reference points of any two followers, over the run [m]; None for a single follower.
    """

    scenario: str
    status: str
    end_time: float
    followers: tuple[FollowerFigures, ...]
    smallest_distance: float | None
    smallest_distance_between: tuple[str, str] | None
    notes: tuple[str, ...]
    verdicts: tuple[Verdict, ...]

    @property
    def passed(self) -> bool:
        """Whether all that was expected holds."""
        return all(verdict.passed for verdict in self.verdicts)

    def to_json(self) -> str:
        """Return the content of ``summary.json``."""
        return json.dumps({**_without_nan(asdict(self)), "passed": self.passed}, indent=2) + "\n"


def summarise(scenario: Scenario, result: xr.Dataset) -> Summary:
    """Return the figures of a run, complete or not, and the verdicts on a complete one."""
    time = result["time"].values
    complete = result.attrs["status"] == "completed"
    distance, pair = _smallest_distance(result)
    return Summary(
        scenario=scenario.name,
        status=result.attrs["status"],
        end_time=float(time[-1]) if len(time) else 0.0,
        followers=tuple(_figures(scenario, result.sel(robot=robot)) for robot in result["robot"].values),
        smallest_distance=distance,
        smallest_distance_between=pair,
        notes=(*_singularities(result), *json.loads(result.attrs["plant_messages"])),
        verdicts=tuple(
            verdict for expectation in scenario.expectations if complete for verdict in _judge(expectation, result)
        ),
    )


def check_expectations(expectations: Sequence[Expectation], units_of: dict[str, str]) -> None:
    """Check that every expectation is about a signal that is recorded, with a bound in a unit that fits.

    Parameters
    ----------
    units_of
        Unit of each recorded signal that has one value a robot and time, by name.

    Raises
    ------
    InputError
        With the place in the scenario.
    """
    for expectation in expectations:
        if expectation.signal not in units_of:
            known = nearest(expectation.signal, list(units_of))
            message = f"{expectation.signal!r} is no signal with one value a robot and time: {known}"
            raise InputError(message, expectation.where)
        unit = units_of[expectation.signal]
        try:
            bound = units.convert(expectation.bound, expectation.unit, unit)
        except UnitError as error:
            raise InputError(
                f"the bound of {expectation.signal!r}, which is in {unit}: {error}", expectation.where
            ) from None
        if not math.isfinite(bound):
            raise InputError(f"the bound of {expectation.signal!r} is not a finite number", expectation.where)


def _figures(scenario: Scenario, follower: xr.Dataset) -> FollowerFigures:
    time = follower["time"].values
    range_error, bearing_error = follower["range_error"].values, follower["bearing_error"].values
    outside = (np.abs(range_error) > RANGE_BAND) | (np.abs(bearing_error) > BEARING_BAND)
    inside = time[np.flatnonzero(outside)[-1] + 1 :] if outside.any() else time
    last_chance = time[-1] - SETTLED_PART * scenario.horizon if len(time) else 0.0
    steady = time >= (1 - STEADY_PART) * scenario.horizon - 0.5 * scenario.step
    torque = np.abs(follower["torque"].values)
    return FollowerFigures(
        robot=str(follower["robot"].values),
        settling_time=float(inside[0]) if len(inside) and inside[0] <= last_chance else None,
        range_rms=_rms(range_error[steady]),
        bearing_rms=_rms(bearing_error[steady]),
        peak_torque=float(torque.max()) if torque.size else math.nan,
    )


def _smallest_distance(result: xr.Dataset) -> tuple[float | None, tuple[str, str] | None]:
    position = result["pose"].values[..., :2]
    robots = [str(robot) for robot in result["robot"].values]
    smallest: tuple[float | None, tuple[str, str] | None] = (None, None)
    for i, j in combinations(range(len(robots)), 2):
        if not len(position):
            break
        distance = float(np.min(np.hypot(*(position[:, i] - position[:, j]).T)))
        if smallest[0] is None or distance < smallest[0]:
            smallest = distance, (robots[i], robots[j])
    return smallest


def _singularities(result: xr.Dataset) -> tuple[str, ...]:
    """Say which robots crossed a singularity, which a step that jumps over it hides otherwise, or came near one."""
    notes = []
    time = result["time"].values
    for name, signal in result.data_vars.items():
        meaning, below = signal.attrs.get("singular_at_zero"), signal.attrs.get("singular_below", 0.0)
        for robot in result["robot"].values if meaning else ():
            values = signal.sel(robot=robot).values.reshape(len(time), math.prod(signal.shape[2:]))  # its components
            changes = np.flatnonzero(np.diff(np.signbit(values), axis=0).any(axis=1))
            nearness = np.abs(values).min(axis=1)
            near = np.flatnonzero(nearness < below)
            said = []
            if len(changes):
                times = f"{len(changes)} times, first" if len(changes) > 1 else "once,"
                said.append(f"changes sign {times} at t = {time[changes[0] + 1]:.2f} s")
            if len(near):
                least = near[nearness[near].argmin()]
                said.append(
                    f"is within {below:g} of zero first at t = {time[near[0]]:.2f} s, "
                    f"nearest with {values[least][np.abs(values[least]).argmin()]:.2g} at t = {time[least]:.2f} s"
                )
            if said:
                notes.append(f"{robot}: {name} {', and '.join(said)}; where it is zero, {meaning}")
    return tuple(notes)


def _judge(expectation: Expectation, result: xr.Dataset) -> list[Verdict]:
    signal = result[expectation.signal]
    window = signal.sel(time=slice(expectation.start - 1e-9, expectation.stop + 1e-9))
    verdicts = []
    for robot in result["robot"].values:
        figure = units.convert(_rms(window.sel(robot=robot).values), signal.attrs["units"], expectation.unit)
        verdicts.append(
            Verdict(
                expectation=f"rms {expectation.signal}, {expectation.start:g} to {expectation.stop:g} s",
                robot=str(robot),
                figure=figure,
                bound=expectation.bound,
                unit="" if expectation.unit == "1" else expectation.unit,
                passed=figure < expectation.bound,
            )
        )
    return verdicts


def _rms(values: np.ndarray[Any, Any]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else math.nan


def _without_nan(value: Any) -> Any:
    """Return the value with None for every number that JSON does not know."""
    if isinstance(value, dict):
        return {key: _without_nan(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
