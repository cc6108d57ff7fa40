"""Same scenario, same seed, same versions: the same numbers, bit for bit, in any process and order."""

import hashlib
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import cosim
from cosim.scenario.edits import set_seed

SHORT: dict[str, Any] = {"horizon": 4.0, "expectations": False}


def run(scenarios: Path, seed: int) -> xr.Dataset:
    return cosim.run(scenarios / "clmr_line_as_printed.xml", [set_seed(seed)], **SHORT)


def digest(result: xr.Dataset) -> str:
    parts = (result[name].values.tobytes() for name in sorted(result.data_vars))
    return hashlib.sha256(b"".join(parts)).hexdigest()


def test_same_seed_same_numbers_in_any_order(scenarios: Path) -> None:
    first, other, again = (run(scenarios, seed) for seed in (1, 2, 1))
    assert digest(first) == digest(again)
    assert digest(first) != digest(other)


def test_another_seed_is_other_noise_everywhere(scenarios: Path) -> None:
    noise = [(r["measured_pose"] - r["pose"]).values for r in (run(scenarios, 1), run(scenarios, 2))]
    assert not np.any(noise[0] == noise[1])


def test_another_process_gives_the_same_numbers(scenarios: Path, tmp_path: Path) -> None:
    program = f"""
import cosim, numpy as np
result = cosim.run({str(scenarios / "clmr_line_as_printed.xml")!r}, **{SHORT!r})
np.savez({str(tmp_path / "r.npz")!r}, **{{name: result[name].values for name in result.data_vars}})
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=300)
    here = run(scenarios, 1)
    there = np.load(tmp_path / "r.npz")
    assert set(there) == set(here.data_vars)
    for name in there:
        assert np.array_equal(there[name], here[name].values, equal_nan=True), name


def test_step_by_step_is_the_same_run(scenarios: Path) -> None:
    scenario = cosim.read_scenario(scenarios / "clmr_line_as_printed.xml").edited(**SHORT)
    with cosim.Simulation(scenario) as simulation:
        while not simulation.finished:
            simulation.step()
        stepped = simulation.result()
    xr.testing.assert_identical(stepped, cosim.run(scenario))


def test_two_simulations_at_once_do_not_disturb_each_other(scenarios: Path) -> None:
    scenario = cosim.read_scenario(scenarios / "clmr_line_as_printed.xml").edited(**SHORT)
    with cosim.Simulation(scenario) as one, cosim.Simulation(scenario) as two:
        for _ in range(50):
            one.step()
        two.run()
        one.run()
        assert digest(one.result()) == digest(two.result())
