"""Two driven wheels on one axle, which some kinds of vehicle have in common."""

from __future__ import annotations

import numpy as np

from cosim.vehicle.path import Floats
from cosim.vehicle.words import words

SIDES = {"tau_right": words("right"), "tau_left": words("left")}
"""Words of a description that distinguish the wheels' torques."""


def wheel_torques(drive_and_turning: Floats) -> Floats:
    """Return the torques (T, 2) of the right and the left wheel for courses of drive and turning (T, 2)."""
    drive, turning = drive_and_turning.T
    return np.column_stack([drive + turning, drive - turning]) / 2
