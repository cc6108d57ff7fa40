"""The tractor with a trailer: trailer's axle and two headings; the torques of the tractor's wheels."""

from __future__ import annotations

import math
from collections.abc import Sequence

import formation_controllers as fc
import numpy as np

from cosim.vehicle.evidence import Evidence
from cosim.vehicle.kind import Example, Excitation, Kind, OnPath, Recognised, Response, Role, disturbances
from cosim.vehicle.outline import Outline, Part, wheels
from cosim.vehicle.path import Course, Motion, PathMotion
from cosim.vehicle.wheels import SIDES, body_about_wheels, wheel_torques, wheels_known_by
from cosim.vehicle.words import (
    COMPASS,
    EFFORTS,
    FORWARD,
    HEADING,
    NO_HEADING,
    NO_PLACE,
    NO_SPEED,
    OTHER,
    TURNING,
    X_AXIS,
    Y_AXIS,
    clue,
    known_by,
)
from plants.elementary import atan, cos, tan

_TRACTOR = "tractor|truck|cab"


def _refusal(evidence: Evidence) -> str:
    drives = evidence.driven_by_wheels
    if drives and not evidence.trailing and {"theta_0", "theta_1"} & set(evidence.missing):
        return f"{drives}, and no name mentions a trailer or a hitch: it seems to be a differential-drive robot"
    return evidence.steers_only


_RECOGNISED = Recognised(
    by_role={
        "x": known_by("trailer x", "x", never=f"{NO_PLACE} tractor truck cab"),
        "y": known_by("trailer y", "y", never=f"{NO_PLACE} tractor truck cab"),
        "theta_1": known_by(f"trailer {HEADING}|theta|orientation", never=f"{NO_HEADING} tractor truck cab"),
        "theta_0": known_by(
            f"{_TRACTOR} {HEADING}|theta|orientation",
            clue(HEADING, alone=True),
            never=f"{NO_HEADING} trailer",
        ),
        "v": known_by("trailer v|vel|velocity|speed", "v|vel|velocity|speed", never=f"{NO_SPEED} tractor truck cab"),
        "omega": known_by(
            f"{_TRACTOR} omega",
            f"{_TRACTOR} {HEADING} rate|dot|velocity|vel",
            f"{HEADING} rate|dot|velocity|vel",
            clue("omega", alone=True),
            never=f"{OTHER} {EFFORTS} trailer wheel motor engine steer steering",
        ),
        "d": known_by("hitch|drawbar|coupling length|distance|offset", "trailer length", never=OTHER),
        **wheels_known_by(never="steer steering"),
    },
    order=SIDES,
    conventions={
        "x": X_AXIS,
        "y": Y_AXIS,
        "v": FORWARD,
        **dict.fromkeys(("theta_1", "theta_0"), COMPASS),
        "omega": TURNING,
    },
    refusal=_refusal,
)


def _course(vehicle: fc.TractorTrailer, state: Sequence[float]) -> Course:
    x, y, heading, tractor, v, omega = state
    hitch = tractor - heading
    curvature, c = tan(hitch) / vehicle.hitch_length, cos(hitch)
    rate = omega - v * curvature
    return Course(x, y, heading, v, curvature, rate / (vehicle.hitch_length * c * c))


def _state(vehicle: fc.TractorTrailer, course: Course) -> tuple[float, ...]:
    slope = vehicle.hitch_length * course.curvature
    rate = vehicle.hitch_length * course.curvature_rate / (1.0 + slope * slope)
    tractor = course.heading + atan(slope)
    return course.x, course.y, course.heading, tractor, course.v, rate + course.v * course.curvature


def _motion(vehicle: fc.TractorTrailer, path: PathMotion) -> Motion:
    hitch, hitch_dot, hitch_ddot = path.steering(vehicle.hitch_length)
    omega = path.v * path.kappa + hitch_dot
    omega_dot = path.v_dot * path.kappa + path.v * path.kappa_dot + hitch_ddot
    return Motion(
        np.column_stack([path.x, path.y, path.heading, path.heading + hitch, path.v, omega]),
        np.column_stack([path.v_dot, omega_dot]),
    )


def _outline(vehicle: fc.TractorTrailer) -> Outline:
    """Return two bodies, the trailer and the tractor, and their wheels.

    The tractor's body is one about its wheels, see `body_about_wheels`. No parameter states the trailer's: it is as
    wide, reaches 0.3 d behind its axle and 0.5 d ahead, d being the hitch length, and tapers from there to the hitch.
    """
    d, b, r = vehicle.hitch_length, vehicle.half_track, vehicle.wheel_radius
    width = 1.2 * b
    trailer = ((-0.3 * d, -width), (0.5 * d, -width), (d, 0.0), (0.5 * d, width), (-0.3 * d, width))
    return (
        Part("trailer", trailer, ("theta_1",)),
        Part("tractor", body_about_wheels(b, r), ("theta_0",), on="trailer", at=(d, 0.0)),
        *wheels("trailer's", "trailer", ("theta_1",), (0.0, b), r),
        *wheels("tractor's", "tractor", ("theta_0",), (0.0, b), r),
    )


TRACTOR_TRAILER = Kind(
    name="tractor_trailer",
    title="tractor-trailer",
    pose=(
        Role("x", "output", "m", meaning="the trailer's axle midpoint along X"),
        Role("y", "output", "m", meaning="the trailer's axle midpoint along Y, to the left of X"),
        Role("theta_1", "output", "rad", meaning="the trailer's heading, counter-clockwise from X"),
        Role("theta_0", "output", "rad", meaning="the tractor's heading, counter-clockwise from X"),
    ),
    velocity=(
        Role("v", "output", "m/s", optional=True, meaning="the forward velocity of the trailer's axle midpoint"),
        Role(
            "omega", "output", "rad/s", optional=True, meaning="the angular velocity of the tractor, counter-clockwise"
        ),
    ),
    command=(
        Role("tau_right", "input", "N.m", meaning="the torque of the tractor's right wheel, forward"),
        Role("tau_left", "input", "N.m", meaning="the torque of the tractor's left wheel, forward"),
    ),
    disturbance=disturbances("theta_1", "theta_0"),
    geometry={
        "hitch_length": Role("d", "parameter", "m", meaning="the distance from the trailer's axle to the hitch"),
        "wheel_radius": Role("r", "parameter", "m", meaning="the radius of the tractor's wheels"),
        "half_track": Role("b", "parameter", "m", meaning="half the distance between the tractor's wheels"),
    },
    vehicle=fc.TractorTrailer,
    recognised=_RECOGNISED,
    probe=(1.0, -2.0, math.radians(30), math.radians(40)),
    responses=(
        Response("tau_right", "theta_0", 1),
        Response("tau_left", "theta_0", -1),
        Response("tau_right", "v", 1),
    ),
    excitation=Excitation(size=(20.0, 5.0), commands=wheel_torques, turned=lambda states: states[:, 3] - states[:, 2]),
    on_path=OnPath(_course, _state, _motion, steering_length=lambda vehicle: vehicle.hitch_length),
    example=Example(
        plant="truck",
        leader={"tau_right": "1 N.m", "tau_left": "1 N.m"},
        length=1.5,
        parameter=("m_1", "20 kg"),
        limited="tau_right",
        limit="200 N.m",
    ),
    outline=_outline,
)
"""The tractor-trailer of the paper's third simulation."""
