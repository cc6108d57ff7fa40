"""Expectations, against results made by hand whose figures are known, and against runs."""

import errno
import json
import math
import signal
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import Mock

import numpy as np
import pytest
import xarray as xr

from cosim.cli import main, run
from cosim.errors import Failure, InputError, Location, OutputError, SimulationError
from cosim.kinds_by_element import kinds_in
from cosim.master import other_runs, setup, simulation
from cosim.master.other_runs import run_other
from cosim.master.prepared import Prepared
from cosim.master.segment import Segment
from cosim.master.simulation import Simulation
from cosim.results import expectations
from cosim.results.expectations import KINDS, Recorded, Recording, check, judge, recorded, understood
from cosim.results.files import load
from cosim.results.metrics import MEASURES, smallest_distance
from cosim.results.result import Result
from cosim.results.result_variable import ResultVariable
from cosim.results.verdict import Verdict
from cosim.scenario import grammar, reader
from cosim.scenario.grammar import children_of
from cosim.scenario.reader import read_scenario
from cosim.scenario.scenario import Expectation, Scenario
from cosim.tests.driving import FailsAt, watch
from plants import units

EXAMPLE = Path(__file__).with_name("example.xml")
HERE = Location("scenario.xml", 3, 5)
TIME = np.arange(5001) * 0.02
ZERO = np.zeros(5001)


BOUNDS = {"settled": "by", "least": "above", "distance": "above", "compare": "factor"}


def expecting(
    kind: str, bound: str = "", start: float = 0.0, stop: float = 100.0, robots: tuple[str, ...] = (), **attributes: str
) -> Expectation:
    """Return an expectation as it is written in an element."""
    given = {BOUNDS.get(kind, "below"): bound} if bound else {}
    return Expectation(kind, given | attributes, HERE, Path("folder"), start, stop, robots)


def no_other(path: Path) -> Recording:
    raise AssertionError(f"{path} is not to be set up")


def made_up(**signals: np.ndarray) -> xr.Dataset:
    """Return a result of the followers a, b and c at y = 0, 3 and 10; a signal (T, 3), or (T,) of a alone."""
    pose = np.zeros((5001, 3, 4))
    pose[:, :, 1] = [0.0, 3.0, 10.0]
    result = xr.Dataset(
        {
            "pose": (("time", "robot", "pose_component"), pose, {"units": "m, m, rad, rad"}),
            "leader_pose": (("time", "pose_component"), pose[:, 2], {"units": "m, m, rad, rad"}),
            "range_error": (("time", "robot"), np.zeros((5001, 3)), {"units": "m"}),
            "bearing_error": (("time", "robot"), np.zeros((5001, 3)), {"units": "rad"}),
            "torque": (("time", "robot", "torque_component"), np.zeros((5001, 3, 2)), {"units": "N.m"}),
        },
        {
            "time": TIME,
            "robot": ["a", "b", "c"],
            "pose_component": ["x", "y", "psi", "gamma"],
            "torque_component": ["tau_drive", "tau_steer"],
        },
        {"status": "completed", "plant_messages": "[]"},
    )
    for name, values in signals.items():
        if values.ndim == 1:
            values = np.stack([values, ZERO, ZERO], axis=1)
        result[name] = (("time", "robot"), values, result[name].attrs if name in result else {"units": "1"})
    return result


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return read_scenario(EXAMPLE)


@pytest.fixture
def verdicts() -> Callable[[Expectation, xr.Dataset], dict[str, Verdict]]:
    def judged(expectation: Expectation, result: xr.Dataset) -> dict[str, Verdict]:
        found = judge((expectation,), result, run_other=None)
        assert len({verdict.robot for verdict in found}) == len(found)
        return {verdict.robot: verdict for verdict in found}

    return judged


Judged = Callable[[Expectation, xr.Dataset], dict[str, Verdict]]


@pytest.mark.parametrize(
    ("expectation", "text"),
    [
        (
            expecting("rms", "0.12345678 m", 1234.567, 1234.572, signal="range_error"),
            "rms range_error below 0.12345678 m, 1234.567 to 1234.572 s",
        ),
        (
            expecting("settled", "1234.567 s", range="0.12345678 m", bearing="2 deg"),
            "settled by 1234.567 s within 0.12345678 m and 2 deg",
        ),
        (
            expecting("compare", "1.0000001", 0.1, 2000, measure="rms", signal="range_error", scenario="other.xml"),
            "rms range_error at most 1.0000001 times that of other.xml, 0.1 to 2000 s",
        ),
        (expecting("peak", "1e-5 MN", signal="force"), "peak force below 1e-05 MN, 0 to 100 s"),
        (expecting("least", "3", 3 * 0.1, signal="gap"), "least gap above 3, 0.3 to 100 s"),
    ],
)
def test_an_expectation_in_words_has_all_digits(expectation: Expectation, text: str) -> None:
    assert understood(expectation).text == text


def test_a_failure_names_the_very_time() -> None:
    assert str(Failure("follower_1", 12345.68, "", "it stopped")) == "follower_1 at t = 12345.68 s: it stopped"
    assert str(Failure("", 3 * 0.1, "", "interrupted")) == "interrupted at t = 0.3 s"


# Figures ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "figure"),
    [
        ("rms", math.sqrt(29 / 3)),
        ("peak", 5.0),
        ("final", 2.0),
        ("itae", 7.0),
        ("chatter", math.sqrt((25 + 49) / 2)),
        ("effort", 6.0),
        ("least", -5.0),
    ],
)
def test_figures_of_a_signal(kind: str, figure: float) -> None:
    """The integrand of itae is 0, 1 * 5, 2 * 2: trapezoids of 2.5 and 4.5; that of effort 0, 5, 2: 2.5 and 3.5."""
    values, time = np.array([0.0, -5.0, 2.0]), np.array([10.0, 11.0, 12.0])
    assert MEASURES[kind](time, values, 10.0) == pytest.approx(figure)
    assert math.isnan(MEASURES[kind](time[:0], values[:0]))
    assert math.isnan(MEASURES[kind](time, np.array([0.0, -5.0, math.nan])))


def test_itae_is_the_integral() -> None:
    assert MEASURES["itae"](TIME, np.exp(-TIME)) == pytest.approx(1.0, abs=1e-4)


def test_effort_is_the_integral_of_the_magnitude(verdicts: Judged) -> None:
    """Of 12 N.m that swing five times in the window: 12 N.m x 20 s x 2 / pi, whatever the sign and the unit."""
    torque = 12.0 * np.sin(2.0 * math.pi * 0.25 * TIME)
    expectation = expecting("effort", "0.2 kN.m.s", signal="torque", component="tau_drive", start=40.0, stop=60.0)
    result = made_up()
    result["torque"][:, 0, 0] = torque
    found = verdicts(expectation, result)["a"]
    assert found.figure == pytest.approx(1e-3 * 12.0 * 20.0 * 2.0 / math.pi, rel=1e-4)
    assert (found.passed, found.unit) == (True, "kN.m.s")


# Differences ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "figures"),
    [
        ({"component": "y", "minus_robot": "b"}, {"a": 3.0, "c": 7.0}),
        ({"component": "y", "minus_robot": "b", "robots": ("a",)}, {"a": 3.0}),
        ({"component": "y", "minus": "leader_pose"}, {"a": 10.0, "b": 7.0, "c": 0.0}),
        ({"component": "y", "minus_component": "x"}, {"a": 0.0, "b": 3.0, "c": 10.0}),
        ({"signal": "range_error_mm", "minus": "pose", "minus_component": "y"}, {"a": 2.0, "b": 1.0, "c": 8.0}),
    ],
)
def test_the_difference_of_two_signals(verdicts: Judged, given: dict[str, Any], figures: dict[str, float]) -> None:
    result = made_up(range_error_mm=np.full((5001, 3), 2000.0))
    result["range_error_mm"].attrs["units"] = "mm"
    found = verdicts(expecting("rms", "1 m", **{"signal": "pose", **given}), result)
    assert {robot: verdict.figure for robot, verdict in found.items()} == pytest.approx(figures)


def test_followers_that_lack_what_is_subtracted_are_left_out(verdicts: Judged) -> None:
    norm = np.stack([ZERO + 1, ZERO + 2, ZERO * math.nan], axis=1)
    found = verdicts(expecting("final", "9", signal="norm", minus="one"), made_up(norm=norm[:, ::-1], one=norm))
    assert {robot: verdict.figure for robot, verdict in found.items()} == {"b": 0.0}
    assert str(found["b"]).startswith("final norm minus one below 9")


# Verdicts ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("bound", "passed"), [("2 deg", True), ("0.9 deg", False), ("0.02 rad", True)])
def test_figure_and_margin_are_in_the_unit_of_the_bound(verdicts: Judged, bound: str, passed: bool) -> None:
    result = made_up(bearing_error=ZERO + math.radians(1.0))
    found = verdicts(expecting("rms", bound, signal="bearing_error", start=80.0), result)
    assert [verdict.passed for verdict in found.values()] == [passed, True, True]
    one = found["a"]
    number, unit = bound.split()
    assert one.unit == unit
    assert one.figure == pytest.approx(units.convert(math.radians(1.0), "rad", unit))
    assert one.margin == pytest.approx(float(number) - one.figure)
    assert one.where == HERE


@pytest.mark.parametrize(
    ("kind", "bound", "figure", "passed"),
    [
        ("rms", "1.5 m", math.sqrt(2), True),
        ("peak", "10 m", math.sqrt(51), True),
        ("peak", "700 cm", math.sqrt(51) * 100, False),
        ("final", "1 m", math.sqrt(51), False),
        ("least", "-1 mm", 0.0, True),
        ("least", "0 m", 0.0, False),
    ],
)
def test_a_window_includes_both_its_ends(verdicts: Judged, kind: str, bound: str, figure: float, passed: bool) -> None:
    errors = ZERO.copy()
    errors[[100, 150]] = math.sqrt(51)
    errors[[99, 151]] = 1000.0
    found = verdicts(expecting(kind, bound, signal="range_error", start=2.0, stop=3.0), made_up(range_error=errors))
    assert found["a"].figure == pytest.approx(figure)
    assert found["a"].passed is passed
    assert (found["a"].margin > 0) is passed


@pytest.mark.parametrize(("unit", "factor"), [("m.s2", 1.0), ("km.s2", 1e-3), ("m.min2", 1 / 3600)])
def test_itae_counts_time_from_the_start_of_its_window(verdicts: Judged, unit: str, factor: float) -> None:
    result = made_up(range_error=ZERO - 2.0)
    found = verdicts(expecting("itae", f"3 {unit}", signal="range_error", start=10.0, stop=12.0), result)
    assert found["a"].figure == pytest.approx(4.0 * factor)
    assert found["a"].passed is (factor < 1)


def test_a_component_of_a_signal(verdicts: Judged) -> None:
    result = made_up()
    result["pose"][30, 1, 3] = math.radians(-50)
    result["torque"][70, 2, 1] = 190.0
    found = verdicts(expecting("peak", "45 deg", signal="pose", component="gamma"), result)
    assert [verdict.passed for verdict in found.values()] == [True, False, True]
    assert found["b"].margin == pytest.approx(-5.0)
    assert found["b"].expectation == "peak gamma of pose below 45 deg, 0 to 100 s"
    assert found["b"].detail == "at t = 0.60 s"
    found = verdicts(expecting("peak", "200 N.m", signal="torque", component="tau_steer"), result)
    assert found["c"].margin == pytest.approx(10.0)


def test_a_signal_of_the_leader_has_one_verdict(verdicts: Judged) -> None:
    found = verdicts(expecting("final", "9 m", signal="leader_pose", component="y"), made_up())
    assert [(robot, verdict.figure, verdict.passed) for robot, verdict in found.items()] == [("leader", 10.0, False)]


def test_who_has_no_such_signal_is_left_out(verdicts: Judged) -> None:
    norm = np.stack([ZERO + 1, ZERO * math.nan, ZERO + 3], axis=1)
    expectation = expecting("peak", "2", signal="weight_norm")
    found = verdicts(expectation, made_up(weight_norm=norm))
    assert {robot: verdict.passed for robot, verdict in found.items()} == {"a": True, "c": False}
    assert found["c"].unit == ""
    assert list(verdicts(replace(expectation, robots=("a",)), made_up(weight_norm=norm))) == ["a"]


def test_what_is_not_a_number_does_not_hold(verdicts: Judged) -> None:
    norm = np.where(TIME == 50.0, math.nan, ZERO)
    for kind in ("peak", "rms", "final", "itae", "chatter", "effort", "least"):
        bound = {"least": "-2", "itae": "2 s2", "effort": "2 s"}.get(kind, "2")
        found = verdicts(expecting(kind, bound, signal="norm", stop=50.0), made_up(norm=norm))["a"]
        assert not found.passed, kind
        assert found.finding == "no figure (a; a sample is not a number)"
    assert verdicts(expecting("rms", "2", signal="norm", start=50.02), made_up(norm=norm))["a"].passed


def test_a_signal_without_any_number_is_still_of_those_who_have_it(verdicts: Judged) -> None:
    """A law that computes NaN throughout has the signal; a follower with another law does not."""
    nowhere = np.stack([ZERO + 1, ZERO * math.nan, ZERO * math.nan], axis=1)
    result = singular(made_up(det=nowhere, one=ZERO + 1), det=0.1)
    result["det"].attrs["robots"] = "a b"
    expected = {"a": True, "b": False}
    for expectation in (
        expecting("peak", "2", signal="det"),
        expecting("least", "0.5", signal="det"),
        expecting("regular"),
    ):
        assert {robot: one.passed for robot, one in verdicts(expectation, result).items()} == expected
    assert verdicts(expecting("regular"), result)["b"].detail == "det is not a number at t = 0.00 s"
    assert {robot: one.passed for robot, one in verdicts(expecting("regular", robots=("b",)), result).items()} == {
        "b": False
    }
    for difference in ({"signal": "one", "minus": "det"}, {"signal": "det", "minus": "one"}):
        assert {
            robot: one.passed for robot, one in verdicts(expecting("peak", "2", **difference), result).items()
        } == expected


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_is_infinite_does_not_hold(verdicts: Judged, sign: float) -> None:
    far = ZERO + sign * math.inf
    pose = np.zeros((5001, 3, 4))
    pose[:, 0, 0], pose[:, 1, 0] = far, ZERO
    result = singular(made_up(gap=far, det=np.stack([far, ZERO + 1, ZERO + 1], axis=1)), det=0.1)
    result["pose"].values[:] = pose
    for expectation in (
        *(expecting(kind, f"1 {MEASURES[kind].unit('1')}", signal="gap") for kind in MEASURES),
        expecting("distance", "1 m", robots=("a",)),
        expecting("regular"),
    ):
        verdict = next(iter(verdicts(expectation, result).values()))
        assert (verdict.passed, verdict.judged, verdict.outcome) == (False, True, "FAILS")
        assert verdict.detail.startswith("a sample is infinite")
        assert math.isnan(verdict.margin)


@pytest.mark.parametrize("infinite", ["own", "reference"])
def test_a_comparison_with_something_infinite_does_not_hold(infinite: str) -> None:
    results = {"own": made_up(), "reference": made_up()}
    results[infinite]["range_error"][9] = math.inf
    comparison = expecting("compare", "9", measure="peak", signal="range_error", scenario="other.xml")
    [verdict] = judge((comparison,), results["own"], lambda path: Result.of(results["reference"]))
    assert not verdict.passed
    assert verdict.detail.startswith("a sample is infinite, or too large; other.xml: ")
    assert math.isnan(verdict.margin)


def test_an_expectation_about_nobody_does_not_hold() -> None:
    """Such as the distance of a follower from itself, which no check lets through."""
    itself = expecting("peak", "1 m", signal="pose", component="x", minus_robot="a", robots=("a",))
    [verdict] = judge((itself,), made_up(), run_other=None)
    assert (verdict.robot, verdict.passed, verdict.judged) == ("", False, False)
    assert verdict.detail == "no follower has the signal, so that there is nothing to judge"


@pytest.mark.parametrize("without", [0, 1, 2])
def test_no_distance_is_the_smallest_where_one_is_not_a_number(without: int) -> None:
    result = made_up()
    result["pose"][7, without, 0] = math.nan
    nearest = smallest_distance(Result.of(result))
    assert nearest is not None
    assert math.isnan(nearest.distance)
    assert "abc"[without] in nearest.between


@pytest.mark.parametrize(
    ("last_outside", "by", "passed", "margin"),
    [(499, "10 s", True, 0.0), (500, "10 s", False, -0.02), (499, "1 min", True, 50 / 60), (5000, "99 s", False, None)],
)
def test_settled(verdicts: Judged, last_outside: int, by: str, passed: bool, margin: float | None) -> None:
    errors = ZERO.copy()
    errors[[3, last_outside]] = 0.11
    expectation = expecting("settled", by, range="0.1 m", bearing="2 deg")
    found = verdicts(expectation, made_up(range_error=errors))
    assert [verdict.passed for verdict in found.values()] == [passed, True, True]
    assert found["b"].figure == 0.0
    if margin is None:
        assert math.isnan(found["a"].margin)
        assert "outside at the end" in found["a"].finding
    else:
        assert found["a"].margin == pytest.approx(margin, abs=1e-9)
    outside = np.full(5001, math.radians(2.1))
    assert not verdicts(expectation, made_up(bearing_error=outside))["a"].passed


@pytest.mark.parametrize("by", ["10 s", "1e4 ms", "1e7 us", "1e10 ns", "0.1666666667 min", "0.16666666665 min"])
@pytest.mark.parametrize("last_outside", [498, 499, 500, 2499])
def test_settled_at_the_very_time_holds_in_every_unit(verdicts: Judged, by: str, last_outside: int) -> None:
    errors = ZERO.copy()
    errors[last_outside] = 0.11
    verdict = verdicts(expecting("settled", by, range="0.1 m", bearing="2 deg"), made_up(range_error=errors))["a"]
    assert verdict.passed is (last_outside < 500)
    assert (verdict.margin >= 0.0) is verdict.passed


def test_every_tick_is_the_same_time_in_small_units(verdicts: Judged) -> None:
    """Nanoseconds of 0.02 s times a tick differ from the decimal number by more than the rounding of a time."""
    for tick in range(1, 5001, 7):
        errors = ZERO.copy()
        errors[tick - 1] = 0.11
        result = made_up(range_error=errors)
        for unit, factor in (("us", 20_000), ("ns", 20_000_000)):
            by = f"{tick * factor} {unit}"
            assert verdicts(expecting("settled", by, range="0.1 m", bearing="2 deg"), result)["a"].passed, by


def test_a_follower_that_was_removed_from_a_result_is_named() -> None:
    less = understood(expecting("peak", "1 m", signal="pose", component="y", minus_robot="b"))
    with pytest.raises(InputError, match="the result has no follower 'b': known: a, c"):
        less.judge(Result.of(made_up().sel(robot=["a", "c"])), None)


def test_distance_is_about_the_team(verdicts: Judged) -> None:
    result = made_up()
    result["pose"][500, 2, 1] = 4.0
    found = verdicts(expecting("distance", "150 cm"), result)
    assert list(found) == [""]
    assert found[""].figure == pytest.approx(100.0)
    assert not found[""].passed
    assert found[""].detail == "b and c at t = 10.00 s"
    assert verdicts(expecting("distance", "1 m", robots=("a",)), result)[""].figure == 3.0
    assert verdicts(expecting("distance", "1 m", start=20.0), result)[""].figure == 3.0
    result["pose"][7, 0, 0] = math.nan
    assert not verdicts(expecting("distance", "1 m"), result)[""].passed
    assert smallest_distance(Result.of(result.isel(robot=[0]))) is None


def singular(result: xr.Dataset, **below: float) -> xr.Dataset:
    for name, threshold in below.items():
        result[name].attrs |= {"singular_at_zero": "the law is singular", "singular_below": threshold}
    return result


@pytest.mark.parametrize(
    "expectation",
    [
        partial(expecting, "distance", "1 m"),
        partial(expecting, "distance", "1 m", of="bodies"),
        partial(expecting, "compare", "2", measure="rms", signal="range_error", scenario="other.xml"),
    ],
)
def test_what_is_about_the_team_is_told_apart_by_its_robots(expectation: Callable[..., Expectation]) -> None:
    """A verdict on the team has no robot of its own, and readers of JUnit XML know a case by its name alone."""
    texts = {understood(expectation(robots=robots)).text for robots in ((), ("a",), ("a", "b"))}
    assert len(texts) == 3
    assert sum("a, b" in text for text in texts) == 1


def test_regular_is_told_by_the_signal_that_is_nearest_to_its_zero(verdicts: Judged) -> None:
    gain = np.stack([np.where(TIME == 30, 0.15, 1.0), ZERO + 1, np.where(TIME == 40, -1.0, 1.0)], axis=1)
    determinant = np.stack([ZERO + 5, np.where(TIME == 20, -0.3, -1.0), ZERO * math.nan], axis=1)
    result = singular(made_up(gain=gain, determinant=determinant), gain=0.1, determinant=0.5)
    found = verdicts(expecting("regular"), result)
    assert [(verdict.passed, verdict.figure, verdict.bound) for verdict in found.values()] == [
        (True, 0.15, 0.1),
        (False, 0.3, 0.5),
        (False, 0.0, 0.1),
    ]
    assert [verdict.detail for verdict in found.values()] == [
        "gain nearest to zero at t = 30.00 s",
        "determinant nearest to zero at t = 20.00 s",
        "gain changes sign at t = 40.00 s",
    ]
    assert found["b"].margin == pytest.approx(-0.2)
    assert all(v.passed for v in verdicts(expecting("regular", start=40.04), result).values())
    assert list(verdicts(expecting("regular", robots=("c",)), result)) == ["c"]


def test_a_signal_without_a_threshold_tells_by_its_sign_alone(verdicts: Judged) -> None:
    result = singular(
        made_up(gain=np.where(TIME > 50, -1e-9, 1e-9)[:, np.newaxis] * np.array([1, 0, 0]) + 1e-12), gain=0
    )
    found = verdicts(expecting("regular"), result)
    assert [verdict.passed for verdict in found.values()] == [False, True, True]


def test_marks(verdicts: Judged) -> None:
    result = made_up(range_error=ZERO + 1)
    found = verdicts(expecting("rms", "0.5 m", signal="range_error", fails="too slow"), result)
    assert found["a"].outcome == "fails as known: too slow"
    assert found["a"].as_marked
    assert found["b"].outcome == "holds, though marked as failing: too slow"
    assert not found["b"].as_marked
    assert found["b"].passed


def test_a_comparison_calls_what_is_handed_in(scenario: Scenario) -> None:
    """No file is read and nothing is run but by the two functions."""
    comparing = expecting("compare", "2", signal="range_error", measure="peak", scenario="other.xml", fails="slow")
    other = (Path("folder") / "other.xml").absolute()
    asked: list[Path] = []

    def prepare(path: Path) -> Recording:
        asked.append(path)
        return Recording(replace(scenario, path=path), {"range_error": Recorded({"": "cm"}, ("a",))})

    def run(path: Path) -> Result:
        asked.append(path)
        return Result.of(made_up(range_error=ZERO + 3))

    def fails(path: Path) -> Result:
        raise SimulationError("a", 2.0, "out of fuel")

    check(replace(scenario, expectations=(comparing,)), KNOWN, prepare)
    (verdict,) = judge((comparing,), made_up(range_error=ZERO + 4), run)
    assert asked == [other, other]
    assert (verdict.figure, verdict.bound, verdict.known_failure) == pytest.approx((4 / 3, 2.0, "slow"))
    for how, why in ((fails, "the run of other.xml failed: a at t = 2 s: out of fuel"), (None, "there is no run of")):
        (verdict,) = judge((comparing,), made_up(), how)
        assert not verdict.as_marked
        assert verdict.detail.startswith(why)


def test_each_kind_is_an_element_of_the_schema() -> None:
    assert set(KINDS) == set(children_of("expect"))


# Checks before the run --------------------------------------------------------------------------------------

KNOWN = {
    "range_error": Recorded({"": "m"}, ("follower_1", "follower_2")),
    "weight_norm": Recorded({"": "1"}, ("follower_1",)),
    "pose": Recorded({"x": "m", "gamma": "rad"}, ("follower_1", "follower_2")),
    "leader_pose": Recorded({"x": "m", "gamma": "rad"}, ("leader",)),
    "speed": Recorded({"": "m/s"}, ("follower_1", "follower_2")),
    "drive_gain": Recorded({"": "1"}, ("follower_1",), tells_singularity=True),
}


@pytest.mark.parametrize(
    ("kind", "bound", "given", "sentence"),
    [
        ("rms", "1 m", {"signal": "range_eror"}, "the result has no signal 'range_eror': did you mean 'range_error'?"),
        (
            "rms",
            "2 deg",
            {"signal": "range_error"},
            "the bound of the rms of 'range_error', which is in m: cannot conv",
        ),
        ("itae", "2 m", {"signal": "range_error"}, "the bound of the itae of 'range_error', which is in m.s2: cannot"),
        ("itae", "2 m/s", {"signal": "speed"}, "which is in m.s2/s: cannot"),
        ("peak", "1 parsec", {"signal": "range_error"}, "'parsec' is not known"),
        ("peak", "1e999 m", {"signal": "range_error"}, "is not a finite number"),
        ("peak", "0 m", {"signal": "range_error"}, "is not greater than zero, so the expectation cannot hold"),
        ("peak", "1 m", {"signal": "pose"}, "the signal 'pose' needs component=..., one of x, gamma"),
        ("peak", "1 m", {"signal": "pose", "component": "gama"}, "did you mean 'gamma'?"),
        ("peak", "1 m", {"signal": "range_error", "component": "x"}, "'range_error' has no components: leave"),
        ("peak", "1 m", {"signal": "leader_pose", "component": "x", "robots": ("follower_1",)}, "is the leader's"),
        ("rms", "1 m", {"signal": "range_error", "minus": "spede"}, "no signal 'spede': did you mean 'speed'?"),
        ("rms", "1 m", {"signal": "range_error", "minus": "speed"}, "'range_error minus speed', which is in m: cannot"),
        ("rms", "1 m", {"signal": "range_error", "minus": "range_error"}, "minus itself is always zero"),
        ("rms", "1 m", {"signal": "range_error", "minus": "pose"}, "'pose' needs minus_component=..., one of x, gamma"),
        ("rms", "1 m", {"signal": "pose", "component": "x", "minus": "range_error"}, "give it as signal=..., and what"),
        ("rms", "1 m", {"signal": "range_error", "minus_robot": "folower_1"}, "did you mean 'follower_1'?"),
        (
            "rms",
            "1 m",
            {"signal": "range_error", "minus_robot": "follower_1", "robots": ("follower_1",)},
            "'range_error minus range_error of follower_1' of follower_1 is always zero: name another",
        ),
        (
            "peak",
            "1",
            {"signal": "weight_norm", "minus_robot": "follower_1"},
            "of follower_1 is always zero: no other follower has that signal",
        ),
        ("final", "1 m", {"signal": "range_error", "stop": 100.02}, "is not within the run of 100 s"),
        ("final", "1 m", {"signal": "range_error", "start": 3.0, "stop": 2.0}, "from 3 s to 2 s is not within the run"),
        ("rms", "1 m", {"signal": "leader_pose", "component": "x", "minus": "pose"}, "say whose by minus_robot=..."),
        (
            "rms",
            "1 m",
            {"signal": "pose", "component": "x", "minus": "leader_pose", "minus_robot": "follower_1"},
            "'leader_pose' is the leader's: leave minus_robot=... out",
        ),
        ("peak", "1", {"signal": "weight_norm", "robots": ("follower_2",)}, "'follower_2' has no signal 'weight_norm'"),
        ("rms", "1 m", {"signal": "range_error", "start": 1.005, "stop": 1.015}, "holds too few of the samples"),
        ("itae", "1 m.s2", {"signal": "range_error", "start": 1.0, "stop": 1.01}, "holds too few of the samples"),
        ("regular", "", {"robots": ("follower_2",)}, "'follower_2' has no controller that signals singularities"),
        ("distance", "1 s", {}, "the bound of the distance, which is in m: cannot"),
        ("distance", "-1 m", {}, "is not greater than zero, so it would hold whatever happens"),
        ("distance", "0 m", {}, "is not greater than zero, so it would hold whatever happens"),
        ("distance", "-1 mm", {"of": "bodies"}, "is negative, so it would hold whatever happens"),
        (
            "compare",
            "1e999",
            {"signal": "speed", "measure": "rms", "scenario": "other.xml"},
            "the factor is not a finite number",
        ),
    ],
)
def test_bad_expectations(scenario: Scenario, kind: str, bound: str, given: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        check(replace(scenario, expectations=(expecting(kind, bound, **given),)), KNOWN, no_other)
    assert caught.value.where == HERE
    assert sentence in caught.value.message


def test_good_expectations(scenario: Scenario) -> None:
    for expectation in (
        expecting("itae", "1 m.s", signal="speed"),
        expecting("itae", "1 s2", signal="weight_norm"),
        expecting("final", "1 mm", signal="leader_pose", component="x", start=1.0, stop=1.0),
        expecting("final", "1 km/h", signal="speed", stop=100.0 + 1e-13),  # a horizon that rounding made shorter
        expecting("rms", "1 m", signal="pose", component="x", minus="leader_pose"),
        expecting("rms", "1 m", signal="leader_pose", component="x", minus="pose", minus_robot="follower_2"),
        expecting("rms", "1 m", signal="range_error", minus_robot="follower_2"),
        expecting("least", "-1 km/h", signal="speed", robots=("follower_2",)),
        expecting("regular"),
        expecting("distance", "10 cm"),
        expecting("distance", "10 cm", of="reference_points"),
        expecting("distance", "0 m", of="bodies"),
        expecting("settled", "1 min", range="1 m", bearing="1 rad"),
    ):
        check(replace(scenario, expectations=(expectation,)), KNOWN, no_other)


def test_what_the_team_cannot_have(scenario: Scenario) -> None:
    alone = replace(scenario, followers=scenario.followers[:1], expectations=(expecting("distance", "1 m"),))
    with pytest.raises(InputError, match="a single follower has no distance"):
        check(alone, KNOWN, no_other)
    shapeless = replace(scenario, expectations=(expecting("distance", "1 m", of="bodies"),))
    with pytest.raises(InputError) as caught:
        check(shapeless, KNOWN, no_other, {"follower_2": "rover"})
    assert caught.value.where == HERE
    assert caught.value.message == (
        'of="bodies" of <distance> needs the outline of every follower, but follower_2 has none, as the kind of '
        "vehicle 'rover' states none: state one in the kind, or leave of=\"bodies\" out for the distance of "
        "reference points"
    )
    points = replace(scenario, expectations=(expecting("distance", "1 m"),))
    check(points, KNOWN, no_other, {"follower_2": "rover"})
    untold = replace(scenario, expectations=(expecting("regular"),))
    with pytest.raises(InputError, match=r"no follower has a controller that signals singularities: remove <regular>"):
        check(untold, {"range_error": KNOWN["range_error"]}, no_other)


def test_what_is_recorded_by_component_and_robot() -> None:
    variables = [
        ResultVariable("pose", ("robot", "pose_component"), (2, 2), "m, rad", ""),
        ResultVariable("leader_torque", ("torque_component",), (2,), "N.m, N.m", ""),
        ResultVariable("weights", ("robot", "weights_component"), (2, 2), "1", "", robots=("b",)),
        ResultVariable("det_R", ("robot",), (2,), "1", "", "the model is singular", robots=("a",)),
    ]
    labels = {"pose_component": "xp", "torque_component": "ds", "weights_component": "vw"}
    known = recorded(variables, labels, ["a", "b"])
    assert known["pose"] == Recorded({"x": "m", "p": "rad"}, ("a", "b"))
    assert known["leader_torque"] == Recorded({"d": "N.m", "s": "N.m"}, ("leader",))
    assert known["weights"] == Recorded({"v": "1", "w": "1"}, ("b",))
    assert known["det_R"] == Recorded({"": "1"}, ("a",), tells_singularity=True)
    assert known["range_error"].units == {"": "m"}


# Runs -------------------------------------------------------------------------------------------------------


def written(folder: Path, name: str, expectations: str, *edits: tuple[str, str]) -> Path:
    """Write the example as a run of one second with these expectations."""
    text = EXAMPLE.read_text(encoding="utf-8").replace("</scenario>", f"<expect>{expectations}</expect></scenario>")
    for old, new in (('horizon="100 s"', 'horizon="1 s"'), *edits):
        assert old in text
        text = text.replace(old, new)
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


ALL = """
  <settled by="0.9 s" range="10 cm" bearing="2 deg" fails="it takes longer"/>
  <rms signal="range_error" below="20 m" from="500 ms"/>
  <peak signal="torque" component="tau_drive" below="201 N.m"/>
  <final signal="weight_norm" below="1 MN"/>
  <itae signal="bearing_error" below="1000 deg.s2"/>
  <least signal="pose" component="gamma" above="-180 deg" robots="follower_1 follower_2"/>
  <distance above="1 cm"/>
  <regular/>
  <compare measure="rms" signal="range_error" factor="1.01" scenario="other.xml"/>
  <compare measure="itae" signal="range_error" factor="0.99" scenario="other.xml" to="0.5 s"/>
"""


@pytest.fixture
def counts(monkeypatch: pytest.MonkeyPatch) -> dict[str, Counter[Path]]:
    """Count how often each scenario is read, set up and run."""
    found: dict[str, Counter[Path]] = {"read": Counter(), "set up": Counter(), "run": Counter()}

    def count(what: str, place: Any, name: str, path_of: Callable[[Any], Path]) -> None:
        original = getattr(place, name)

        def call(first: Any, *others: Any, **named: Any) -> Any:
            found[what][path_of(first)] += 1
            return original(first, *others, **named)

        monkeypatch.setattr(place, name, call)

    count("read", reader, "read_document", lambda path: path)
    for place in (setup, simulation, run):
        count("set up", place, "set_up", lambda scenario: scenario.path)
    count("run", Simulation, "run_to_end", lambda simulation: simulation.scenario.path)
    return found


def test_a_run_to_compare_with_is_made_again_if_the_machine_lacked_something(monkeypatch: pytest.MonkeyPatch) -> None:
    path = Path("other.xml")
    other = SimpleNamespace(path=path, untrusted=(), text="<scenario/>")
    setup = SimpleNamespace(others={path: SimpleNamespace(scenario=other, setup=None, content=("of this test",))})
    full = OutputError("no room")
    full.__cause__ = OSError(errno.ENOSPC, "no space left on device")
    outcomes = [full, SimulationError("car", 1.0, "the FMU has failed"), "never reached"]

    @contextmanager
    def run(*_: object) -> Iterator[SimpleNamespace]:
        yield SimpleNamespace(run_to_end=Mock(side_effect=[outcomes.pop(0)]))

    monkeypatch.setattr(other_runs, "whole_run", run)
    with pytest.raises(OutputError, match="no room"):
        run_other(cast(Any, setup), path)
    for _ in range(2):
        with pytest.raises(SimulationError, match="has failed"):
            run_other(cast(Any, setup), path)


def test_every_kind_on_a_run(tmp_path: Path, counts: dict[str, Counter[Path]]) -> None:
    """The other scenario is read, set up and run once for all comparisons; its own expectations are not judged."""
    path = written(tmp_path, "one.xml", ALL)
    other = written(tmp_path, "other.xml", '<compare measure="rms" signal="range" factor="1" scenario="one.xml"/>')
    scenario = read_scenario(path)
    with Simulation(scenario) as running:
        found = judge(scenario.expectations, running.run_to_end(), partial(run_other, running.setup))
    assert counts == {key: Counter({path: 1, other: 1}) for key in counts}
    assert len(found) == 4 + 4 + 4 + 4 + 4 + 2 + 1 + 4 + 1 + 1
    by_kind = {verdict.expectation.split()[0] for verdict in found}
    assert by_kind == {"settled", "rms", "peak", "final", "itae", "least", "distance", "regular,"}
    same, better = found[-2:]
    assert same.passed
    assert same.margin == pytest.approx(0.01 * same.figure)
    assert same.bound == pytest.approx(1.01 * same.figure)
    assert not better.passed
    assert better.unit == "m.s2"
    assert "other.xml: " in better.detail
    assert [verdict.passed for verdict in found[:4]] == [False] * 4
    for verdict in found:
        assert verdict.passed is not math.isnan(verdict.margin) or verdict.margin <= 0


def test_the_other_scenario_runs_anew_when_a_file_that_it_names_is_another(
    tmp_path: Path, counts: dict[str, Counter[Path]]
) -> None:
    compare = '<compare measure="rms" signal="range_error" factor="9" scenario="other.xml"/>'
    path = written(tmp_path, "one.xml", compare)
    disturbed = '<input name="tau_drive"><table file="push.csv" column="push"/></input></follower>'
    other = written(tmp_path, "other.xml", "<regular/>", ("</follower>", disturbed))
    bounds = []
    for push in (0, -300, -300):
        (tmp_path / "push.csv").write_text(f"time [s],push [N.m]\n0,{push}\n1,{push}\n")
        with Prepared(read_scenario(path)) as prepared:
            bounds += [verdict.bound for _ in range(2) for verdict in prepared.run().verdicts]
    assert counts["run"][other] == 2
    pushed_apart = bounds[2]
    assert bounds == [bounds[0], bounds[0], *[pushed_apart] * 4]
    assert pushed_apart > 1.001 * bounds[0]


def test_a_strict_run_sets_up_once_too(tmp_path: Path, counts: dict[str, Counter[Path]]) -> None:
    compare = '<compare measure="rms" signal="range" factor="9" scenario="other.xml"/>'
    path, other = written(tmp_path, "one.xml", compare), written(tmp_path, "other.xml", "<regular/>")
    assert main(["run", str(path), "--strict", "--out", str(tmp_path), "--no-figure"]) == 0
    assert counts == {key: Counter({path: 1, other: 1}) for key in counts}


def test_a_comparison_with_a_run_that_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It cannot be judged: it does not pass, not even as marked, and the scenario's own result is kept."""
    compare = '<compare measure="rms" signal="range" factor="9" scenario="failing.xml" fails="it is worse"/>'
    path = written(tmp_path, "one.xml", compare)
    failing = written(tmp_path, "failing.xml", "<regular/>")
    error = SimulationError("follower_1", 0.1, "out of fuel")
    watch(monkeypatch, FailsAt(5, error), lambda scenario: scenario.path == failing)
    assert main(["run", str(path), "--out", str(tmp_path), "--no-figure"]) == 1
    printed = capsys.readouterr().out
    assert "FAILS  rms range at most 9 times that of failing.xml" in printed
    assert "the run of failing.xml failed: follower_1 at t = 0.1 s: out of fuel" in printed
    summary = json.loads((tmp_path / "example" / "summary.json").read_text())
    assert summary["verdicts"][0]["margin"] is None
    assert (tmp_path / "example" / "result.nc").exists()


@pytest.mark.parametrize(
    ("attributes", "sentence"),
    [
        ('signal="range" scenario="none.xml"', "the other scenario is wrong: {folder}/none.xml: there is no such file"),
        ('signal="range" scenario="one.xml"', "a scenario cannot be compared with itself"),
        ('signal="range" scenario="./../{name}/one.xml"', "a scenario cannot be compared with itself"),
        ('signal="weight_norm" scenario="other.xml"', "in the other scenario, other.xml: the result has no signal"),
        ('signal="range" scenario="short.xml"', "the window ends at 1 s, but short.xml at 0.5 s"),
        ('signal="range" scenario="one.png"', "the other scenario is wrong: {folder}/one.png:1:1: "),
    ],
)
def test_what_cannot_be_compared_with(tmp_path: Path, attributes: str, sentence: str) -> None:
    attributes = attributes.format(name=tmp_path.name)
    path = written(tmp_path, "one.xml", f'<compare measure="rms" factor="1" {attributes}/>')
    law = ('name="neural-adaptive-pid"', 'name="lqg"')
    other = written(tmp_path, "other.xml", "<regular/>", law)
    other.write_text("\n".join(line for line in other.read_text().splitlines() if "<gain" not in line))
    written(tmp_path, "short.xml", "<regular/>", ('horizon="1 s"', 'horizon="0.5 s"'))
    (tmp_path / "one.png").write_bytes(b"\x89PNG")
    with pytest.raises(InputError) as caught:
        Simulation(read_scenario(path))
    assert caught.value.where is not None
    assert caught.value.where.file == str(path)
    assert sentence.format(folder=tmp_path) in caught.value.message


def test_ctrl_c_while_the_other_scenario_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The scenario's own result is safe by then, and no summary of an earlier run stays."""
    path = written(tmp_path, "one.xml", '<compare measure="rms" signal="range" factor="9" scenario="interrupted.xml"/>')
    other = written(tmp_path, "interrupted.xml", "<regular/>", ("<title>", "<title>Interrupted: "))
    stale = tmp_path / "example" / "summary.json"
    stale.parent.mkdir()
    stale.touch()
    original = Simulation._segment

    def segment(self: Simulation, length: Segment) -> None:
        if self.scenario.path == other and self.tick > 20:
            signal.raise_signal(signal.SIGINT)
        original(self, length)

    monkeypatch.setattr(Simulation, "_segment", segment)
    assert main(["run", str(path), "--out", str(tmp_path), "--no-figure"]) == 130
    assert load(tmp_path / "example" / "result.nc").attrs["status"] == "completed"
    assert not stale.exists()


def test_the_terminal_shows_the_worst_on_each_expectation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of one that is marked, the worst as marked and the worst otherwise."""
    expectations = """
      <final signal="range" below="7 m" fails="too far"/>
      <final signal="range" below="99 m"/>
      <distance above="99 m" fails="too near"/>"""
    path = written(tmp_path, "one.xml", expectations)
    assert main(["run", str(path), "--out", str(tmp_path), "--no-figure"]) == 1
    lines = [line for line in capsys.readouterr().out.splitlines() if ", margin " in line]
    summary = json.loads((tmp_path / "example" / "summary.json").read_text())
    figures = {verdict["robot"]: verdict["figure"] for verdict in summary["verdicts"][:4]}
    farthest, nearest = max(figures, key=figures.__getitem__), max((f, r) for r, f in figures.items() if f < 7)[1]
    assert [line.split("  ")[0] for line in lines] == [
        "holds, though marked as failing: too far",
        "fails as known: too far",
        "holds",
        "fails as known: too near",
    ]
    assert [line.rsplit("(")[1].rstrip(")") for line in lines[:3]] == [nearest, farthest, farthest]


def test_the_page_on_results_shows_a_verdict_as_it_is(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "results.md").read_text(encoding="utf-8")
    shown = json.loads(page.split("```json")[1].split("```")[0])
    path = written(tmp_path, "one.xml", '<distance above="99 m"/>')
    main(["run", str(path), "--out", str(tmp_path), "--no-figure"])
    (verdict,) = json.loads((tmp_path / "example" / "summary.json").read_text())["verdicts"]
    assert {key: type(value) for key, value in shown.items()} == {key: type(value) for key, value in verdict.items()}
    assert list(shown["where"]) == list(verdict["where"])


# A new kind -------------------------------------------------------------------------------------------------

MEAN = '''
"""The mean of a signal is below a bound."""

from cosim.results.expectations.bounded import Bounded
from cosim.results.metrics import Measure


class Mean(Bounded):
    """``<mean>``."""

    element = "mean"
    measure = Measure(lambda time, values, start: values.mean())
'''


@pytest.fixture
def with_mean(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Add a kind of expectation as a developer does: one file, and one entry in the schema."""
    (folder := tmp_path / "new").mkdir()
    (folder / "mean.py").write_text(MEAN, encoding="utf-8")
    schema = grammar.schema_path().read_text(encoding="utf-8")
    entry = '<xs:element name="rms" type="bounded"/>'
    (folder / "schema.xsd").write_text(schema.replace(entry, entry + entry.replace("rms", "mean")), encoding="utf-8")
    places = [*expectations.__path__, str(folder)]
    monkeypatch.setattr(expectations, "__path__", places)
    monkeypatch.setattr(expectations, "KINDS", kinds_in(expectations.__name__, places, expectations.Kind))
    monkeypatch.setattr(grammar, "schema_path", lambda: folder / "schema.xsd")
    caches = [function for function in vars(grammar).values() if hasattr(function, "cache_clear")]
    for function in caches:
        function.cache_clear()
    yield
    sys.modules.pop(f"{expectations.__name__}.mean")
    for function in caches:
        function.cache_clear()


@pytest.mark.usefixtures("with_mean")
def test_a_new_kind_is_one_file_and_one_entry_in_the_schema(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, "one.xml", '<mean signal="range" below="99 m" from="0.5 s" robots="follower_1"/>')
    assert main(["check", str(path)]) == 0
    assert "expected: mean range below 99 m, 0.5 to 1 s (follower_1)" in capsys.readouterr().out
    assert main(["run", str(path), "--out", str(tmp_path), "--no-figure"]) == 0
    assert "holds  mean range below 99 m, 0.5 to 1 s: " in capsys.readouterr().out
    written(tmp_path, "one.xml", '<mean signal="rage" below="99 m"/>')
    assert main(["check", str(path)]) == 2
    assert "the result has no signal 'rage': did you mean 'range'?" in capsys.readouterr().err


def test_the_page_on_the_architecture_shows_a_kind_as_it_is() -> None:
    root = Path(__file__).parents[2]
    page = (root / "docs" / "architecture.md").read_text(encoding="utf-8")
    code = (root / "cosim" / "results" / "expectations" / "least.py").read_text(encoding="utf-8")
    assert f"```python\n{code}```" in page
