"""Verdicts on a recorded drive: those of a run, but for what the recording does not have."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from cosim.master.setup import Setup
from cosim.recordings.series import Floats
from cosim.results.expectations import Kind, RunOther, understood
from cosim.results.expectations.recorded import DERIVED
from cosim.results.expectations.subject import Subject
from cosim.results.result import Result
from cosim.results.verdict import Verdict
from cosim.scenario.scenario import LEADER, Scenario
from cosim.vehicle.kind import Kind as VehicleKind

_SHOWN = 3
"""How many robots are named for which something is missing, where the team is judged."""


def judged(scenario: Scenario, setup: Setup, result: Result, run_other: RunOther) -> tuple[Verdict, ...]:
    """Return the verdict on each expectation and follower; on an expectation about the team, one.

    An expectation that needs samples that the recording does not have is not judged, and does not hold. One that holds
    whatever the missing samples would be is judged.
    """
    return tuple(
        verdict
        for kind in map(understood, scenario.expectations)
        for verdict in list(_verdicts(kind, setup, result, run_other)) or [kind.nothing_to_judge]
    )


def _verdicts(kind: Kind, setup: Setup, result: Result, run_other: RunOther) -> Iterator[Verdict]:
    lacking = {robot: why for robot in _concerned(kind, setup, result) if (why := _lacking(kind, setup, result, robot))}
    if not kind.by_any and any(name not in result for name in kind.signals(setup.signals)):
        yield from (kind.not_judged(robot, why) for robot, why in lacking.items())
        return
    for verdict in kind.judge(result, run_other):
        why = lacking.pop(verdict.robot, "") if verdict.robot else _together(list(lacking.values()))
        if not verdict.robot:
            lacking.clear()
        yield verdict if not why or (verdict.passed and kind.holds_with_gaps) else kind.not_judged(verdict.robot, why)
    yield from (kind.not_judged(robot, why) for robot, why in lacking.items())


def _together(reasons: Sequence[str]) -> str:
    more = [f"and {len(reasons) - _SHOWN} more"] if len(reasons) > _SHOWN else []
    return "; ".join([*reasons[:_SHOWN], *more])


def _concerned(kind: Kind, setup: Setup, result: Result) -> list[str]:
    """Return the robots on whom there is a verdict."""
    subjects = _subjects(kind)
    names = [subjects[0].signal] if subjects else kind.signals(setup.signals)
    owners = [setup.signals[name].robots for name in names]
    if all(robots == (LEADER,) for robots in owners):
        return [LEADER]
    having = [robot for robot in kind.followers(result) if any(robot in robots for robots in owners)]
    return [robot for robot in having if not any(one.is_own(subjects[0], robot) for one in subjects[1:])]


def _lacking(kind: Kind, setup: Setup, result: Result, robot: str) -> str:
    """Return what the recording lacks of a robot, in words; empty if nothing that is needed."""
    samples = kind.deciding(result)
    reasons = (
        _missing(kind, setup, result, name, whose, components, samples)
        for (name, whose), components in _needed(kind, setup, robot).items()
    )
    return next(filter(None, reasons), "")


def _needed(kind: Kind, setup: Setup, robot: str) -> dict[tuple[str, str], set[str]]:
    """Return whose signals a verdict on a robot needs, and which components; all of them if none is named."""
    subjects = _subjects(kind) or [Subject(name) for name in sorted(kind.signals(setup.signals))]
    needed: dict[tuple[str, str], set[str]] = {}
    for one in subjects:
        having = setup.signals[one.signal].robots
        whose = LEADER if having == (LEADER,) else one.robot or robot
        if whose in having:
            needed.setdefault((one.signal, whose), set()).update(filter(None, [one.component]))
    return needed


def _missing(
    kind: Kind, setup: Setup, result: Result, name: str, robot: str, components: Collection[str], samples: slice
) -> str:
    if name not in result:
        return f"the recording has no {name} of {robot}"
    for component, course in _courses(kind, setup, result, name, robot, components).items():
        absent = np.isnan(course)
        if not absent[samples].any():
            continue
        about = f"{component} of the {name} of {robot}" if component else f"{name} of {robot}"
        if name in DERIVED and absent.all():
            return f"{about} cannot be computed: {_cause(setup, result, robot)}"
        if absent.all():
            return f"the recording has no {about}"
        time = result["time"].values[samples]
        gone = time[absent[samples]]
        return f"the recording has no {about} at {len(gone)} of {len(time)} ticks, {gone[0]:.12g} to {gone[-1]:.12g} s"
    return ""


def _courses(
    kind: Kind, setup: Setup, result: Result, name: str, robot: str, components: Collection[str]
) -> Mapping[str, Floats]:
    """Return the numbers of a signal that are needed, by the component's name."""
    values = result[name].values if robot == LEADER else result.of_robot(name, robot)
    if values.ndim == 1:
        return {"": values}
    labels = list(setup.signals[name].units)
    own = _own_columns(setup, result[name].dims[-1], robot)
    chosen = list(range(len(labels))) if own is None else list(own)
    if kind.of_places:
        chosen = chosen[:2]
    if components:
        chosen = sorted(labels.index(component) for component in components)
    return {labels[column]: values[:, column] for column in chosen}


def _subjects(kind: Kind) -> list[Subject]:
    """Return what it is about, and what is subtracted from that; nothing if it has no such subject."""
    found, subject = [], getattr(kind, "subject", None)
    while isinstance(subject, Subject):
        found.append(subject)
        subject = subject.minus
    return found


def _own_columns(setup: Setup, dim: str, robot: str) -> tuple[int, ...] | None:
    """Return the columns that a robot's kind of vehicle has; None of a signal in which all have the same."""
    columns = setup.columns
    groups = {
        "pose_component": columns.pose,
        "velocity_component": columns.velocity,
        f"{columns.commands}_component": columns.command,
    }
    return groups[dim].of[_kind(setup, robot).name] if dim in groups else None


def _kind(setup: Setup, robot: str) -> VehicleKind:
    return next(one.kind for one in (setup.leader, *setup.followers) if one.name == robot)


def _cause(setup: Setup, result: Result, robot: str) -> str:
    """Return which entry of a pose is missing, so that nothing can be computed from poses."""
    for whose in (robot, LEADER):
        poses = result["leader_pose"].values if whose == LEADER else result.of_robot("pose", whose)
        roles, own = _kind(setup, whose).pose, setup.columns.pose.of[_kind(setup, whose).name]
        needed = list(zip(roles, own, strict=True))[: 3 if whose == LEADER else None]
        for role, column in needed:
            if np.isnan(poses[:, column]).all():
                hint = '; map it, or state from="scenario" for a virtual leader' if whose == LEADER else ""
                return f"the recording has no {role.name} of the pose of {whose}{hint}"
    return "the recording never has the poses of both robots at one tick"
