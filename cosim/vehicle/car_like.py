"""The car-like robot: rear axle, heading and steering angle; a drive and a steering torque."""

from __future__ import annotations

import math
from collections.abc import Sequence

import formation_controllers as fc
import numpy as np
from formation_controllers.vehicles import DRIVES

from cosim.vehicle.evidence import Evidence
from cosim.vehicle.kind import Example, Excitation, Kind, OnPath, Recognised, Response, Role, disturbances
from cosim.vehicle.outline import Outline, Part, box, wheels
from cosim.vehicle.path import Course, Motion, PathMotion
from cosim.vehicle.words import (
    COMPASS,
    DISTURBANCES,
    EFFORT,
    EFFORTS,
    FORWARD,
    HEADING,
    MOTION,
    NO_HEADING,
    NO_PLACE,
    NO_SPEED,
    OTHER,
    RATES,
    STEERING,
    TURNING,
    X_AXIS,
    Y_AXIS,
    clue,
    known_by,
    words,
)
from plants.elementary import atan, cos, tan


def _refusal(evidence: Evidence) -> str:
    drives = evidence.driven_by_wheels
    return f"{drives}, and no input steers" if drives else ""


_RECOGNISED = Recognised(
    by_role={
        "x": known_by("x", never=NO_PLACE),
        "y": known_by("y", never=NO_PLACE),
        "psi": known_by(HEADING, "theta|orientation", never=f"{NO_HEADING} trailer"),
        "gamma": known_by(STEERING, never=f"{OTHER} {RATES} {MOTION} {EFFORTS} ratio gear motor hand"),
        "v": known_by("v|vel|velocity|speed", clue("u", alone=True), never=NO_SPEED),
        "omega": known_by(
            f"{STEERING} rate|dot|velocity|vel|speed|omega",
            clue("omega", alone=True),
            never=f"{OTHER} {EFFORTS} yaw wheel motor engine hand acc acceleration ddot",
        ),
        "tau_drive": known_by(
            f"{EFFORT} drive|driving|driveline|drivetrain|traction|propulsion|motor|rear|engine",
            clue("drive|driving|traction|propulsion|motor", with_unit=True),
            never=f"{DISTURBANCES} steer steering gamma delta left right angle rate",
        ),
        "tau_steer": known_by(
            f"{EFFORT} {STEERING}",
            clue("steer|steering", with_unit=True),
            never=f"{DISTURBANCES} angle rate aligning",
        ),
        "a": known_by(
            "wheelbase",
            "wheel base",
            "axle|axles distance|spacing",
            clue("l|a", alone=True),
            never=f"{OTHER} half front rear",
        ),
    },
    order={
        "tau_drive": words("drive driving traction propulsion motor"),
        "tau_steer": words("steer steering gamma delta"),
    },
    conventions={
        "x": X_AXIS,
        "y": Y_AXIS,
        "v": FORWARD,
        "psi": COMPASS,
        **dict.fromkeys(("gamma", "omega", "tau_steer"), TURNING),
    },
    refusal=_refusal,
)


def _course(vehicle: fc.CarLike, state: Sequence[float]) -> Course:
    x, y, heading, steering, v, rate = state
    curvature, c = tan(steering) / vehicle.wheelbase, cos(steering)
    return Course(x, y, heading, v, curvature, rate / (vehicle.wheelbase * c * c))


def _state(vehicle: fc.CarLike, course: Course) -> tuple[float, ...]:
    slope = vehicle.wheelbase * course.curvature
    rate = vehicle.wheelbase * course.curvature_rate / (1.0 + slope * slope)
    return course.x, course.y, course.heading, atan(slope), course.v, rate


def _motion(vehicle: fc.CarLike, path: PathMotion) -> Motion:
    steering, steering_dot, steering_ddot = path.steering(vehicle.wheelbase)
    return Motion(
        np.column_stack([path.x, path.y, path.heading, steering, path.v, steering_dot]),
        np.column_stack([path.v_dot, steering_ddot]),
    )


def _outline(vehicle: fc.CarLike) -> Outline:
    """Return the body, whose length and width no parameter states: in proportion to the wheelbase a, as cars have it.

    It reaches 0.2 a beyond both axles and is 0.6 a wide. The wheels, of diameter 0.25 a, stand 0.5 a apart; steered
    ones may stick out of the body, and do not count as it.
    """
    a = vehicle.wheelbase
    return (
        Part("body", box(-0.2 * a, 1.2 * a, 0.3 * a), ("psi",)),
        *wheels("rear", "body", ("psi",), (0.0, 0.25 * a), 0.125 * a),
        *wheels("front", "body", ("psi", "gamma"), (a, 0.25 * a), 0.125 * a),
    )


CAR_LIKE = Kind(
    name="car_like",
    title="car-like robot",
    pose=(
        Role("x", "output", "m", meaning="the rear axle's midpoint along X"),
        Role("y", "output", "m", meaning="the rear axle's midpoint along Y, to the left of X"),
        Role("psi", "output", "rad", meaning="the heading, counter-clockwise from X"),
        Role("gamma", "output", "rad", meaning="the steering angle, counter-clockwise from the body"),
    ),
    velocity=(
        Role("v", "output", "m/s", optional=True, meaning="the forward velocity of the rear axle's midpoint"),
        Role("omega", "output", "rad/s", optional=True, meaning="the steering rate, counter-clockwise"),
    ),
    command=(
        Role("tau_drive", "input", "N.m", meaning="the drive torque, forward"),
        Role("tau_steer", "input", "N.m", meaning="the steering torque, counter-clockwise"),
    ),
    disturbance=disturbances("psi", "gamma"),
    geometry={
        "wheelbase": Role("a", "parameter", "m", meaning="the wheelbase"),
        "drive": Role(
            "drive",
            "parameter",
            "",
            meaning="how the drive torque acts: as_printed, front_wheel or rear_wheel",
            items=DRIVES,
        ),
    },
    vehicle=fc.CarLike,
    recognised=_RECOGNISED,
    probe=(1.0, -2.0, math.radians(30), math.radians(10)),
    responses=(Response("tau_steer", "gamma", 1), Response("tau_drive", "v", 1)),
    excitation=Excitation(
        size=(20.0, 5.0),
        commands=lambda drive_and_turning: drive_and_turning,
        turned=lambda states: states[:, 3],
    ),
    on_path=OnPath(_course, _state, _motion, steering_length=lambda vehicle: vehicle.wheelbase),
    example=Example(
        plant="car",
        leader={"tau_drive": "8 N.m", "tau_steer": "0 N.m"},
        length=1.2,
        parameter=("drive", "rear_wheel"),
        limited="tau_drive",
        limit="200 N.m",
    ),
    outline=_outline,
)
"""The car-like robot of the paper's simulations."""
