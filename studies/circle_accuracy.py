"""Two claims on the second simulation (Figure 7): gain and cost of a smaller epsilon_t, and the estimates.

    python studies/circle_accuracy.py

prints tables over 80 to 100 s, the worst of the seeds 1 to 3. The change of torque is that from tick to tick, root mean
square over all followers and both torques; estimates are compared with the true values, not with the measured ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from variation import SCENARIOS, gain, heading, row

import cosim
from cosim.scenario.edits import set_seed

SEEDS = range(1, 4)
FILES = ("clmr_circle_as_printed", "clmr_circle")
QUIET = ["//noise/@x=0 mm", "//noise/@y=0 mm", "//noise/@psi=0 mrad", "//noise/@gamma=0 mrad"]
EPSILONS = {
    "ε_t = 10 (as printed)": gain(epsilon_t=10),
    "ε_t = 3": gain(epsilon_t=3),
    "ε_t = 1": gain(epsilon_t=1),
    "ε_t = 10, no noise": [*gain(epsilon_t=10), *QUIET],
    "ε_t = 1, no noise": [*gain(epsilon_t=1), *QUIET],
}

ESTIMATES = {"range": "mm", "bearing": "°", "speed": "mm/s", "steering rate": "°/s"}

Array = NDArray[np.float64]


def steady(path: Path, changes: Sequence[str], seed: int) -> xr.Dataset:
    """Return the last fifth of a run."""
    scenario = cosim.read_scenario(path, [*changes, set_seed(seed)])
    return cosim.run(scenario).sel(time=slice(0.8 * scenario.horizon, None))


def rms(signal: xr.DataArray) -> Array:
    """Return the root mean square over time of each follower."""
    return np.asarray(np.sqrt((signal**2).mean("time")).values)


def accuracy(result: xr.Dataset) -> Array:
    """Return range errors [mm], then bearing errors [deg], of the followers; last, the change of torque [N.m]."""
    change = math.sqrt(float((result["torque"].diff("time") ** 2).mean()))
    return np.array([*(1000 * rms(result["range_error"])), *np.degrees(rms(result["bearing_error"])), change])


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
        print(f"\n{file}: range error, RMS; largest bearing error; change of torque\n")
        print(heading("", *followers, "bearing error", "change of torque"))
        for label, changes in EPSILONS.items():
            worst = np.max([accuracy(steady(path, changes, seed)) for seed in SEEDS], axis=0)
            cells = [f"{value:.0f} mm" for value in worst[:4]]
            print(row(label, *cells, f"{max(worst[4:8]):.2f}°", f"{worst[8]:.2f} N.m"), flush=True)
        print(f"\n{file}: errors of the estimates, RMS\n")
        print(heading("", *followers))
        for noise, changes in (("", []), (", no noise", QUIET)):
            worst = np.max([estimation(steady(path, changes, seed)) for seed in SEEDS], axis=0)
            for (label, unit), values in zip(ESTIMATES.items(), worst, strict=True):
                print(row(label + noise, *(f"{value:.2f} {unit}".replace(" °", "°") for value in values)), flush=True)


if __name__ == "__main__":
    main()
