"""Runs whose records do not fit in memory: the same numbers, verdicts and files, part by part and from files."""

import errno
import math
import os
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import cosim
import cosim.cli.run
import cosim.storage
from cosim.cli import main
from cosim.clock import Clock
from cosim.errors import InputError
from cosim.master.mock_fleet import MockFleet
from cosim.master.setup import set_up
from cosim.master.simulation import Simulation
from cosim.report import content
from cosim.results import metrics, passes, representative
from cosim.results.files import load, save
from cosim.results.panels import panels_by_sample
from cosim.results.result import Result
from cosim.results.summary import summarise
from cosim.scenario.reader import read_scenario
from cosim.signals.trajectory import _Heading
from cosim.storage import Storage
from cosim.tests.driving import SHORT
from cosim.tests.driving import scenario as written
from cosim.tests.without_fmus import mock_scenario, mock_setup

SCENARIOS = Path(__file__).parents[1] / "scenarios"
PLANT = '<plant id="car" model="car_like"/>'


@pytest.fixture
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let all passes be made in parts of a few samples, as if courses were very long."""
    monkeypatch.setattr(cosim.storage, "_AT_ONCE", 40)
    monkeypatch.setattr(cosim.storage, "_FEWEST", 8)
    monkeypatch.setattr(passes, "_SUMMED_AT_ONCE", 128)


@pytest.mark.parametrize("name", ["mixed_team", "figure_eight", "side_wind"])
def test_a_run_in_files_and_in_parts_is_the_same(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = read_scenario(SCENARIOS / f"{name}.xml").edited(horizon=0.6, expectations=False)
    expected = Result.of(cosim.run(scenario))
    summary = summarise(scenario, expected).to_json()
    monkeypatch.setattr(cosim.storage, "IN_MEMORY", 0)
    monkeypatch.setattr(cosim.storage, "_AT_ONCE", 40)
    monkeypatch.setattr(cosim.storage, "_FEWEST", 8)
    monkeypatch.setattr("cosim.master.simulation._KEPT", 1)
    found = Result.of(cosim.run(scenario))
    assert len(cosim.storage._MAPPED) > 3
    save(found, tmp_path / "result.nc")
    xr.testing.assert_identical(load(tmp_path / "result.nc"), expected.dataset)
    assert summarise(scenario, found).to_json() == summary
    assert not [*tmp_path.glob("*.nc.*"), *tmp_path.glob("tmp*")]


def courses() -> dict[str, np.ndarray]:
    """Return courses whose figures depend on the order of summation, with ties, signs, gaps and infinities."""
    random = np.random.default_rng(3)
    course = random.standard_normal(3001) * np.exp(3 * random.standard_normal(3001))
    gap, infinite = course.copy(), course.copy()
    gap[[700, 701, 2900]] = np.nan
    infinite[1500] = -np.inf
    return {"noise": course, "gap": gap, "infinite": infinite, "ties": np.round(course) % 3 - 1, "one": course[:1]}


@pytest.mark.parametrize("name", courses())
def test_figures_of_parts_have_the_bits_of_the_whole(name: str, small_parts: None) -> None:
    course = courses()[name]
    strided = np.stack([course, -course], axis=1)[:, 0]
    time = Clock(0.02, len(course) - 1).times
    magnitude, terms = np.abs(course), (time - 0.5) * np.abs(course)
    expected: dict[str, Any] = {
        "rms": np.sqrt(np.mean(np.square(course))),
        "peak": magnitude.max(),
        "final": magnitude[-1],
        "itae": 0.5 * np.sum((terms[1:] + terms[:-1]) * np.diff(time)),
        "least": course.min(),
    }
    for measure, figure in expected.items():
        assert np.array_equal(metrics.MEASURES[measure](time, strided, 0.5), figure, equal_nan=True), measure
    assert metrics.MEASURES["peak"].at(strided) == magnitude.argmax()
    assert metrics.MEASURES["least"].at(strided) == course.argmin()
    changes = np.flatnonzero(np.diff(np.signbit(course)))
    first = int(changes[0]) + 1 if len(changes) else -1
    assert passes.sign_changes(strided[:, np.newaxis]) == (len(changes), first)
    outside = np.flatnonzero(~(magnitude <= 1))
    last = [outside[-1] if len(outside) else -1, -1]
    inside = np.stack([magnitude <= 1, np.ones(len(course), dtype=bool)], axis=1)
    assert passes.last_outside(*inside.shape, lambda part: inside[part]) == last
    both = np.stack([course, course[::-1], -course], axis=1)
    expected_ends = [(own.argmin(), own.argmax()) for own in both.T[[0, 2]]]
    assert passes.extremes_of_each(both, [0, 2]) == expected_ends


def test_a_heading_is_unwrapped_as_numpy_does() -> None:
    turning = np.cumsum(np.random.default_rng(2).uniform(-1.5, 1.5, 1000))
    raw = np.arctan2(np.sin(turning), np.cos(turning))
    heading, parts = _Heading(), np.split(raw, [1, 2, 300, 999])
    found = [heading.unwrapped(part) for part in parts]
    expected = np.unwrap(raw)
    assert np.array_equal(np.concatenate([part for part, _ in found]), expected)
    assert np.array_equal(np.concatenate([part for _, part in found]), np.diff(expected, prepend=expected[0]))


def moving(time: float, inputs: np.ndarray) -> np.ndarray:
    """Return poses and velocities of cars that drive along x."""
    state = np.zeros((len(inputs) // 2, 6))
    state[:, 0], state[:, 4] = time, 1.0
    return state


def test_the_memory_of_a_run_does_not_grow_with_its_length(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cosim.storage, "_AT_ONCE", 64)
    monkeypatch.setattr(cosim.storage, "_FEWEST", 16)
    monkeypatch.setattr(representative, "MOST", 100)
    monkeypatch.setattr(content, "MOST_NUMBERS", 100)
    monkeypatch.setattr(content, "MOST_POSES", 100)

    def peak(horizon: str) -> int:
        scenario = mock_scenario(tmp_path / horizon, horizon=horizon)
        setup = replace(mock_setup(scenario), storage=Storage(tmp_path, in_memory=0))
        tracemalloc.start()
        with Simulation(scenario, setup, fleet=partial(MockFleet, moving)) as simulation:
            result = simulation.run_to_end()
        save(result, tmp_path / "result.nc")
        content.content_of(result, summarise(scenario, result))
        representative.representative(result)
        peaked = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peaked

    peak("1 s")  # caches
    short, long = peak("5 s"), peak("20 s")
    assert long < 1.3 * short, (short, long)


PEAKS = """import sys
import cosim.storage
from cosim.cli import main
from cosim.master import simulation
from cosim.report import content
from cosim.results import passes
cosim.storage._AT_ONCE = passes._SUMMED_AT_ONCE = 2**11
cosim.storage._FEWEST = 2**7
cosim.storage.IN_MEMORY = simulation._KEPT = 2**20
content.MOST_NUMBERS = content.MOST_POSES = 1000
for horizon in sys.argv[3:]:
    with open("/proc/self/clear_refs", "w") as file:
        file.write("5")
    status = main(["run", sys.argv[1], "--out", sys.argv[2], "--horizon", horizon, "--no-figure"])
    peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
    print("peak", status, peak.split()[1])
"""
"""Prints the peak of all memory of a process, mapped files among it, that each of several runs has."""


@pytest.mark.skipif(not os.access("/proc/self/clear_refs", os.W_OK), reason="Linux tells the peak of memory")
def test_the_peak_of_a_run_with_its_files_does_not_grow_with_its_length(tmp_path: Path) -> None:
    """Courses that change on the way are as long as the run, too: places, torques, signals."""
    scenario, horizons = SCENARIOS / "formation_change.xml", ("120 s", "240 s", "900 s")
    command = [sys.executable, "-c", PEAKS, str(scenario), str(tmp_path), *horizons]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    peaks = [line.split()[1:] for line in done.stdout.splitlines() if line.startswith("peak ")]
    assert [status for status, _ in peaks] == ["0"] * 3, done.stdout + done.stderr
    _, short, long = (1024 * int(peak) for _, peak in peaks)
    _, smaller, larger = sorted(path.stat().st_size for path in tmp_path.glob("*/result.nc"))
    assert long - short < 0.1 * (larger - smaller), (short, long, smaller, larger)


def test_a_long_result_is_drawn_by_its_extremes(monkeypatch: pytest.MonkeyPatch) -> None:
    result = Result.of(cosim.run(SCENARIOS / "clmr_line.xml", horizon=2.0, expectations=False))
    assert representative.representative(result) is result
    monkeypatch.setattr(representative, "MOST", 60)
    monkeypatch.setattr(representative, "_FEWEST", 2)
    few = representative.representative(result)
    assert few.sizes["time"] < result.sizes["time"]
    for shown, whole in zip(panels_by_sample(few), panels_by_sample(result), strict=True):
        assert np.array_equal(np.nanmin(shown.courses, axis=0), np.nanmin(whole.courses, axis=0)), whole.title
        assert np.array_equal(np.nanmax(shown.courses, axis=0), np.nanmax(whole.courses, axis=0)), whole.title
    assert few["time"].values[[0, -1]].tolist() == result["time"].values[[0, -1]].tolist()


# What is refused -------------------------------------------------------------------------------------------------


def test_a_run_that_is_too_long_is_refused_with_its_place_before_anything_is_made(tmp_path: Path) -> None:
    path = written(tmp_path / "long.xml", PLANT, horizon="200000 s", followers=["car"] * 40)
    scenario = read_scenario(path)
    made: list[object] = []
    storage = Storage(tmp_path)
    storage.empty = lambda *shape: made.append(shape)  # type: ignore[method-assign, assignment]
    with pytest.raises(
        InputError, match=r"would record \d+\.\d GiB, 10000001 samples of .* 64 GiB are allowed"
    ) as told:
        set_up(scenario, ExitStack(), {}, storage=storage)
    assert not made
    assert told.value.where is not None
    assert (told.value.where.file, told.value.where.line) == (str(path), 3)
    horizon = float(str(told.value).partition("shorten the horizon to ")[2].partition(" s")[0])
    step = float(str(told.value).partition("lengthen the step to ")[2].partition(" s")[0])
    assert horizon / 0.02 == pytest.approx(200_000 / step, rel=0.1)
    set_up(scenario.edited(horizon=horizon), ExitStack(), {}, storage=Storage(tmp_path))


@pytest.mark.parametrize("most", [0, 30_000], ids=["records", "result"])
def test_a_disk_without_room_is_told_before_the_run(
    most: int, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(file: Any, size: int) -> None:
        if size > most:
            raise OSError(errno.ENOSPC, "No space left on device")
        file.truncate(size)

    monkeypatch.setattr(cosim.storage, "IN_MEMORY", 0)
    monkeypatch.setattr(cosim.storage, "take", full)
    line = str(SCENARIOS / "clmr_line.xml")
    assert main(["run", line, "--out", str(tmp_path / "runs"), *SHORT, "--no-figure"]) == 71
    printed = capsys.readouterr().err
    assert "has no room for the" in printed
    assert "No space left on device; shorten the run, or make room" in printed
    assert not (tmp_path / "runs").exists()


def test_what_is_reserved_is_given_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []
    take: Callable[..., None] = cosim.storage.take
    monkeypatch.setattr(cosim.storage, "take", lambda file, size: (sizes.append(size), take(file, size)))
    storage = Storage(tmp_path / "not yet" / "there", in_memory=1000)
    storage.reserve(1000)
    assert sizes == []
    storage.reserve(1001)
    assert sizes == [1001]
    storage.release()
    storage.release()
    assert storage.empty((100,)).nbytes == 800
    assert storage.empty((100,)).sum() == 0.0  # in a file
    assert storage.shared((3, 2), np.float64).shape == (3, 2)
    assert sizes == [1001, 800, 48]
    assert not list(tmp_path.iterdir())
    assert math.prod(storage.empty((0, 3)).shape) == 0
