"""How well each follower kept its place, in a few figures."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.results.metrics import MEASURES, settling_time
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
        Root mean square of the errors [m], [rad] over the last fifth of the horizon.
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
    return tuple(_of_robot(horizon, step, result, robot) for robot in result.robots)


def _of_robot(horizon: float, step: float, result: Result, robot: str) -> FollowerFigures:
    time = result["time"].values
    settled = settling_time(result, robot, RANGE_BAND, BEARING_BAND)
    last_chance = time[-1] - SETTLED_PART * horizon if len(time) else 0.0
    steady = slice(int(np.searchsorted(time, (1 - STEADY_PART) * horizon - 0.5 * step)), None)
    torque = result.of_robot("torque", robot) if "torque" in result else np.zeros((0, 1))
    return FollowerFigures(
        robot=robot,
        settling_time=settled if settled is not None and settled <= last_chance else None,
        range_rms=MEASURES["rms"](time[steady], result.of_robot("range_error", robot)[steady]),
        bearing_rms=MEASURES["rms"](time[steady], result.of_robot("bearing_error", robot)[steady]),
        peak_torque=_peak(torque),
        within_from=settled,
    )


def _peak(torque: NDArray[np.float64]) -> float:
    """Return the largest magnitude of torques (T, torques); NaN is one that the vehicle does not have."""
    peak = math.nan
    for block in blocks(len(torque), torque.shape[1]):
        peak = float(np.fmax(peak, np.fmax.reduce(np.abs(torque[block]), axis=None)))
    return peak
