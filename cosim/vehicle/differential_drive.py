"""The differential-drive robot: midpoint of the axle and heading; the torques of a right and a left wheel."""

from __future__ import annotations

import math
from collections.abc import Sequence

import formation_controllers as fc
import numpy as np

from cosim.vehicle.evidence import Evidence
from cosim.vehicle.kind import Example, Excitation, Kind, OnPath, Recognised, Response, Role, disturbances
from cosim.vehicle.outline import Outline, Part, wheels
from cosim.vehicle.path import Course, Motion, PathMotion
from cosim.vehicle.wheels import SIDES, body_about_wheels, wheel_torques
from cosim.vehicle.words import (
    COMPASS,
    DISTURBANCES,
    EFFORT,
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

_STANDING = 1e-6
"""Speed [m/s] below which a robot turns on the spot, so that its path has no curvature."""


def _refusal(evidence: Evidence) -> str:
    drives = evidence.driven_by_wheels
    if drives and evidence.trailing:
        return f"{drives}, and it mentions a trailer or a hitch: it seems to be a tractor with a trailer"
    return evidence.steers_only


_RECOGNISED = Recognised(
    by_role={
        "x": known_by("x", never=NO_PLACE),
        "y": known_by("y", never=NO_PLACE),
        "theta": known_by(f"{HEADING}|theta|orientation|phi", never=NO_HEADING),
        "v": known_by("v|vel|velocity|speed", clue("u", alone=True), never=NO_SPEED),
        "omega": known_by(
            f"{HEADING}|theta rate|dot|velocity|vel",
            "angular|turn|rotation velocity|vel|rate|speed",
            clue("omega|w", alone=True),
            never=f"{OTHER} {EFFORTS} wheel motor engine right left",
        ),
        "tau_right": known_by(
            f"right|r {EFFORT}", clue("right motor|wheel|drive", with_unit=True), never=f"{DISTURBANCES} left l"
        ),
        "tau_left": known_by(
            f"left|l {EFFORT}", clue("left motor|wheel|drive", with_unit=True), never=f"{DISTURBANCES} right r"
        ),
        "r": known_by("wheel radius", clue("radius", alone=True), never=OTHER),
        "b": known_by("half track|gauge|width", never=OTHER),
    },
    order=SIDES,
    conventions={"x": X_AXIS, "y": Y_AXIS, "theta": COMPASS, "v": FORWARD, "omega": TURNING},
    refusal=_refusal,
)


def _course(_: fc.DifferentialDrive, state: Sequence[float]) -> Course:
    """Return its course on a path; a robot that turns on the spot is on a straight path. The rate is not known."""
    x, y, heading, v, omega = state
    return Course(x, y, heading, v, omega / v if abs(v) > _STANDING else 0.0, 0.0)


def _state(_: fc.DifferentialDrive, course: Course) -> tuple[float, ...]:
    return course.x, course.y, course.heading, course.v, course.v * course.curvature


def _motion(_: fc.DifferentialDrive, path: PathMotion) -> Motion:
    omega_dot = path.v_dot * path.kappa + path.v * path.kappa_dot
    return Motion(
        np.column_stack([path.x, path.y, path.heading, path.v, path.v * path.kappa]),
        np.column_stack([path.v_dot, omega_dot]),
    )


def _outline(vehicle: fc.DifferentialDrive) -> Outline:
    """Return a body about the wheels, see `body_about_wheels`, and the wheels."""
    b, r = vehicle.half_track, vehicle.wheel_radius
    return Part("body", body_about_wheels(b, r), ("theta",)), *wheels("", "body", ("theta",), (0.0, b), r)


DIFFERENTIAL_DRIVE = Kind(
    name="differential_drive",
    title="differential-drive robot",
    pose=(
        Role("x", "output", "m", meaning="the axle's midpoint along X"),
        Role("y", "output", "m", meaning="the axle's midpoint along Y, to the left of X"),
        Role("theta", "output", "rad", meaning="the heading, counter-clockwise from X"),
    ),
    velocity=(
        Role("v", "output", "m/s", optional=True, meaning="the forward velocity of the axle's midpoint"),
        Role("omega", "output", "rad/s", optional=True, meaning="the angular velocity, counter-clockwise"),
    ),
    command=(
        Role("tau_right", "input", "N.m", meaning="the torque of the right wheel, forward"),
        Role("tau_left", "input", "N.m", meaning="the torque of the left wheel, forward"),
    ),
    disturbance=disturbances("theta"),
    geometry={
        "wheel_radius": Role("r", "parameter", "m", meaning="the radius of the wheels"),
        "half_track": Role("b", "parameter", "m", meaning="half the distance between the wheels"),
    },
    vehicle=fc.DifferentialDrive,
    recognised=_RECOGNISED,
    probe=(1.0, -2.0, math.radians(30)),
    responses=(
        Response("tau_right", "theta", 1),
        Response("tau_left", "theta", -1),
        Response("tau_right", "v", 1),
    ),
    excitation=Excitation(size=(4.0, 1.0), commands=wheel_torques, turned=lambda states: states[:, 2]),
    on_path=OnPath(_course, _state, _motion, steering_length=lambda _: None),
    example=Example(
        plant="robot",
        leader={"tau_right": "1 N.m", "tau_left": "1 N.m"},
        length=0.5,
        parameter=("m_c", "40 kg"),
        limited="tau_right",
        limit="20 N.m",
    ),
    outline=_outline,
)
"""The differential-drive robot."""
