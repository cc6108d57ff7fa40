"""How well each follower kept its place, in a few figures."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.clock import ROUNDING
from cosim.results.metrics import MEASURES, settling_times
from cosim.results.result import Result
from cosim.storage import blocks

RANGE_BAND = 0.1
BEARING_BAND = math.radians(2.0)
STEADY_PART = 0.2
SETTLED_PART = 0.05

NEEDED = ("range_error", "bearing_error", "torque")
"""The signals that the figures are computed from; a result without torques has no peak of them."""


@dataclass(frozen=True)
class FollowerFigures:
    """How well one follower kept its place.

    Attributes
    ----------
    settling_time : float or None
        From when on [s] the range error stays within 0.1 m and the bearing error within 2 degrees; None if they do not
        for at least the last twentieth of the horizon.
    range_rms, bearing_rms : float
        Root mean square of the errors [m], [rad] over the last fifth of the horizon; NaN of a run cut short.
    peak_torque : float
        Largest magnitude of a torque as applied [N.m]; NaN where the vehicle takes other commands.
    within_from : float or None
        From when on [s] both errors stay within these bands, however short that is; None if they do not at the end.
    """

    robot: str
    settling_time: float | None
    range_rms: float
    bearing_rms: float
    peak_torque: float
    within_from: float | None


def follower_figures(horizon: float, step: float, result: Result) -> tuple[FollowerFigures, ...]:
    """Return the figures of all followers in a run, complete or not, of a scenario with this horizon and step [s]."""
    time, rms = result["time"].values, MEASURES["rms"]
    last_chance = time[-1] - SETTLED_PART * horizon + ROUNDING if len(time) else 0.0
    whole = len(time) and time[-1] > horizon - 0.5 * step
    steady = slice(int(time.searchsorted((1 - STEADY_PART) * horizon - 0.5 * step)) if whole else len(time), None)
    within = settling_times(result, RANGE_BAND, BEARING_BAND)
    peaks = _peaks(result.of_robots("torque")) if "torque" in result else [math.nan] * len(within)
    errors = [result.of_robots(name)[steady] for name in ("range_error", "bearing_error")]
    return tuple(
        FollowerFigures(
            robot=robot,
            settling_time=settled if settled is not None and settled <= last_chance else None,
            range_rms=rms(time[steady], errors[0][:, row]),
            bearing_rms=rms(time[steady], errors[1][:, row]),
            peak_torque=peaks[row],
            within_from=settled,
        )
        for row, (robot, settled) in enumerate(within.items())
    )


def _peaks(torque: NDArray[np.float64]) -> list[float]:
    """Return the largest magnitude of each follower's torques (T, N, torques); NaN is one that it does not have."""
    peaks = np.full(torque.shape[1:], math.nan)
    for block in blocks(len(torque), torque[:1].size):
        part = np.abs(torque[block], order="C")
        while len(part) > 1:  # half against half: a sample is too short for a loop of its own
            half = (len(part) + 1) // 2
            part = np.fmax(part[:half], part[-half:])
        peaks = np.fmax(peaks, part[0])
    return [float(np.fmax.reduce(own, initial=math.nan)) for own in peaks]
