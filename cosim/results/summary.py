"""A run in a few figures, with its verdicts."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cosim.errors import InputError
from cosim.results.body_distance import smallest_body_distance
from cosim.results.expectations import RunOther, judge
from cosim.results.logged import LoggedMessage, logged_messages
from cosim.results.metrics import MEASURES, settling_time, smallest_distance
from cosim.results.provenance import Provenance
from cosim.results.result import Result
from cosim.results.verdict import Verdict
from cosim.scenario.reader import read_expectations
from cosim.scenario.scenario import Scenario

if TYPE_CHECKING:
    import xarray as xr

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
        Largest magnitude of a torque as applied [N.m]; NaN where the vehicle takes other commands.
    within_from : float or None
        From when on [s] both errors stay within these bands, however short that is; None if they do not at the end.
    """

    robot: str
    settling_time: float | None
    range_rms: float
    bearing_rms: float
    peak_torque: float
    within_from: float | None


@dataclass(frozen=True)
class Summary:
    """The figures of a run.

    Attributes
    ----------
    smallest_distance : float or None
        Between the reference points of any two followers, over the run [m]; None for a single follower.
    smallest_distance_of_bodies : float or None
        Between the bodies of any two, 0 if they overlap; None also if a follower has no outline.
    title : str
        The scenario's.
    provenance : Provenance
        The scenario's file, changes, seed, versions, and why the run did not reach its end.
    messages : tuple of LoggedMessage
        What the FMUs logged: the first messages of the result, and the last.
    messages_left_out : int
        Number of messages of the result between these.
    """

    scenario: str
    status: str
    end_time: float
    followers: tuple[FollowerFigures, ...]
    smallest_distance: float | None
    smallest_distance_between: tuple[str, str] | None
    notes: tuple[str, ...]
    verdicts: tuple[Verdict, ...]
    smallest_distance_of_bodies: float | None = None
    smallest_distance_of_bodies_between: tuple[str, str] | None = None
    title: str = ""
    provenance: Provenance = field(default_factory=Provenance)
    messages: tuple[LoggedMessage, ...] = ()
    messages_left_out: int = 0

    @property
    def completed(self) -> bool:
        """Whether the run reached its end."""
        return self.status == "completed"

    @property
    def passed(self) -> bool:
        """Whether the run reached its end and all expectations hold."""
        return self.completed and all(verdict.passed for verdict in self.verdicts)

    def to_json(self) -> str:
        """Return the content of ``summary.json``."""
        told = asdict(self)
        told |= told.pop("provenance")
        told["passed"] = self.passed
        return json.dumps(_without_nan(told), indent=2) + "\n"

    def verdicts_as_json(self) -> str:
        """Return the verdicts as a result keeps them in its attribute ``verdicts``."""
        return json.dumps(_without_nan([asdict(verdict) for verdict in self.verdicts]))


def summarise(scenario: Scenario, result: xr.Dataset | Result, run_other: RunOther | None = None) -> Summary:
    """Return the figures of a run, complete or not, and the verdicts on a complete one (`expectations.judge`)."""
    result = Result.of(result)
    completed = result.attrs["status"] == "completed"
    verdicts = judge(scenario.expectations, result, run_other) if completed else ()
    return _summary(scenario.name, scenario.horizon, scenario.step, result, verdicts)


def summary_of(result: xr.Dataset | Result) -> Summary:
    """Return the summary of a result, of `cosim.run` or read from a file; nothing is run for it.

    The verdicts are read from the result if ``formation run`` has judged it. Otherwise the expectations of its scenario
    are judged now; a ``<compare>`` then has no figure and does not hold, as its other scenario is not run.

    Raises
    ------
    InputError
        It is not the result of a run, or its scenario's text cannot be read.
    """
    result = Result.of(result)
    told = result.attrs
    try:
        if "verdicts" in told:
            verdicts = tuple(Verdict.of(data) for data in json.loads(told["verdicts"]))
        elif told["status"] == "completed":
            file = Path(Provenance.of(told).file or told["scenario_name"])
            verdicts = judge(read_expectations(told["scenario"], file), result, run_other=None)
        else:
            verdicts = ()
        return _summary(told["scenario_name"], float(told["horizon"]), float(told["step"]), result, verdicts)
    except KeyError as error:
        raise InputError(f"this is not the result of a run: {error.args[0]!r} is missing in it") from None
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(f"this is not the result of a run: {type(error).__name__}: {error}") from None


def _summary(name: str, horizon: float, step: float, result: Result, verdicts: tuple[Verdict, ...]) -> Summary:
    time = result["time"].values
    nearest, bodies = smallest_distance(result), smallest_body_distance(result)
    messages, left_out = logged_messages(result)
    return Summary(
        scenario=name,
        status=result.attrs["status"],
        end_time=float(time[-1]) if len(time) else 0.0,
        followers=tuple(_figures(horizon, step, result, robot) for robot in result.robots),
        smallest_distance=nearest.distance if nearest else None,
        smallest_distance_between=nearest.between if nearest else None,
        smallest_distance_of_bodies=bodies.distance if bodies else None,
        smallest_distance_of_bodies_between=bodies.between if bodies else None,
        notes=(*_singularities(result), *json.loads(result.attrs["plant_messages"])),
        verdicts=verdicts,
        title=result.attrs["title"],
        provenance=Provenance.of(result.attrs),
        messages=messages,
        messages_left_out=left_out,
    )


def _figures(horizon: float, step: float, result: Result, robot: str) -> FollowerFigures:
    time = result["time"].values
    settled = settling_time(result, robot, RANGE_BAND, BEARING_BAND)
    last_chance = time[-1] - SETTLED_PART * horizon if len(time) else 0.0
    steady = time >= (1 - STEADY_PART) * horizon - 0.5 * step
    torque = np.abs(result.of_robot("torque", robot)) if "torque" in result else np.zeros(0)
    torque = torque[~np.isnan(torque)]  # of a vehicle with fewer commands than another
    return FollowerFigures(
        robot=robot,
        settling_time=settled if settled is not None and settled <= last_chance else None,
        range_rms=MEASURES["rms"](time[steady], result.of_robot("range_error", robot)[steady]),
        bearing_rms=MEASURES["rms"](time[steady], result.of_robot("bearing_error", robot)[steady]),
        peak_torque=float(torque.max()) if torque.size else math.nan,
        within_from=settled,
    )


def _singularities(result: Result) -> tuple[str, ...]:
    """Say which robots crossed a singularity, which a step that jumps over it hides otherwise, or came near one."""
    notes = []
    time = result["time"].values
    for name, signal in result.data_vars.items():
        meaning, below = signal.attrs.get("singular_at_zero"), signal.attrs.get("singular_below", 0.0)
        for robot in result.robots if meaning else ():
            values = result.of_robot(name, robot)
            values = values.reshape(len(time), math.prod(values.shape[1:]))  # its components
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


def _without_nan(value: object) -> object:
    """Return the value with None for every number that JSON does not know."""
    if isinstance(value, dict):
        return {key: _without_nan(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
