"""The paper's first simulation (section 5.1, Figure 6) through the whole house: scenario, FMUs, controller, master.

The numbers of the literal reading come from an independent implementation of the same equations.
"""

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import cosim
from cosim.results.summary import summarise

NO_NOISE = ["//noise/@x=0 m", "//noise/@y=0 m", "//noise/@psi=0 rad", "//noise/@gamma=0 rad"]


@pytest.fixture(scope="module")
def literal(scenarios: Path) -> xr.Dataset:
    return cosim.run(scenarios / "clmr_line_as_printed.xml", NO_NOISE)


def test_without_noise_the_measured_pose_is_the_pose(literal: xr.Dataset) -> None:
    assert np.array_equal(literal["measured_pose"], literal["pose"])


def test_poses_at_5_s(literal: xr.Dataset) -> None:
    expected = [
        [3.857638, 2.536781, 0.962215, 0.234500],
        [3.399517, 8.457761, -0.820298, -0.235215],
        [-2.240889, 11.343745, -1.250853, 0.396454],
        [-2.172558, -0.506999, 1.289044, -0.391531],
    ]
    assert literal["time"].values[250] == 5.0
    assert literal["pose"].values[250] == pytest.approx(np.array(expected), abs=1e-5)


def test_poses_of_followers_3_and_4_at_100_s(literal: xr.Dataset) -> None:
    expected = [[25.166945, 3.590951, -0.022545, 0.003651], [25.169945, 7.402873, 0.023088, -0.003713]]
    assert literal["time"].values[-1] == 100.0
    assert literal["pose"].values[-1, 2:] == pytest.approx(np.array(expected), abs=1e-4)


def test_the_leader(literal: xr.Dataset) -> None:
    assert literal["leader_pose"].values[[1000, 5000], 0] == pytest.approx([8.516, 34.116], abs=1e-3)
    assert literal["leader_velocity"].values[-1] == pytest.approx([0.32, 0.0], abs=1e-6)


def test_followers_1_and_2_oscillate_to_the_end(literal: xr.Dataset, scenarios: Path) -> None:
    """The finding: with the printed gains, the run does not show the paper's Figure 6."""
    summary = summarise(cosim.read_scenario(scenarios / "clmr_line_as_printed.xml"), literal)
    assert [follower.settling_time is None for follower in summary.followers] == [True, True, False, False]
    one, two = summary.followers[:2]
    assert (one.range_rms, two.range_rms) == pytest.approx((0.41, 0.39), abs=0.005)
    assert np.degrees([one.bearing_rms, two.bearing_rms]) == pytest.approx([5.1, 5.0], abs=0.05)
    last = literal["range_error"].sel(time=slice(60, 100))
    for robot in ("follower_1", "follower_2"):
        spectrum = np.abs(np.fft.rfft(last.sel(robot=robot).values * np.hanning(last.sizes["time"])))
        frequency = 2 * np.pi * np.fft.rfftfreq(last.sizes["time"], 0.02)
        assert frequency[spectrum.argmax()] == pytest.approx(0.88, abs=0.1)


def test_that_run_leaves_the_domain_of_the_theory_and_says_so(literal: xr.Dataset, scenarios: Path) -> None:
    notes = summarise(cosim.read_scenario(scenarios / "clmr_line_as_printed.xml"), literal).notes
    assert [note.split(":")[0] for note in notes if "drive_gain" in note] == ["follower_1", "follower_2"]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_with_one_number_changed_all_four_settle(scenarios: Path, seed: int) -> None:
    scenario = cosim.read_scenario(scenarios / "clmr_line.xml", [f"//simulation/@seed={seed}"])
    result = cosim.run(scenario)
    last = result.sel(time=slice(80, 100))
    assert np.sqrt((last["range_error"] ** 2).mean("time")).max() < 0.1
    assert np.degrees(np.sqrt((last["bearing_error"] ** 2).mean("time"))).max() < 2.0
    summary = summarise(scenario, result)
    assert summary.passed
    assert summary.notes == (), "it stays within the domain of the theory"


def without_places(value: Any) -> Any:
    """Return plain data, without the lines in which it is written."""
    if isinstance(value, tuple):
        return [without_places(entry) for entry in value]
    if is_dataclass(value):
        return {f.name: without_places(getattr(value, f.name)) for f in fields(value) if f.name != "where"}
    return value


def test_one_number_is_all_that_differs(scenarios: Path) -> None:
    printed, changed = (cosim.read_scenario(scenarios / f"clmr_line{s}.xml") for s in ("_as_printed", ""))
    for name in ("step", "ticks", "period", "seed", "inputs", "leader", "followers", "events"):
        assert without_places(getattr(changed, name)) == without_places(getattr(printed, name))
    gains = [{g.name: g.value for g in s.controllers["pid"].gains} for s in (printed, changed)]
    assert {name for name in gains[0] if gains[0][name] != gains[1][name]} == {"W_m"}
    parameters = [[(p.name, p.value) for p in s.plants["clmr"].parameters] for s in (printed, changed)]
    assert parameters[0] == parameters[1]
