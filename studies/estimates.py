"""The estimates of the second simulation (Figure 7) held against the true values, not the measured ones.

    python studies/estimates.py

prints their errors over 80 to 100 s, the worst of the seeds 1 to 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pages import SCENARIOS, heading, row

import cosim
from cosim.scenario.edits import set_seed

SEEDS = range(1, 4)
FILES = ("clmr_circle_as_printed", "clmr_circle")
QUIET = ["//noise/@x=0 mm", "//noise/@y=0 mm", "//noise/@psi=0 mrad", "//noise/@gamma=0 mrad"]
ESTIMATES = {"range": "mm", "bearing": "°", "speed": "mm/s", "steering rate": "°/s"}

Array = NDArray[np.float64]


def steady(path: Path, changes: Sequence[str], seed: int) -> xr.Dataset:
    """Return the last fifth of a run."""
    scenario = cosim.read_scenario(path, [*changes, set_seed(seed)])
    return cosim.run(scenario).sel(time=slice(0.8 * scenario.horizon, None))


def rms(signal: xr.DataArray) -> Array:
    """Return the root mean square over time of each follower."""
    return np.asarray(np.sqrt((signal**2).mean("time")).values)


def estimation(result: xr.Dataset) -> Array:
    """Return the estimates' errors (4, followers): range [mm], bearing [deg], speed [mm/s], steering rate [deg/s]."""
    speed, steering_rate = (result["velocity"].isel(velocity_component=i) for i in range(2))
    return np.stack(
        [
            1000 * rms(result["range"] - result["range_estimate"]),
            np.degrees(rms(result["bearing"] - result["bearing_estimate"])),
            1000 * rms(speed - result["speed_estimate"]),
            np.degrees(rms(steering_rate - result["steering_rate_estimate"])),
        ]
    )


def main() -> None:
    """Print the tables."""
    followers = [f"follower {i}" for i in range(1, 5)]
    for file in FILES:
        path = SCENARIOS / f"{file}.xml"
        print(f"\n{file}: errors of the estimates, RMS\n")
        print(heading("", *followers))
        for noise, changes in (("", []), (", no noise", QUIET)):
            worst = np.max([estimation(steady(path, changes, seed)) for seed in SEEDS], axis=0)
            for (label, unit), values in zip(ESTIMATES.items(), worst, strict=True):
                print(row(label + noise, *(f"{value:.2f} {unit}".replace(" °", "°") for value in values)), flush=True)


if __name__ == "__main__":
    main()
