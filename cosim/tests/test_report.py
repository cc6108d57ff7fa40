"""The page of runs, as data and as text; `tests/test_report_in_browser.py` looks at it in a browser."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cosim
from cosim.cli import main
from cosim.errors import InputError
from cosim.report import content as content_module
from cosim.report.columns import Columns, extremes, samples_in_bucket
from cosim.report.content import content_of
from cosim.report.page import page, save_report
from cosim.report.paths import Paths, apart
from cosim.results.drawable_part import drawable
from cosim.results.result import Result, Variable
from cosim.scenario.scenario import Scenario


def unpacked(text: str) -> np.ndarray[Any, Any]:
    """Return packed numbers as the page reads them."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8).reshape(3, -1).astype(np.uint32)
    return (planes[0] << 24 | planes[1] << 16 | planes[2] << 8).view(np.float32)


def column(numbers: np.ndarray[Any, Any], reference: Any, samples: int) -> np.ndarray[Any, Any]:
    if isinstance(reference, list):
        offset, length, *base = reference
        return numbers[offset : offset + length].astype(np.float64) + sum(base)
    return np.full(samples, np.nan if reference is None else reference)


@pytest.fixture(scope="module")
def judged(short_line: Scenario) -> Result:
    text = short_line.path.read_text(encoding="utf-8")
    assert "<expect>" in text
    result = cosim.run(short_line)
    wanted = (
        '<expect><settled by="0.5 s" range="10 m" bearing="200 deg"/><peak signal="torque" component="tau_drive" '
        'below="1 N.m" robots="follower_2"/><rms signal="bearing_error" below="200 deg" from="0.2 s"/>'
        '<least signal="range" above="1 m"/><peak signal="pose" component="x" minus="measured_pose" '
        'below="1 m" robots="follower_4"/><distance above="0.1 m"/><final signal="range_error" below="9 m"/>'
        "<regular/></expect>"
    )
    shortened = re.sub(r'horizon="100 s"', 'horizon="1 s"', re.sub(r"(?s)<expect>.*</expect>", wanted, text))
    return Result.of(result.assign_attrs(scenario=shortened))


@given(st.lists(st.floats(-1e30, 1e30) | st.just(float("nan")), min_size=1, max_size=50))
def test_numbers_keep_16_bits(values: list[float]) -> None:
    columns = Columns()
    reference = columns.add(np.array(values))
    shown = column(unpacked(columns.packed()), reference, len(values))
    np.testing.assert_allclose(shown, values, rtol=2.0**-16, atol=1e-37)


@given(st.lists(st.floats(-100.0, 100.0) | st.just(float("nan")), min_size=1), st.sampled_from([-5e6, 5e5, 5e6, 1e9]))
def test_numbers_far_from_zero_keep_16_bits_of_their_distances(values: list[float], place: float) -> None:
    columns = Columns()
    far = np.array(values) + place
    reference = columns.add(far)
    shown = column(unpacked(columns.packed()), reference, len(values))
    np.testing.assert_allclose(shown, far, rtol=0, atol=200.0 * 2.0**-16)


@given(st.lists(st.floats(-100, 100) | st.just(float("nan")), min_size=1, max_size=60), st.integers(1, 9))
def test_of_each_bucket_both_extremes_are_kept_in_their_order(values: list[float], size: int) -> None:
    courses = np.array(values)[:, np.newaxis] * [1.0, -1.0]
    both = extremes(courses.__getitem__, len(values), size)
    found = both[:, 0]
    if size == 1:
        np.testing.assert_array_equal(found, values)
        return
    for i in range(-(-len(values) // size)):
        bucket = [value for value in values[i * size : (i + 1) * size] if value == value]
        pair = found[2 * i : 2 * i + 2].tolist()
        if not bucket:
            assert np.isnan(pair).all()
            continue
        assert sorted(pair) == [min(bucket), max(bucket)]
        assert bucket.index(pair[0]) <= bucket.index(pair[1])


def test_many_samples_share_buckets() -> None:
    assert samples_in_bucket(5001, 150) == 1
    assert samples_in_bucket(1_000_000, 150) == 61
    assert samples_in_bucket(5001, 40_000) == 81
    assert samples_in_bucket(5001, 10**7) == 101


def test_content(judged: Result) -> None:
    content = content_of(judged)
    numbers = unpacked(content["numbers"])
    assert (content["samples"], content["step"], content["end"]) == (51, 0.02, 1.0)
    assert [vehicle["id"] for vehicle in content["vehicles"]] == ["leader", *judged.robots]
    assert {vehicle["ahead"] for vehicle in content["vehicles"]} == {1.2}
    assert content["vehicles"][1]["parts"][0]["name"] == "body"
    for k, reference in enumerate(content["motion"]["poses"][2]):
        shown = column(numbers, reference, 51)
        np.testing.assert_allclose(shown, judged["pose"].values[:, 1, k], rtol=2.0**-16)
    signals = {signal["name"]: signal for signal in content["signals"]["list"]}
    assert signals.keys() == judged.data_vars.keys()
    shown = column(numbers, signals["torque"]["columns"][3][1], 51)
    np.testing.assert_allclose(shown, judged["torque"].values[:, 3, 1], rtol=2.0**-16)
    assert signals["torque"]["components"] == [{"name": name, "unit": "N.m"} for name in ("tau_drive", "tau_steer")]
    assert (signals["range_error"]["group"], signals["drive_gain"]["group"]) == ("errors", "singularities")
    assert content["provenance"]["command"].startswith("formation run clmr_line.xml --horizon")
    json.dumps(content, allow_nan=False)


def test_each_verdict_has_the_moment_that_decides_it_and_its_signals(judged: Result) -> None:
    content = content_of(judged)
    told = {
        (verdict["expectation"].split()[0].strip(","), verdict["robot"]): verdict for verdict in content["verdicts"]
    }
    time = judged["time"].values
    drive = judged["torque"].values[..., 0]
    assert told["peak", "follower_2"]["moment"] == time[np.abs(drive[:, 1]).argmax()]
    assert told["peak", "follower_2"]["signals"] == [["torque", "tau_drive"]]
    late = np.abs(judged["bearing_error"].values[10:, 2])
    assert told["rms", "follower_3"]["moment"] == time[10 + late.argmax()]
    assert told["least", "follower_1"]["moment"] == time[judged["range"].values[:, 0].argmin()]
    assert told["settled", "follower_1"]["moment"] == 0.0
    assert told["settled", "follower_1"]["signals"] == [["range_error", ""], ["bearing_error", ""]]
    assert told["final", "follower_4"]["moment"] == 1.0
    nearest = np.linalg.norm(judged["pose"].values[:, :, None, :2] - judged["pose"].values[:, None, :, :2], axis=-1)
    nearest[:, np.arange(4), np.arange(4)] = np.inf
    assert told["distance", ""]["moment"] == time[nearest.min(axis=(1, 2)).argmin()]
    regular = told["regular", "follower_1"]
    assert f"at t = {regular['moment']:.2f} s" in regular["detail"]


def test_the_bands_are_those_of_the_expectations(judged: Result) -> None:
    bands = {(band["text"].split()[0].strip(","), band["signal"]): band for band in content_of(judged)["bands"]}
    assert (bands["settled", "range_error"]["lower"], bands["settled", "range_error"]["upper"]) == (-10, 10)
    assert bands["settled", "bearing_error"]["upper"] == pytest.approx(np.radians(200))
    assert (bands["settled", "range_error"]["start"], bands["settled", "range_error"]["stop"]) == (0.5, 1.0)
    assert bands["peak", "torque"]["robots"] == ["follower_2"]
    assert (bands["peak", "torque"]["lower"], bands["peak", "torque"]["upper"]) == (-1, 1)
    assert (bands["least", "range"]["lower"], bands["least", "range"]["upper"]) == (1, None)
    assert (bands["rms", "bearing_error"]["lower"], bands["rms", "bearing_error"]["start"]) == (None, 0.2)
    assert bands["regular", "drive_gain"]["inside"] is False
    assert (bands["peak", "pose"]["upper"], bands["peak", "measured_pose"]["upper"]) == (None, None)


def test_events_are_on_the_time_line(scenarios: Path) -> None:
    scenario = cosim.read_scenario(scenarios / "heavy_payload.xml")
    (event, *_) = scenario.events
    result = Result.of(cosim.run(scenario.edited(["event/@at=0.04 s"], horizon=0.1, expectations=False)))
    told, *others = content_of(result)["events"]
    assert len(others) == 2, "of each follower"
    assert told["time"] == 0.04
    assert event.parameters[0].name in told["text"]
    for samples, count in ((slice(0, 2), 0), (slice(0, 3), 3), (slice(4, 6), 3)):
        part = taken(result, samples, status="incomplete")
        assert len(content_of(part)["events"]) == count, "one that was not reached has not happened"
    failure = json.dumps({"robot": "follower_1", "time": 0.06, "variable": "", "message": "it stopped"})
    failed = taken(result, slice(0, 2), status="incomplete", failure=failure)
    assert len(content_of(failed)["events"]) == 3, "the run came to it, its first samples did not"
    assert len(content_of(taken(result, slice(0, 2)))["events"]) == 3, "the run came to it, its first samples did not"
    assert content_of(taken(result, slice(0, 6), recording="drive.mcap"))["events"] == []


def taken(result: Result, samples: slice, **attrs: Any) -> Result:
    """Return a result with some of its samples, as xarray's `isel` leaves it."""
    return Result.of(result.dataset.isel(time=samples).assign_attrs(attrs))


@pytest.mark.parametrize("samples", [slice(20, 41), slice(0, 51, 5)])
@pytest.mark.parametrize("many", [False, True])
def test_a_result_without_all_samples_has_their_times(
    judged: Result, monkeypatch: pytest.MonkeyPatch, samples: slice, many: bool
) -> None:
    assert "sample_times" not in content_of(judged)
    assert "sample_times" not in content_of(taken(judged, slice(0, 20)))
    if many:
        monkeypatch.setattr(content_module, "MOST_POSES", 200)
        monkeypatch.setattr(content_module, "samples_in_bucket", lambda *_: 4)
    part = taken(judged, samples)
    content, time = content_of(part), part["time"].values
    every = content["motion"]["every"]
    assert (every > 1) == many
    assert content["sample_times"]["motion"] == [*time[: len(time) - 1 : every], time[-1]]
    shown = content["sample_times"]["signals"]
    if not many:
        assert shown == time.tolist()
    else:
        assert len(shown) == 2 * -(-len(time) // 4)
        assert shown[:4] == pytest.approx(np.interp([1, 3, 5, 7], np.arange(len(time)), time))
        assert shown[-1] == time[-1]


def test_a_recorded_drive_is_no_run_to_repeat(judged: Result) -> None:
    attrs = {**judged.attrs, "recording": "/data/drive.mcap", "recording_start": 3.5}
    told = content_of(Result(judged.data_vars, judged.coords, attrs))["provenance"]
    assert (told["command"], told["recording"]) == ("", "/data/drive.mcap from 3.5 s")


def test_a_seed_is_told_with_all_of_its_digits(judged: Result) -> None:
    attrs = {**judged.attrs, "seed": 2**63 - 1}
    assert content_of(Result(judged.data_vars, judged.coords, attrs))["provenance"]["seed"] == "9223372036854775807"


def test_nothing_in_a_page_can_become_markup(judged: Result) -> None:
    hostile = "</script><!--<script>alert(1)</script>"
    content = content_of(Result(judged.data_vars, judged.coords, {**judged.attrs, "title": hostile}))
    text = page(hostile, {"runs": [content]})
    assert text.count("<script") == 2
    assert hostile not in text
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', text)
    assert policy is not None
    for kind, tag in (("script-src", "script"), ("style-src", "style")):
        (inside,) = re.findall(rf"(?s)<{tag}>(.*?)</{tag}>", text)
        digest = base64.b64encode(hashlib.sha256(inside.encode()).digest()).decode()
        assert f"{kind} 'sha256-{digest}'" in policy[1]
    assert "default-src 'none'" in policy[1]
    assert not re.search(
        r"""(src|href)\s*=\s*["']""", text.split("<body>")[1].split("<script>")[0].split("<script type")[0]
    )


def test_a_page_of_a_result_of_an_earlier_version(judged: Result) -> None:
    coords = {name: one for name, one in judged.coords.items() if not name.startswith(("vehicle", "outline", "pose_n"))}
    attrs = {name: one for name, one in judged.attrs.items() if name not in ("scenario_file", "changes", "verdicts")}
    content = content_of(Result(judged.data_vars, coords, {**attrs, "scenario": "<older/>", "verdicts": "[]"}))
    assert [vehicle["parts"] for vehicle in content["vehicles"]] == [[]] * 5
    assert content["vehicles"][1]["pose"] == ["x", "y", "psi", "gamma"]
    assert (content["events"], content["bands"], content["verdicts"]) == ([], [], [])


def test_without_a_sample_there_is_nothing_to_show(judged: Result) -> None:
    with pytest.raises(InputError, match="the result holds no sample, so there is nothing to show"):
        content_of(judged.within(slice(0, 0)))


def test_the_command(judged: Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "one"
    run.mkdir()
    judged.dataset.to_netcdf(run / "result.nc", engine="h5netcdf")
    assert main(["report", str(run)]) == 0
    text = (run / "report.html").read_text(encoding="utf-8")
    assert "Four car-like robots" in text
    both = tmp_path / "both.html"
    assert main(["report", str(run), str(run / "result.nc"), "--out", str(both)]) == 0
    assert both.read_text(encoding="utf-8").count("Four car-like robots behind a leader on a line against ") == 2
    capsys.readouterr()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing.nc"], "there is no file nothing.nc"),
        (["{text}"], "is no netCDF file; expected the result of a run"),
        (["{other}"], "other.nc: this is not the result of a run: 'scenario_name' is missing in it"),
        (["{text}", "--out", "page.txt"], "a browser takes it for a page only if its name ends with .html"),
    ],
)
def test_bad_input(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], judged: Result
) -> None:
    (tmp_path / "text.txt").write_text("nothing", encoding="utf-8")
    judged.dataset.drop_attrs().to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    files = {"text": tmp_path / "text.txt", "other": tmp_path / "other.nc"}
    assert main(["report", *(argument.format(**files) for argument in arguments)]) == 2
    assert message in " ".join(capsys.readouterr().err.split())


def test_the_page_of_a_run_that_diverged_shows_how_far_it_came(short_line: Scenario, tmp_path: Path) -> None:
    light = short_line.edited(["plant[1]/parameter[@name='m_c']/@value=1e-3 kg"])
    with pytest.raises(cosim.SimulationError) as failed:
        cosim.run(light)
    content = content_of(Result.of(failed.value.recorded))
    assert content["status"] == "incomplete"
    assert "diverged" in content["failure"]["text"]
    save_report([failed.value.recorded], tmp_path / "report.html")


def test_how_far_apart_the_paths_of_two_runs_are() -> None:
    time = np.arange(5) * 0.5
    straight = np.stack([time, np.zeros(5)], axis=1)
    first = Paths(time, {"a": straight, "b": straight, "gone": straight})
    there = np.array([[0.0, 0.0], [0.5, 3.0], [1.0, 1.0]])
    other = Paths(time[:3], {"a": there, "b": np.full((3, 2), np.nan)})
    assert apart(first, other) == [{"robot": "a", "distance": 3.0, "time": 0.5, "end": 1.0}]
    lost = Paths(time[:3], {"a": np.array([[0.0, 0.0], [0.5, 3.0], [np.nan, 1.0]])})
    assert apart(first, lost) == [{"robot": "a", "distance": 3.0, "time": 0.5, "end": None}]
    later = Paths(time[2:], {"a": straight[2:] + np.array([0.0, 2.0])})
    assert apart(first, later) == [{"robot": "a", "distance": 2.0, "time": 1.0, "end": 2.0}]
    slower = Paths(time[:3:2], {"a": there[::2]})  # straight between its samples
    assert apart(first, slower) == [{"robot": "a", "distance": 1.0, "time": 1.0, "end": 1.0}]
    assert apart(slower, first) == [{"robot": "a", "distance": 1.0, "time": 1.0, "end": 1.0}]


def test_runs_are_compared_whatever_the_order_of_their_dimensions_and_where_a_path_ends(
    judged: Result, tmp_path: Path
) -> None:
    run = judged.dataset
    other = run.transpose(*reversed(list(run.dims))).copy(deep=True)
    other["pose"][{"time": -1, "robot": 0}] = np.nan
    save_report([run, other], tmp_path / "report.html")
    assert '"end":null' in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_a_path_that_begins_later_is_drawn_from_there(judged: Result) -> None:
    values = judged["pose"].values.copy()
    values[:3, 1] = np.nan
    values[:, 2] = np.nan
    late = replace(judged, data_vars={**judged.data_vars, "pose": replace(judged["pose"], values=values)})
    np.testing.assert_array_equal(drawable(late)["pose"].values, values)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"step": "nan"}, "its step is 'nan'"),
        ({"verdicts": '[{"passed": 1}]'}, "no verdict"),
        ({"verdicts": "[1]"}, "TypeError"),
        ({"plant_messages": "x"}, "JSONDecodeError"),
    ],
)
def test_the_result_of_another_program_is_refused(judged: Result, changed: dict[str, str], message: str) -> None:
    with pytest.raises(InputError, match=f"this is not the result of a run: .*{message}"):
        content_of(Result(judged.data_vars, judged.coords, {**judged.attrs, **changed}))


def test_times_that_do_not_increase_are_refused(judged: Result) -> None:
    time = judged.coords["time"]
    for values in (np.full_like(time.values, np.nan), time.values[::-1]):
        coords = {**judged.coords, "time": Variable(time.dims, values, time.attrs)}
        with pytest.raises(InputError, match="its times do not increase"):
            content_of(Result(judged.data_vars, coords, judged.attrs))


@pytest.mark.parametrize("told", ["x", "null", "[null]", '{"a": null}', '[{"robots": null}]', "[" * 100_000])
def test_provenance_of_another_program_is_left_out(judged: Result, told: str) -> None:
    provenance = content_of(Result(judged.data_vars, judged.coords, {**judged.attrs, "plants": told}))["provenance"]
    assert provenance["plants"] == {}
    assert [law["name"] for law in provenance["controllers"]] == ["neural-adaptive-pid"]
