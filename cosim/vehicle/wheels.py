"""Two driven wheels on one axle, which some kinds of vehicle have in common."""

from __future__ import annotations

import numpy as np

from cosim.vehicle.outline import Point
from cosim.vehicle.path import Floats
from cosim.vehicle.words import DISTURBANCES, EFFORT, OTHER, Recognition, clue, known_by, words

SIDES = {"tau_right": words("right"), "tau_left": words("left")}
"""Words of a description that distinguish the wheels' torques."""


def wheel_torques(drive_and_turning: Floats) -> Floats:
    """Return the torques (T, 2) of the right and the left wheel for courses of drive and turning (T, 2)."""
    drive, turning = drive_and_turning.T
    return np.column_stack([drive + turning, drive - turning]) / 2


def body_about_wheels(half_track: float, wheel_radius: float) -> tuple[Point, ...]:
    """Return the corners of a body about two wheels, whose length and width no parameter states.

    Its half width is 1.2 times the half track; so is its half length, or as much as the wheels' radius if that is
    larger. Its front corners are cut off, so that a drawing shows where ahead is.
    """
    width = 1.2 * half_track
    length = max(width, wheel_radius)
    return (
        (-length, -width),
        (length / 2, -width),
        (length, -width / 2),
        (length, width / 2),
        (length / 2, width),
        (-length, width),
    )


def wheels_known_by(never: str = "") -> dict[str, Recognition]:
    """Return how torques, radius and half track of the wheels are recognised; torques have no word of `never`."""
    return {
        "tau_right": known_by(
            f"right|r {EFFORT}",
            clue("right motor|wheel|drive", with_unit=True),
            never=f"{DISTURBANCES} left l {never}",
        ),
        "tau_left": known_by(
            f"left|l {EFFORT}",
            clue("left motor|wheel|drive", with_unit=True),
            never=f"{DISTURBANCES} right r {never}",
        ),
        "r": known_by("wheel radius", clue("radius", alone=True), never=OTHER),
        "b": known_by("half track|gauge|width", never=OTHER),
    }
