"""A run in a few figures, with its verdicts."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cosim.clock import in_seconds, whole
from cosim.errors import InputError
from cosim.results.body_distance import smallest_body_distance
from cosim.results.expectations import RunOther, judge
from cosim.results.follower_figures import FollowerFigures, follower_figures
from cosim.results.form import has_first_ticks, in_form
from cosim.results.json_numbers import without_nan
from cosim.results.logged import LoggedMessage, logged_messages
from cosim.results.metrics import smallest_distance
from cosim.results.passes import sign_changes
from cosim.results.provenance import Provenance
from cosim.results.result import Result
from cosim.results.verdict import Verdict
from cosim.scenario.reader import read_expectations
from cosim.scenario.scenario import LEADER, Scenario
from cosim.storage import blocks

if TYPE_CHECKING:
    import xarray as xr

PART = "part"
"""Status of a result that lacks samples of a run that reached its end."""


@dataclass(frozen=True)
class Summary:
    """The figures of a run.

    Attributes
    ----------
    status : str
        ``completed``, ``incomplete``; or ``part``: the run reached its end, but the result does not have all its ticks.
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
        """Whether the run reached its end, and all of it is in the result."""
        return self.status == "completed"

    @property
    def passed(self) -> bool:
        """Whether it is completed and all expectations hold."""
        return self.completed and all(verdict.passed for verdict in self.verdicts)

    def to_json(self) -> str:
        """Return the content of ``summary.json``."""
        told = asdict(self)
        told |= told.pop("provenance")
        told["passed"] = self.passed
        return json.dumps(without_nan(told), indent=2) + "\n"

    def verdicts_as_json(self) -> str:
        """Return the verdicts as a result keeps them in its attribute ``verdicts``."""
        return json.dumps(without_nan([asdict(verdict) for verdict in self.verdicts]))


def summarise(scenario: Scenario, result: xr.Dataset | Result, run_other: RunOther | None = None) -> Summary:
    """Return the figures of a run, complete or not, and the verdicts on a complete one (`expectations.judge`)."""
    result = Result.of(result)
    completed = result.attrs["status"] == "completed"
    verdicts = judge(scenario.expectations, result, run_other) if completed else ()
    return _summary(scenario.name, scenario.horizon, scenario.step, result, verdicts)


def summary_of(result: xr.Dataset | Result) -> Summary:
    """Return the summary of a result, of `cosim.run` or read from a file; nothing is run for it.

    The verdicts are read from the result if ``formation run`` has judged it. Otherwise the expectations of its scenario
    are judged now; a ``<compare>`` then has no figure and does not hold, as its other scenario is not run. A result
    that lacks samples of its run has no verdicts, and has not passed.

    Raises
    ------
    InputError
        It is not the result of a run, or its scenario's text cannot be read.
    """
    result = in_form(Result.of(result))
    told = result.attrs
    try:
        horizon, step = float(told["horizon"]), float(told["step"])
        lacking = _lacking(horizon, step, result) if told["status"] == "completed" else ""
        if lacking:
            verdicts: tuple[Verdict, ...] = ()
        elif "verdicts" in told:
            verdicts = tuple(Verdict.of(data) for data in json.loads(told["verdicts"]))
        elif told["status"] == "completed":
            file = Path(Provenance.of(told).file or told["scenario_name"])
            verdicts = judge(read_expectations(told["scenario"], file), result, run_other=None)
        else:
            verdicts = ()
        summary = _summary(told["scenario_name"], horizon, step, result, verdicts)
        return replace(summary, status=PART, notes=(lacking, *summary.notes)) if lacking else summary
    except KeyError as error:
        raise InputError(f"this is not the result of a run: {error.args[0]!r} is missing in it") from None
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(f"this is not the result of a run: {type(error).__name__}: {error}") from None


def _summary(name: str, horizon: float, step: float, result: Result, verdicts: tuple[Verdict, ...]) -> Summary:
    time = result["time"].values
    nearest, bodies = smallest_distance(result), smallest_body_distance(result)
    messages, left_out = logged_messages(result)
    told = Provenance.of(result.attrs)
    return Summary(
        scenario=name,
        status=result.attrs["status"],
        end_time=float(time[-1]) if len(time) else 0.0,
        followers=follower_figures(horizon, step, result),
        smallest_distance=nearest.distance if nearest else None,
        smallest_distance_between=nearest.between if nearest else None,
        smallest_distance_of_bodies=bodies.distance if bodies else None,
        smallest_distance_of_bodies_between=bodies.between if bodies else None,
        notes=(
            *_given(told),
            *_singularities(result),
            *_lost_turns(result),
            *json.loads(result.attrs["plant_messages"]),
        ),
        verdicts=verdicts,
        title=result.attrs["title"],
        provenance=told,
        messages=messages,
        messages_left_out=left_out,
    )


def _lacking(horizon: float, step: float, result: Result) -> str:
    """Return why a result does not have all ticks of a run with this horizon and step [s]; empty if it has them."""
    time, ticks = result["time"].values, whole(horizon / step)
    if ticks is not None and len(time) == ticks + 1 and has_first_ticks(result):
        return ""
    window = f", {in_seconds(float(time[0]))} to {in_seconds(float(time[-1]))}" if len(time) else ""
    return (
        f"the result has not all ticks of its run, 0 to {in_seconds(horizon)} in steps of {step:.12g} s, but "
        f"{len(time)} samples{window}: nothing is judged"
    )


def _given(told: Provenance) -> tuple[str, ...]:
    """Say which robots a program drove, which neither the scenario nor its changes tell."""
    return tuple(
        f"{robot}: a program gave commands in place of "
        f"{'the scenario' if robot == LEADER else 'its controller'}, first at t = {in_seconds(first)}"
        f"{'' if first == last else f' and last at t = {in_seconds(last)}'}; no command repeats this run"
        for robot, (first, last) in told.given.items()
    )


def _singularities(result: Result) -> tuple[str, ...]:
    """Say which robots crossed a singularity, which a step that jumps over it hides otherwise, or came near one."""
    notes = []
    time = result["time"].values
    for name, signal in result.data_vars.items():
        meaning, below = signal.attrs.get("singular_at_zero"), signal.attrs.get("singular_below", 0.0)
        for robot in result.robots if meaning else ():
            values = result.of_robot(name, robot)
            values = values if values.ndim > 1 else values[:, np.newaxis]
            changes, change = sign_changes(values)
            near, least = _near(values, below)
            said = []
            if changes:
                said.append(f"changes sign {_times(changes, float(time[change]))}")
            if near is not None:
                said.append(
                    f"is within {below:g} of zero first at t = {in_seconds(time[near])}, "
                    f"nearest with {values[least][np.abs(values[least]).argmin()]:.2g} at t = {in_seconds(time[least])}"
                )
            if said:
                notes.append(f"{robot}: {name} {', and '.join(said)}; where it is zero, {meaning}")
    return tuple(notes)


def _times(number: int, first: float) -> str:
    return f"{number} times, first at t = {in_seconds(first)}" if number > 1 else f"once, at t = {in_seconds(first)}"


def _lost_turns(result: Result) -> tuple[str, ...]:
    """Say whose angles jump by a whole turn from one sample to the next, as those of some FMUs do."""
    notes = []
    time = result["time"].values
    robots = [(robot, "pose") for robot in result.robots]
    for robot, name in [(LEADER, "leader_pose"), *robots] if "leader_pose" in result else robots:
        pose = result[name].values if robot == LEADER else result.of_robot(name, robot)
        for component, course in zip(result.components(name)[2:], pose.T[2:], strict=True):  # after x and y
            if len(jumps := _jumps_of_a_turn(course)):
                when = _times(len(jumps), float(time[jumps[0]]))
                notes.append(
                    f"{robot}: {component} jumps by a whole turn {when}; "
                    "its plant must count turns, as controllers take the jump for motion"
                )
    return tuple(notes)


def _jumps_of_a_turn(course: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the samples of an angle (T,) that lie a turn, or nearly one, from the sample before."""
    found = []
    for block in blocks(len(course)):
        steps = np.abs(np.diff(course[block.start : block.stop + 1]))
        found.append(block.start + 1 + np.flatnonzero(np.abs(steps - 2 * math.pi) < 0.5))
    return np.concatenate(found) if found else np.empty(0, dtype=np.intp)


def _near(values: NDArray[np.float64], below: float) -> tuple[int | None, int]:
    """Return the first sample of a course (T, numbers) that is near zero, None if none is, and the nearest one."""
    first: int | None = None
    at, least = 0, math.inf
    for block in blocks(len(values), values.shape[1]):
        nearness = np.abs(values[block]).min(axis=1)
        near = np.flatnonzero(nearness < below)
        if len(near):
            first = block.start + int(near[0]) if first is None else first
            nearest = near[nearness[near].argmin()]
            if nearness[nearest] < least:
                at, least = block.start + int(nearest), float(nearness[nearest])
    return first, at
