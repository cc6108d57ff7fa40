"""From a recording to a result: its numbers at the ticks of a scenario, with everything that is computed from poses."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from collections.abc import Mapping as Table
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError, listed, printable
from cosim.master.content import checksums
from cosim.master.recorded_signals import courses_of_follower
from cosim.master.robot import RobotSetup
from cosim.master.setup import Setup
from cosim.master.supervised import whole_run
from cosim.master.who_is_who import texts, who_is_who
from cosim.moments import SECOND
from cosim.quantity import quantity
from cosim.recordings.bag import SUFFIXES, read_bag
from cosim.recordings.mapping import YAW, MappedRobot, Mapping, X, Y
from cosim.recordings.series import NO_UNIT, ClockGoesBack, Floats, Sampled, Series, sampled
from cosim.recordings.table import read_result, read_table
from cosim.recordings.wanted import Number, wanted_numbers
from cosim.results import provenance
from cosim.results.expectations.recorded import DERIVED, DERIVED_FROM, units_by_component
from cosim.results.result import Result, Variable
from cosim.scenario.scenario import LEADER, Scenario
from plants import UnitError, units

_TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Tracked:
    """What a recording has of a robot.

    Attributes
    ----------
    robot : str
        Its id.
    samples : int
        Samples of its place within the scenario's time.
    longest_gap : float
        The longest time between two of them [s].
    bridged, missing : int
        At how many ticks its pose is interpolated across a gap, and at how many there is none.
    """

    robot: str
    samples: int
    longest_gap: float
    bridged: int
    missing: int


@dataclass(frozen=True, eq=False)
class Drive:
    """A recorded drive.

    Attributes
    ----------
    result : Result
        The drive as a result of the scenario; NaN where the recording has nothing.
    start : int
        The time in the recording at which the scenario begins [ns].
    tracked : tuple of Tracked
        What there is of each robot.
    """

    result: Result
    start: int
    tracked: tuple[Tracked, ...]


def recorded_drive(path: Path, scenario: Scenario, setup: Setup, mapping: Mapping) -> Drive:
    """Return a recorded drive as a result of a scenario.

    Raises
    ------
    InputError
        The recording cannot be read, lacks what the mapping names, or has a clock or units that do not fit.
    """
    robots = (setup.leader, *setup.followers)
    bag, netcdf = _is_bag(path), path.suffix == ".nc" or (path / "result.nc").is_file()
    _refuse_other_times(path, mapping, bag, netcdf)
    wanted = list(wanted_numbers(scenario, setup, mapping, bag))
    given = [number.mapped for number in wanted]
    if bag:
        numbers = read_bag(path, given, by_header=mapping.clock != "log")
    else:
        numbers = read_result(path, given) if netcdf else read_table(path, given, mapping.time or "time")
    series = numbers.series
    found = [(number, series[number.mapped.place]) for number in wanted if number.mapped.place in series]
    start = _start(path, found, mapping, numbers.names)
    found = list(_moved(found, mapping.robots))
    ticks = scenario.clock.times
    values = {number: _sampled(path, number, one, ticks, start, mapping, setup) for number, one in found}
    values |= _beside_true(values)
    _refuse_outside(path, found, values, start)
    variables = dict(_variables(setup, values, scenario.ticks + 1))
    if (leader := mapping.robots.get(LEADER)) and leader.from_scenario:
        variables["leader_pose"] = _driven_leader(scenario, setup)
    variables |= _derived(setup, variables)
    notes = [*numbers.notes, *_notes(path, values)]
    attributes = _attributes(path, scenario, notes, start)
    result = Result(variables, _coordinates(scenario, setup, variables, robots), attributes)
    return Drive(result, start, tuple(_tracked(robots, values, variables)))


def _is_bag(path: Path) -> bool:
    return path.suffix in SUFFIXES or (path / "metadata.yaml").exists()


def _refuse_other_times(path: Path, mapping: Mapping, bag: bool, netcdf: bool) -> None:
    """Refuse what a mapping states of the time of another kind of recording."""
    kind = "a bag" if bag else "the result of a run" if netcdf else "a table"
    if mapping.time and (bag or netcdf):
        said = f'time="{mapping.time}" of <mapping> names a column of a table, and {path} is {kind}: leave it out'
        raise InputError(said, mapping.where)
    if mapping.clock and not bag:
        said = f'clock="{mapping.clock}" of <mapping> chooses a time of messages, and {path} is {kind}: leave it out'
        raise InputError(said, mapping.where)


# Time and units ---------------------------------------------------------------------------------------------


def _start(path: Path, found: Sequence[tuple[Number, Series]], mapping: Mapping, names: Sequence[str]) -> int:
    """Return the time in the recording at which the scenario begins [ns]; its names are those of the recording."""
    firsts: dict[str, int] = {}
    for number, series in found:
        if number.signal in DERIVED_FROM and (first := series.first) is not None:
            firsts[number.robot] = max(firsts.get(number.robot, first), first)
    if not firsts.keys() - {LEADER}:
        shown = printable(listed(names))
        raise InputError(
            f"the recording {path} has no pose of any follower of the scenario, but {shown or 'nothing'}: "
            "write a mapping that names its topics or columns (--map), see docs/robot_tools.md"
        )
    return max(firsts.values()) if mapping.start is None else mapping.start


def _refuse_outside(
    path: Path, found: Iterable[tuple[Number, Series]], values: Table[Number, Sampled], start: int
) -> None:
    """Refuse a recording that is over before the scenario begins, or begins after it."""
    if any(one.samples for number, one in values.items() if number.signal in DERIVED_FROM):
        return
    poses = [series for number, series in found if number.signal in DERIVED_FROM]
    first = min(one for series in poses if (one := series.first) is not None)
    last = max(one for series in poses if (one := series.last) is not None)
    raise InputError(
        f"the recording {path} has poses from {first / SECOND:.12g} s to {last / SECOND:.12g} s, and the scenario "
        f"would begin at its {start / SECOND:.12g} s: state another start"
    )


def _moved(found: Sequence[tuple[Number, Series]], robots: Table[str, MappedRobot]) -> Iterator[tuple[Number, Series]]:
    """Yield the numbers in the frame of all robots, with reference points where the kind of vehicle has them."""
    # A <signal> may be from the robot's topic, too, or be a "yaw"; what the topic itself gives has the robot's place.
    given = [(number, series) for number, series in found if _is_moved(number, robots.get(number.robot))]
    poses = {(number.robot, number.mapped.place.field): series.values for number, series in given}
    for number, series in found:
        robot, name, field = robots.get(number.robot), number.robot, number.mapped.place.field
        if robot is None or not _is_moved(number, robot):
            yield number, series
            continue
        yaw, (frame_x, frame_y, turn) = poses[name, YAW], robot.frame
        if field == YAW:
            yield number, Series(series.time, yaw + turn)
            continue
        x = poses[name, X] + robot.ahead * np.cos(yaw) - robot.left * np.sin(yaw)
        y = poses[name, Y] + robot.ahead * np.sin(yaw) + robot.left * np.cos(yaw)
        cos, sin = np.cos(turn), np.sin(turn)
        place = frame_x + cos * x - sin * y if field == X else frame_y + sin * x + cos * y
        yield number, Series(series.time, place)


def _is_moved(number: Number, robot: MappedRobot | None) -> bool:
    return robot is not None and robot.is_moved and number.mapped.where == robot.where


def _sampled(
    path: Path, number: Number, series: Series, ticks: Floats, start: int, mapping: Mapping, setup: Setup
) -> Sampled:
    values = _in_unit(path, number, series)
    entry = _pose_entry(setup, number)
    try:
        found = sampled(series.since(start), values, ticks, mapping.longest_gap, angle=entry is not None)
    except ClockGoesBack as error:
        raise InputError(
            f"the recording {path}: the time of {number.text} goes back by {error.by:.4g} s to {error.time:.12g} s of "
            "the scenario: it holds several drives, or a clock was set; cut it there, or record it anew"
        ) from None
    if entry is None:
        return found
    # Whole turns say nothing; the first heading is that nearest to the one at which the scenario begins.
    there = found.values[~np.isnan(found.values)]
    turns = np.round((there[0] - entry) / _TURN) if len(there) else 0.0
    return replace(found, values=found.values - _TURN * turns) if turns else found


def _beside_true(values: Table[Number, Sampled]) -> Iterator[tuple[Number, Sampled]]:
    """Yield measured angles with the whole turns of the true ones, where there are some at a common tick."""
    true = {
        (number.row, number.component): one.values for number, one in values.items() if number.signal in DERIVED_FROM
    }
    for number, one in values.items():
        if not number.signal.startswith("measured_") or number.unit != "rad":
            continue
        off = one.values - true.get((number.row, number.component), np.full(len(one.values), np.nan))
        known = np.flatnonzero(np.isfinite(off))
        if len(known):
            last = known[np.maximum(np.searchsorted(known, np.arange(len(off)), side="right") - 1, 0)]
            yield number, replace(one, values=one.values - _TURN * np.round(off[last] / _TURN))


def _pose_entry(setup: Setup, number: Number) -> float | None:
    """Return the initial value of an entry of a pose, a measured one too, that is an angle; None if it is none."""
    poses = {variable.name for variable in setup.result_variables if "pose_component" in variable.dims}
    if number.signal not in poses or number.unit != "rad":
        return None
    robot = (setup.leader, *setup.followers)[number.row]
    return robot.pose[[role.name for role in robot.kind.pose].index(number.component)]


def _in_unit(path: Path, number: Number, series: Series) -> Floats:
    """Return the values of a number in its unit."""
    mapped = number.mapped
    given = mapped.unit or ({NO_UNIT: "1", "": number.unit}.get(series.unit, series.unit))
    try:
        own, wanted = units.parse(given), units.parse(number.unit)
        if own.exponents != wanted.exponents:
            known = "has no unit" if series.unit == NO_UNIT and not mapped.unit else f"is in {given}"
            raise InputError(
                f"{mapped.place} of {path} {known}, but {number.text} needs a unit such as {number.unit}: "
                'state its true unit, in the first line of the table or by unit="..." in a mapping',
                mapped.where,
            )
        offset = quantity(mapped.offset, number.unit) if mapped.offset else 0.0
    except (UnitError, ValueError) as error:
        raise InputError(f"{mapped.place} of {path}: {error}", mapped.where) from None
    scale = mapped.factor * (own.factor / wanted.factor)
    values = series.values if scale == 1.0 else series.values * scale
    return values + offset if offset else values


# The result -------------------------------------------------------------------------------------------------


def _variables(setup: Setup, values: Table[Number, Sampled], samples: int) -> Iterator[tuple[str, Variable]]:
    for variable in setup.result_variables:
        those = {number: one for number, one in values.items() if number.signal == variable.name}
        if not those and variable.name not in DERIVED_FROM:
            continue
        array = np.full((samples, *variable.shape), np.nan)
        for number, one in those.items():
            own = array[:, number.row - 1] if "robot" in variable.dims else array
            (own if own.ndim == 1 else own[:, number.column])[:] = one.values
        yield variable.name, Variable(("time", *variable.dims), array, variable.attributes)


def _driven_leader(scenario: Scenario, setup: Setup) -> Variable:
    """Return the leader's motion in a run of the scenario."""
    with whole_run(scenario, setup) as simulation:
        return simulation.run_to_end()["leader_pose"]


def _derived(setup: Setup, variables: Table[str, Variable]) -> dict[str, Variable]:
    """Return range, bearing and errors, computed from poses as those of a run are."""
    pose, leader = variables["pose"].values, variables["leader_pose"].values
    samples = len(pose)
    found = np.full((len(DERIVED), samples, len(setup.followers)), np.nan)
    for row, robot in enumerate(setup.followers):
        own = pose[:, row][:, setup.columns.pose.of[robot.kind.name]]
        there = ~(np.isnan(own).any(axis=1) | np.isnan(leader[:, :3]).any(axis=1))
        before: Floats | None = None
        for part in _runs(there):
            courses = courses_of_follower(own[part], leader[part], setup.desired.q[part, row], robot.vehicle, before)
            if courses is not None:
                found[:, part, row] = courses
                before = courses[1, -1:]
    names = ("range", "bearing", "range_error", "bearing_error")
    return {
        name: Variable(("time", "robot"), course, {"units": DERIVED[name][0], "long_name": DERIVED[name][1]})
        for name, course in zip(names, found, strict=True)
    }


def _runs(mask: NDArray[np.bool_]) -> Iterator[slice]:
    """Yield the parts of a mask that are true throughout."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        yield slice(begin, end)


def _coordinates(
    scenario: Scenario, setup: Setup, variables: Table[str, Variable], robots: Sequence[RobotSetup]
) -> dict[str, Variable]:
    found = {
        "time": Variable(("time",), scenario.clock.times, {"units": "s", "long_name": "time"}),
        "robot": texts("robot", [robot.name for robot in setup.followers], "follower"),
        **{along: texts(along, labels) for along, labels in setup.columns.labels.items()},
    }
    for name, variable in variables.items():
        dim = variable.dims[-1]
        if dim not in found and dim.endswith("_component"):
            labels = list(setup.signals[name].units)
            found[dim] = texts(dim, labels)
            parts = list(units_by_component(labels, str(variable.attrs["units"])).values())
            found[f"{dim}_units"] = texts(dim, parts, f"unit of each component of {name}")
    return {**found, **who_is_who(scenario, robots, setup.fmus, ())}


def _attributes(path: Path, scenario: Scenario, notes: Sequence[str], start: int) -> dict[str, str | int | float]:
    return {
        "title": scenario.title,
        "scenario_name": scenario.name,
        "scenario": scenario.text,
        "status": "completed",
        "step": scenario.step,
        "horizon": scenario.horizon,
        "plants": "{}",
        "controllers": "[]",
        "plant_messages": json.dumps(list(notes)),
        "versions": json.dumps({"formation-cosim": version("formation-cosim")}),
        "files": json.dumps(checksums(scenario)),
        "recording": str(path),
        "recording_start": start / SECOND,
        **provenance.attributes(scenario.path, scenario.changes, None),
    }


def _notes(path: Path, values: Table[Number, Sampled]) -> Iterator[str]:
    """Say what the recording has that is not as it should be."""
    for number, one in values.items():
        if one.not_numbers:
            yield f"{path.name}: {one.not_numbers} samples of {number.text} are no numbers and are left out"
        if one.disordered:
            yield f"{path.name}: {one.disordered} samples of {number.text} were not in the order of time"


def _tracked(
    robots: Sequence[RobotSetup], values: Table[Number, Sampled], variables: Table[str, Variable]
) -> Iterator[Tracked]:
    for row, robot in enumerate(robots):
        name = "pose" if row else "leader_pose"
        pose = variables[name].values[:, row - 1] if row else variables[name].values
        missing = int(np.isnan(pose[:, :2]).any(axis=1).sum())
        own = [one for number, one in values.items() if number.signal == name and number.row == row]
        yield Tracked(
            robot.name,
            min((one.samples for one in own), default=0),
            max((one.longest_gap for one in own), default=0.0),
            max((one.bridged for one in own), default=0),
            missing,
        )
