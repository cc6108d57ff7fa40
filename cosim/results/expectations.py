"""What must hold for a run to pass: checked before the run, judged after it."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NoReturn

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from cosim.errors import FormationError, InputError, nearest
from cosim.master.recorder import Channel
from cosim.results.metrics import figure_of, settling_time, smallest_distance
from cosim.results.verdict import Verdict
from cosim.scenario.scenario import LEADER, Expectation, Scenario
from plants import UnitError, units

DERIVED = {"range": "m", "bearing": "rad", "range_error": "m", "bearing_error": "rad"}
"""Signals of every follower that follow from what is recorded, with their units."""

_BOUNDED = ("rms", "peak", "final", "itae")
_TOLERANCE = 1e-9
"""Of a window's ends [s]: a communication point is a rounded product."""


# Before the run ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Recorded:
    """What a run will record under one name.

    Attributes
    ----------
    units : dict
        The unit by the component's name; of a signal that has no components, by "".
    robots : tuple of str
        The followers that have it; only "leader" for a signal of the leader.
    tells_singularity : bool
        Whether something is singular where it is zero.
    """

    units: Mapping[str, str]
    robots: tuple[str, ...]
    tells_singularity: bool = False


def recorded(
    channels: Iterable[Channel],
    labels: Mapping[str, Sequence[str]],
    followers: Sequence[str],
    owners: Mapping[str, Sequence[str]],
) -> dict[str, Recorded]:
    """Return what expectations can be about.

    Parameters
    ----------
    channels
        What is recorded.
    labels
        The components' names by the dimension, such as those of ``pose_component``.
    followers
        The followers' ids.
    owners
        For each signal that not every follower has, who has it.
    """
    known = {name: Recorded({"": unit}, tuple(followers)) for name, unit in DERIVED.items()}
    for channel in channels:
        components = next((labels[dim] for dim in channel.dims if dim != "robot"), ("",))
        known[channel.name] = Recorded(
            units=_by_component(components, channel.units),
            robots=tuple(owners.get(channel.name, followers)) if "robot" in channel.dims else (LEADER,),
            tells_singularity=bool(channel.singular_at_zero),
        )
    return known


def check(scenario: Scenario, known: Mapping[str, Recorded]) -> None:
    """Check that every expectation of a scenario can be judged when it has run.

    Parameters
    ----------
    scenario
        The scenario.
    known
        What its run will record.

    Raises
    ------
    InputError
        An expectation is about a signal, component or follower that is not there, its bound has a unit that does not
        fit, its window holds no sample, or what it compares with cannot be run; with the place in the scenario.
    """
    for expectation in scenario.expectations:
        if expectation.kind == "settled":
            _check_bound(expectation, "s", "the time")
        elif expectation.kind == "distance":
            if len(scenario.followers) < 2:
                _refuse(expectation, "a single follower has no distance to another")
            _check_bound(expectation, "m", "the bound of the distance")
            _check_window(expectation, scenario)
        elif expectation.kind == "regular":
            telling = {robot for signal in known.values() if signal.tells_singularity for robot in signal.robots}
            if not telling:
                _refuse(
                    expectation,
                    "no follower has a controller that tells how near a singularity is: leave <regular> out",
                )
            _check_robots(expectation, telling, "controller that tells how near a singularity is")
            _check_window(expectation, scenario)
        else:
            unit = _check_signal(expectation, known)
            if expectation.kind == "compare":
                _check_bound(expectation, "1", "the factor")
                _check_other(expectation, scenario, unit)
            else:
                _check_bound(expectation, unit, f"the bound of the {expectation.kind} of {_subject(expectation)!r}")
            _check_window(expectation, scenario)


def _check_signal(expectation: Expectation, known: Mapping[str, Recorded]) -> str:
    """Return the unit of the figure that an expectation is about."""
    name, component = expectation.signal, expectation.component
    if name not in known:
        _refuse(expectation, f"the result has no signal {name!r}: {nearest(name, list(known))}")
    signal = known[name]
    if component not in signal.units:
        components = [key for key in signal.units if key]
        if not components:
            _refuse(expectation, f"the signal {name!r} has no components: leave component={component!r} out")
        if not component:
            _refuse(expectation, f"the signal {name!r} needs component=..., one of {', '.join(components)}")
        _refuse(expectation, f"the signal {name!r} has no component {component!r}: {nearest(component, components)}")
    if signal.robots == (LEADER,) and expectation.robots:
        _refuse(expectation, f"the signal {name!r} is the leader's: leave robots=... out")
    _check_robots(expectation, signal.robots, f"signal {name!r}")
    return _unit_of_figure(_measure(expectation), signal.units[component])


def _check_robots(expectation: Expectation, having: Collection[str], what: str) -> None:
    if not having:
        _refuse(expectation, f"no follower has a {what}")
    for robot in expectation.robots:
        if robot not in having:
            _refuse(expectation, f"{robot!r} has no {what}; those that have: {', '.join(sorted(having))}")


def _check_bound(expectation: Expectation, unit: str, what: str) -> None:
    try:
        bound = units.convert(expectation.bound, expectation.unit, unit)
    except UnitError as error:
        _refuse(expectation, f"{what}, which is in {unit}: {error}")
    if not math.isfinite(bound):
        _refuse(expectation, f"{what} is not a finite number")
    if expectation.kind in _BOUNDED and bound <= 0:
        _refuse(expectation, f"{what} is not greater than zero, so it cannot hold")
    if expectation.kind == "distance" and bound <= 0:
        _refuse(expectation, f"{what} is not greater than zero, so it would hold whatever happens")


def _check_window(expectation: Expectation, scenario: Scenario) -> None:
    first = math.ceil((expectation.start - _TOLERANCE) / scenario.step)
    last = min(math.floor((expectation.stop + _TOLERANCE) / scenario.step), scenario.ticks)
    if last - first + 1 < (2 if _measure(expectation) == "itae" else 1):
        _refuse(
            expectation,
            f"the window from {expectation.start:g} s to {expectation.stop:g} s holds too few of the samples of "
            f"{scenario.path.name}, which are {scenario.step:g} s apart",
        )


def _check_other(expectation: Expectation, scenario: Scenario, unit: str) -> None:
    """Check that the other scenario can be run, and has the same signal over the same window."""
    from cosim.master.setup import set_up  # which calls this module

    path = _other(expectation)
    if path.exists() and scenario.path.exists() and path.samefile(scenario.path):
        _refuse(expectation, "a scenario cannot be compared with itself")
    try:
        other = _read_other(path, expectation.untrusted)
        with ExitStack() as cleanup:
            known = set_up(other, cleanup, {}).signals
    except InputError as error:
        _refuse(expectation, f"the other scenario is wrong: {error}")
    if expectation.stop > other.horizon + _TOLERANCE:
        _refuse(expectation, f"the window ends at {expectation.stop:g} s, but {path.name} at {other.horizon:g} s")
    try:
        same_unit = _check_signal(expectation, known)
        _check_window(expectation, other)
        units.convert(1.0, same_unit, unit)
    except InputError as error:
        _refuse(expectation, f"in the other scenario, {path.name}: {error.message}")
    except UnitError as error:
        _refuse(expectation, f"in the other scenario, {path.name}, {_subject(expectation)!r} has another unit: {error}")


def _refuse(expectation: Expectation, message: str) -> NoReturn:
    raise InputError(message, expectation.where) from None


# After the run ----------------------------------------------------------------------------------------------


def judge(scenario: Scenario, result: xr.Dataset) -> tuple[Verdict, ...]:
    """Return the verdicts on what a scenario expects; other scenarios that are compared with are run.

    Parameters
    ----------
    scenario
        A scenario whose expectations `check` has accepted.
    result
        Its result, complete.

    Raises
    ------
    RunInterrupted
        The user pressed Ctrl-C while another scenario ran.
    """
    return verdicts_on(scenario.expectations, result, run_others=True)


def verdicts_on(expectations: Iterable[Expectation], result: xr.Dataset, *, run_others: bool) -> tuple[Verdict, ...]:
    """Return the verdict on each expectation and follower; on an expectation about the team, one.

    A follower whose controller has no such signal is left out. A comparison with another scenario has no figure if that
    is not to be run.
    """
    return tuple(verdict for expectation in expectations for verdict in _judge(expectation, result, run_others))


def _judge(expectation: Expectation, result: xr.Dataset, run_others: bool) -> list[Verdict]:
    if expectation.kind == "settled":
        return [_settled(expectation, result, robot) for robot in _followers(expectation, result)]
    if expectation.kind == "distance":
        return [_distance(expectation, result.sel(time=_window(expectation)))]
    if expectation.kind == "regular":
        return _regular(expectation, result)
    if expectation.kind == "compare":
        return [_compare(expectation, result, run_others)]
    return _bounded(expectation, result)


def _settled(expectation: Expectation, result: xr.Dataset, robot: str) -> Verdict:
    settled = settling_time(result.sel(robot=robot), expectation.range_band, expectation.bearing_band)
    figure = math.nan if settled is None else units.convert(settled, "s", expectation.unit)
    text = (
        f"settled by {_written(expectation)} within {expectation.range_band:g} m and "
        f"{math.degrees(expectation.bearing_band):g} deg"
    )
    detail = "outside at the end of the run" if settled is None else ""
    return _at_most(expectation, text, robot, figure, detail, tolerance=_TOLERANCE)


def _distance(expectation: Expectation, window: xr.Dataset) -> Verdict:
    found = smallest_distance(window, expectation.robots)
    text = f"distance between followers above {_written(expectation)}, {_span(expectation)}"
    if found is None:
        return _above(expectation, text, "", math.nan, "no two followers")
    distance, (one, other), time = found
    figure = units.convert(distance, "m", expectation.unit)
    detail = f"{one} and {other} at t = {time:.2f} s"
    return _above(expectation, text, "", figure, detail)


def _bounded(expectation: Expectation, result: xr.Dataset) -> list[Verdict]:
    relation, verdict = ("above", _above) if expectation.kind == "least" else ("below", _below)
    text = f"{expectation.kind} {_subject(expectation)} {relation} {_written(expectation)}, {_span(expectation)}"
    unit = _unit_of_figure(expectation.kind, _unit(expectation, result))
    verdicts = []
    for robot, (time, course) in _courses(expectation, result).items():
        found = units.convert(figure_of(expectation.kind, time, course, expectation.start), unit, expectation.unit)
        detail = ""
        if math.isnan(found):
            detail = "a sample is not a number"
        elif expectation.kind in ("peak", "least"):
            at = np.abs(course).argmax() if expectation.kind == "peak" else course.argmin()
            detail = f"at t = {time[at]:.2f} s"
        verdicts.append(verdict(expectation, text, robot, found, detail))
    return verdicts


def _regular(expectation: Expectation, result: xr.Dataset) -> list[Verdict]:
    """Judge each follower by the signal that comes nearest to zero, as measured by the signal's threshold."""
    telling = [name for name, signal in result.data_vars.items() if signal.attrs.get("singular_at_zero")]
    worst: dict[str, tuple[tuple[bool, float], Verdict]] = {}
    for name in telling:
        signal = result[name]
        threshold = float(signal.attrs.get("singular_below", 0.0))
        about = replace(expectation, signal=str(name), unit=str(signal.attrs["units"]), bound=threshold)
        for robot, (time, course) in _courses(about, result).items():
            if np.isnan(signal.sel(robot=robot).values).all():  # another robot's controller has it
                continue
            least, at, jumps = _nearness(course)
            told = f"{name} {'changes sign' if jumps else 'nearest to zero'} at t = {time[at]:.2f} s"
            verdict = _above(about, f"regular, {_span(expectation)}", robot, least, told)
            rank = (verdict.passed, least / threshold if threshold else math.inf)
            if robot not in worst or math.isnan(least) or rank < worst[robot][0]:
                worst[robot] = rank, verdict
    return [worst[robot][1] for robot in _followers(expectation, result) if robot in worst]


def _nearness(values: NDArray[np.float64]) -> tuple[float, int, bool]:
    """Return how near to zero a signal (T, ...) comes, zero if it jumps over it; at which sample; whether it jumps."""
    values = values.reshape(len(values), -1)
    jumps = np.flatnonzero(np.diff(np.signbit(values), axis=0).any(axis=1))
    if len(jumps):
        return 0.0, int(jumps[0]) + 1, True
    nearness = np.abs(values).min(axis=1)
    at = int(nearness.argmin())
    return float(nearness[at]), at, False


def _compare(expectation: Expectation, result: xr.Dataset, run_other: bool) -> Verdict:
    path, measure = _other(expectation), expectation.measure
    unit = _unit_of_figure(measure, _unit(expectation, result))
    own = _mean_figure(expectation, result)
    other = _other_result(path, expectation.untrusted) if run_other else None
    if isinstance(other, xr.Dataset):
        reference = units.convert(
            _mean_figure(expectation, other), _unit_of_figure(measure, _unit(expectation, other)), unit
        )
        told, fails = f"{path.name}: {f'{reference:.4g} {unit}'.removesuffix(' 1')}", expectation.fails
    else:  # not the failure that may be known, as nobody can tell whether the expectation holds
        why = (
            f"the run of {path.name} failed: {other}"
            if run_other
            else f"there is no run of {path.name} to compare with"
        )
        reference, told, fails = math.nan, why, ""
    text = (
        f"{measure} {_subject(expectation)} at most {expectation.bound:g} times that of {path.name}, "
        f"{_span(expectation)}"
    )
    about = replace(expectation, bound=expectation.bound * reference, unit=unit, fails=fails)
    return _at_most(about, text, "", own, told, tolerance=0.0)


def _mean_figure(expectation: Expectation, result: xr.Dataset) -> float:
    courses = _courses(expectation, result).values()
    return float(np.mean([figure_of(expectation.measure, time, course, expectation.start) for time, course in courses]))


def _read_other(path: Path, untrusted: tuple[Path, ...]) -> Scenario:
    """Read another scenario; what is expected of it is not followed."""
    from cosim.scenario.reader import read_scenario

    return replace(read_scenario(path, untrusted=untrusted), expectations=())


def _other_result(path: Path, untrusted: tuple[Path, ...]) -> xr.Dataset | FormationError:
    """Return the result of another scenario, or why there is none."""
    try:
        text = _read_other(path, untrusted).text
    except InputError as error:  # it has changed since it was checked
        return error
    return _outcome_of(path, untrusted, text)


@lru_cache(maxsize=2)  # results are large; expectations that share one stand next to each other
def _outcome_of(path: Path, untrusted: tuple[Path, ...], text: str) -> xr.Dataset | FormationError:
    """Return the result of another scenario, or why there is none; once in a process for the same resolved text."""
    from cosim.master.simulation import Simulation

    try:
        with Simulation(_read_other(path, untrusted)) as simulation:
            return simulation.run()
    except FormationError as error:
        return error


def _below(expectation: Expectation, text: str, robot: str, figure: float, detail: str) -> Verdict:
    margin = expectation.bound - figure
    return _verdict(expectation, text, robot, figure, detail, margin, margin > 0)


def _at_most(expectation: Expectation, text: str, robot: str, figure: float, detail: str, tolerance: float) -> Verdict:
    margin = expectation.bound - figure
    return _verdict(expectation, text, robot, figure, detail, margin, margin >= -tolerance)


def _above(expectation: Expectation, text: str, robot: str, figure: float, detail: str) -> Verdict:
    margin = figure - expectation.bound
    return _verdict(expectation, text, robot, figure, detail, margin, margin > 0)


def _verdict(
    expectation: Expectation, text: str, robot: str, figure: float, detail: str, margin: float, passed: bool
) -> Verdict:
    """Return a verdict on a figure in the unit of the expectation's bound."""
    return Verdict(
        expectation=text,
        robot=robot,
        figure=figure,
        bound=expectation.bound,
        unit="" if expectation.unit == "1" else expectation.unit,
        margin=margin,
        passed=passed,
        known_failure=expectation.fails,
        detail=detail,
        where=expectation.where,
    )


# The signal that an expectation is about --------------------------------------------------------------------


def _followers(expectation: Expectation, result: xr.Dataset) -> list[str]:
    return [str(robot) for robot in result["robot"].values if not expectation.robots or robot in expectation.robots]


def _window(expectation: Expectation) -> slice:
    return slice(expectation.start - _TOLERANCE, expectation.stop + _TOLERANCE)


def _courses(
    expectation: Expectation, result: xr.Dataset
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return times (T,) and values (T, ...) of the signal over the window by follower, if it has such a signal."""
    signal = result[expectation.signal]
    if expectation.component:
        (dim,) = (dim for dim in signal.dims if dim not in ("time", "robot"))
        signal = signal.sel({dim: expectation.component})
    if "robot" in signal.dims:
        courses = {robot: signal.sel(robot=robot) for robot in _followers(expectation, result)}
    else:
        courses = {LEADER: signal}
    having = {robot: course for robot, course in courses.items() if not np.isnan(course.values).all()}
    chosen = courses if expectation.robots or not having else having
    windows = {robot: course.sel(time=_window(expectation)) for robot, course in chosen.items()}
    return {robot: (window["time"].values, window.values) for robot, window in windows.items()}


def _unit(expectation: Expectation, result: xr.Dataset) -> str:
    signal = result[expectation.signal]
    if not expectation.component:
        return str(signal.attrs["units"])
    (dim,) = (dim for dim in signal.dims if dim not in ("time", "robot"))
    components = [str(label) for label in signal[dim].values]
    return _by_component(components, signal.attrs["units"])[expectation.component]


def _by_component(components: Sequence[str], text: str) -> dict[str, str]:
    """Return the units of a signal's components, which are written one after another, or once if all have the same."""
    several = text.split(", ")
    return dict(zip(components, several if len(several) == len(components) else [text] * len(components), strict=True))


def _measure(expectation: Expectation) -> str:
    return expectation.measure or expectation.kind


def _unit_of_figure(measure: str, unit: str) -> str:
    if measure != "itae":
        return unit
    numerator, slash, denominator = unit.partition("/")
    return f"{'s2' if unit == '1' else numerator + '.s2'}{slash}{denominator}"


def _subject(expectation: Expectation) -> str:
    return f"{expectation.component} of {expectation.signal}" if expectation.component else expectation.signal


def _written(expectation: Expectation) -> str:
    return f"{expectation.bound:g} {expectation.unit}".removesuffix(" 1")


def _span(expectation: Expectation) -> str:
    return f"{expectation.start:g} to {expectation.stop:g} s"


def _other(expectation: Expectation) -> Path:
    assert expectation.scenario is not None, "the reader demands it of <compare>"
    return expectation.scenario
