"""The figures of a run, against results made by hand whose figures are known."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from cosim.errors import OutputError
from cosim.results.files import load, save, writable_folder
from cosim.results.follower_figures import follower_figures
from cosim.results.result import Result
from cosim.results.summary import summarise
from cosim.scenario.reader import read_scenario
from cosim.scenario.scenario import Scenario

EXAMPLE = Path(__file__).with_name("example.xml")
SINGULAR = {"units": "1", "singular_at_zero": "the formation model is singular"}
NEAR = SINGULAR | {"singular_below": 0.1}


def made_up(range_error: np.ndarray, bearing_error: np.ndarray, **attributes: str) -> xr.Dataset:
    """Return a result of two followers, at y = 0 and y = 3, with these errors of the first and none of the second."""
    samples = len(range_error)
    zeros = np.zeros(samples)
    position = np.zeros((samples, 2, 4))
    position[:, 1, 1] = 3.0
    return xr.Dataset(
        {
            "pose": (("time", "robot", "pose_component"), position),
            "torque": (("time", "robot", "torque_component"), np.full((samples, 2, 2), -7.0)),
            "range_error": (("time", "robot"), np.stack([range_error, zeros], axis=1), {"units": "m"}),
            "bearing_error": (("time", "robot"), np.stack([bearing_error, zeros], axis=1), {"units": "rad"}),
            "det_R": (
                ("time", "robot"),
                np.stack([np.where(np.arange(samples) == 50, -1.0, 1.0), zeros + 1], axis=1),
                SINGULAR,
            ),
        },
        {"time": np.arange(samples) * 0.02, "robot": ["a", "b"]},
        {"status": "completed", "title": "made up", "scenario_name": "made_up", "plant_messages": "[]", **attributes},
    )


@pytest.fixture
def scenario() -> Scenario:
    return read_scenario(EXAMPLE)


def test_settling_is_from_when_on_the_errors_stay_within_both_bands(scenario: Scenario) -> None:
    time = np.arange(5001) * 0.02
    range_error = np.where(time < 30, 0.2, 0.05)
    bearing_error = np.where((time > 39.99) & (time < 40.01), math.radians(3), 0.0)
    first, second = summarise(scenario, made_up(range_error, bearing_error)).followers
    assert first.settling_time == pytest.approx(40.02)
    assert second.settling_time == 0.0
    assert first.range_rms == pytest.approx(0.05)
    assert first.bearing_rms == 0.0
    assert first.peak_torque == 7.0


@pytest.mark.parametrize(("last_outside", "settled"), [(5000, None), (4800, None), (4749, 95.0), (4748, 94.98)])
def test_inside_for_less_than_a_twentieth_of_the_run_is_not_settled(
    scenario: Scenario, last_outside: int, settled: float | None
) -> None:
    errors = np.zeros(5001)
    errors[last_outside] = 1.0
    assert summarise(scenario, made_up(errors, errors)).followers[0].settling_time == pytest.approx(settled)


@pytest.mark.parametrize(("last_outside", "settled"), [(94, 1.9), (95, None)])
def test_inside_for_exactly_a_twentieth_is_settled(last_outside: int, settled: float | None) -> None:
    """Where the twentieth of the horizon, 0.1 s of 2 s, is no number that a computer has."""
    errors = np.zeros(101)
    errors[last_outside] = 1.0
    [first, _] = follower_figures(2.0, 0.02, Result.of(made_up(errors, errors)))
    assert first.settling_time == (None if settled is None else pytest.approx(settled))


def test_steady_state_is_the_last_fifth(scenario: Scenario) -> None:
    time = np.arange(5001) * 0.02
    summary = summarise(scenario, made_up(np.where(time < 79.99, 9.0, 1.0), np.zeros(5001)))
    assert summary.followers[0].range_rms == 1.0


def test_smallest_distance_and_notes(scenario: Scenario) -> None:
    summary = summarise(scenario, made_up(np.zeros(5001), np.zeros(5001)))
    assert summary.smallest_distance == 3.0
    assert summary.smallest_distance_between == ("a", "b")
    assert summary.notes == (
        "a: det_R changes sign 2 times, first at t = 1.00 s; where it is zero, the formation model is singular",
    )


def notes(scenario: Scenario, values: list[float], attributes: dict[str, object]) -> tuple[str, ...]:
    """Return the notes on a signal of the first follower that has these values at 0, 0.02, 0.04, ... s."""
    result = made_up(np.zeros(len(values)), np.zeros(len(values))).drop_vars("det_R")
    signal = np.stack([values, np.ones(len(values))], axis=1)
    return summarise(scenario, result.assign(gap=(("time", "robot"), signal, attributes))).notes


def test_a_note_says_who_came_near_a_singularity_when_and_how_near(scenario: Scenario) -> None:
    """Of a signal that has no sign, such as a range."""
    (note,) = notes(scenario, [1, 0.1, 0.099, 0.5, 0.02, 0.05, 1], NEAR)
    assert note == (
        "a: gap is within 0.1 of zero first at t = 0.04 s, nearest with 0.02 at t = 0.08 s; "
        "where it is zero, the formation model is singular"
    )


def test_a_note_says_who_crossed_and_how_near_a_sample_was(scenario: Scenario) -> None:
    (note,) = notes(scenario, [1, -1, 0.05, -0.03, -1], NEAR)
    assert note == (
        "a: gap changes sign 3 times, first at t = 0.02 s, and is within 0.1 of zero first at t = 0.04 s, "
        "nearest with -0.03 at t = 0.06 s; where it is zero, the formation model is singular"
    )
    assert notes(scenario, [0.5, -0.5], NEAR) == (
        "a: gap changes sign once, at t = 0.02 s; where it is zero, the formation model is singular",
    )


@pytest.mark.parametrize(
    ("values", "attributes"),
    [
        ([0.1, 0.2, 0.1], NEAR),
        ([0.1, 0.0, 0.1], SINGULAR),  # without a threshold, a touch is no change of sign
        ([0.1, -0.1, 0.1], {"units": "1"}),
        ([math.nan, math.nan, math.nan], NEAR),  # a robot whose controller has no such signal
    ],
)
def test_there_is_no_note_on_what_is_not_near(
    scenario: Scenario, values: list[float], attributes: dict[str, object]
) -> None:
    assert notes(scenario, values, attributes) == ()


def test_a_note_is_about_any_component_of_a_signal(scenario: Scenario) -> None:
    result = made_up(np.zeros(4), np.zeros(4)).drop_vars("det_R")
    gaps = np.ones((4, 2, 2))
    gaps[2:, 1, 1] = -0.05
    (note,) = summarise(scenario, result.assign(gap=(("time", "robot", "part"), gaps, NEAR))).notes
    assert note.startswith("b: gap changes sign once, at t = 0.04 s, and is within 0.1 of zero first at t = 0.04 s,")


def test_a_note_says_whose_heading_jumps_by_a_turn(scenario: Scenario) -> None:
    result = (
        made_up(np.zeros(5), np.zeros(5)).drop_vars("det_R").assign_coords(pose_component=["x", "y", "psi", "gamma"])
    )
    result["pose"].values[:, 0, 2] = [3.1, 3.14, 3.18 - 2 * math.pi, -3.0, 3.2]
    result["pose"].values[:, 0, 3] = [0.0, 3.14, 0.0, 0.0, math.nan]
    result["pose"].values[:, 1, 0] = [0.0, 6.28, 0.0, 0.0, 0.0]
    assert summarise(scenario, result).notes == (
        "a: psi jumps by a whole turn 2 times, first at t = 0.04 s; "
        "its plant must count turns, as controllers take the jump for motion",
    )


def test_a_run_cut_short_before_the_steady_part_has_no_steady_figures(scenario: Scenario) -> None:
    summary = summarise(scenario, made_up(np.zeros(10), np.zeros(10), status="incomplete"))
    assert math.isnan(summary.followers[0].range_rms)
    assert json.loads(summary.to_json())["followers"][0]["range_rms"] is None


def test_a_run_without_a_sample(scenario: Scenario) -> None:
    summary = summarise(scenario, made_up(np.zeros(0), np.zeros(0), status="incomplete"))
    assert summary.smallest_distance is None
    assert summary.followers[0].settling_time is None
    json.loads(summary.to_json())


def test_only_a_run_that_reached_its_end_can_pass(scenario: Scenario) -> None:
    assert summarise(scenario, made_up(np.zeros(5001), np.zeros(5001))).passed
    cut_short = summarise(scenario, made_up(np.zeros(5001), np.zeros(5001), status="incomplete"))
    assert cut_short.verdicts == ()
    assert not cut_short.passed
    assert json.loads(cut_short.to_json())["passed"] is False


def test_errors_that_are_no_numbers_are_not_settled(scenario: Scenario) -> None:
    errors = np.zeros(5001)
    errors[4900] = math.nan
    assert summarise(scenario, made_up(errors, errors)).followers[0].settling_time is None


def with_messages(number: int) -> xr.Dataset:
    """Return a result with this number of messages, of both robots in turn."""
    texts = {
        "robot": ["ab"[i % 2] for i in range(number)],
        "status": ["Warning"] * number,
        "category": ["logEvents"] * number,
        "text": [f"message {i}" for i in range(number)],
    }
    columns = {f"message_{name}": ("message", np.array(values, dtype=np.str_)) for name, values in texts.items()}
    columns["message_time"] = ("message", np.arange(number) * 0.5)
    columns["message_count"] = ("message", np.full(number, 3))
    return made_up(np.zeros(5001), np.zeros(5001)).assign_coords(columns)


def test_messages_of_fmus_are_data_of_the_summary(scenario: Scenario) -> None:
    told = json.loads(summarise(scenario, with_messages(2)).to_json())
    common = {"status": "Warning", "category": "logEvents", "count": 3}
    assert told["messages"] == [
        {"time": 0.0, "robot": "a", "text": "message 0", **common},
        {"time": 0.5, "robot": "b", "text": "message 1", **common},
    ]
    assert told["messages_left_out"] == 0


@pytest.mark.parametrize(("number", "left_out"), [(0, 0), (99, 0), (100, 0), (101, 1), (1000, 900)])
def test_a_summary_holds_the_first_and_the_last_messages(scenario: Scenario, number: int, left_out: int) -> None:
    summary = summarise(scenario, with_messages(number))
    numbers = [int(message.text.removeprefix("message ")) for message in summary.messages]
    assert numbers == [i for i in range(number) if i < 50 or i >= number - 50]
    assert summary.messages_left_out == left_out == number - len(numbers)


def test_a_result_of_an_earlier_version_has_no_messages(scenario: Scenario) -> None:
    summary = summarise(scenario, made_up(np.zeros(5), np.zeros(5)))
    assert (summary.messages, summary.messages_left_out) == ((), 0)


def test_a_result_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "result.nc"
    result = made_up(np.zeros(5), np.zeros(5))
    save(result, path)
    xr.testing.assert_identical(load(path), result)
    with pytest.raises(OutputError, match="cannot be written"):
        save(result, tmp_path / "none" / "result.nc")
    assert [file.name for file in tmp_path.iterdir()] == ["result.nc"]


def test_a_folder_that_cannot_be_written_is_told_with_what_refuses_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (file := tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match=f"written to {file / 'runs'}: {file} is no folder; choose another --out"):
        writable_folder(file / "runs", "--out")

    def refuse(*_: object, **__: object) -> None:
        raise FileNotFoundError(2, "No such file or directory")  # as /proc does, which is there

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(OutputError, match=f": no folder can be made in {tmp_path}; choose another --out"):
        writable_folder(tmp_path / "proc" / "runs", "--out")
