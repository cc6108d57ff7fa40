"""The kind of vehicle, for the harness: it is found by the entry point ``formation.vehicles``."""

from __future__ import annotations

import math

from cosim.vehicle.kind import Example, ExampleLaw, Excitation, Kind, Response, Role
from cosim.vehicle.outline import Outline, Part, box
from cosim.vehicle.unicycle import unicycle_on_path
from kinematic_bicycle.vehicle import KinematicBicycle


def _outline(bicycle: KinematicBicycle) -> Outline:
    """Return the body, from wheel to wheel and as wide as a handlebar, and the wheels, which are only drawn.

    The pose does not tell the steering angle, so the front wheel is drawn straight.
    """
    a = bicycle.wheelbase
    wheel = box(-0.25 * a, 0.25 * a, 0.02 * a)
    return (
        Part("body", box(-0.25 * a, 1.25 * a, 0.25 * a), ("psi",)),
        Part("rear wheel", wheel, ("psi",), on="body", collides=False),
        Part("front wheel", wheel, ("psi",), on="body", at=(a, 0.0), collides=False),
    )


BICYCLE = Kind(
    name="kinematic_bicycle",
    title="kinematic bicycle",
    pose=(
        Role("x", "output", "m", meaning="the rear axle's midpoint along X"),
        Role("y", "output", "m", meaning="the rear axle's midpoint along Y, to the left of X"),
        Role("psi", "output", "rad", meaning="the heading, counter-clockwise from X"),
    ),
    velocity=(
        Role("v", "output", "m/s", optional=True, meaning="the forward velocity of the rear axle's midpoint"),
        Role("omega", "output", "rad/s", optional=True, meaning="the angular velocity, counter-clockwise"),
    ),
    command=(
        Role("v_command", "input", "m/s", meaning="the commanded forward velocity"),
        Role("gamma_command", "input", "rad", meaning="the commanded steering angle, counter-clockwise"),
    ),
    geometry={"wheelbase": Role("a", "parameter", "m", meaning="the wheelbase")},
    vehicle=KinematicBicycle,
    probe=(1.0, -2.0, math.radians(30)),
    responses=(Response("v_command", "v", 1),),
    # In a comparison, one course is the speed and the other the steering angle; the heading must not turn too far.
    excitation=Excitation((1.0, 0.3), commands=lambda courses: courses, turned=lambda states: states[:, 2]),
    on_path=unicycle_on_path(steering_length=lambda vehicle: vehicle.wheelbase),
    example=Example(
        plant="bicycle",
        source='fmu="fmus/kinematic_bicycle.fmu"',
        leader={"v_command": "1 m/s"},
        length=0.5,
        parameter=("T_v", "0.3 s"),
        law=ExampleLaw(
            id="follow",
            name="bicycle-follow",
            package="kinematic-bicycle",
            version="~=0.1.0",
            gains={"K": "0.8", "v_max": "3", "v_stop": "0.01"},
        ),
    ),
    outline=_outline,
)
