"""The differential-drive robot: midpoint of the axle and heading; the torques of a right and a left wheel."""

from __future__ import annotations

import math

import formation_controllers as fc

from cosim.vehicle.evidence import Evidence
from cosim.vehicle.kind import Example, Excitation, Kind, Recognised, Response, Role, disturbances
from cosim.vehicle.outline import Outline, Part, wheels
from cosim.vehicle.unicycle import unicycle_on_path
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
        **wheels_known_by(),
    },
    order=SIDES,
    conventions={"x": X_AXIS, "y": Y_AXIS, "theta": COMPASS, "v": FORWARD, "omega": TURNING},
    refusal=_refusal,
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
    on_path=unicycle_on_path(),
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
