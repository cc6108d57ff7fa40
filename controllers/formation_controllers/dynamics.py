"""Reduced dynamics of the vehicles, M2 v_dot + C2 v + D2 v = B2 tau of (3), compiled: the belief of a model-based law.

With t = tan(steering angle), l the wheelbase a or the hitch length d, and t_dot the rate of t, (56) and (57)
reduce to::

    car-like          M2 = [ m + I_1 t^2/l^2   I_2 t/l ]    C2 = [ I_1 t t_dot/l^2   0 ]
                           [ I_2 t/l           I_2     ]         [ I_2 t_dot/l       0 ]

    tractor-trailer   M2 = [ m + I_1 t^2/l^2   0       ]    C2 = [ I_1 t t_dot/l^2              -S_0 omega/cos h ]
                           [ 0                 I_2     ]         [ S_0 omega/cos h               0               ]

    both              D2 = diag(d_x cos^2 + d_y sin^2 (heading) + d_1 t^2/l^2,  d_2)

A differential-drive robot of mass m, whose centre of mass is c ahead of the axle and whose inertia about it is I, is
the tractor alone: t = 0, with I_2 = I + m c^2 and S_0 = m c::

    differential      M2 = [ m   0   ]    C2 = [ 0          -S_0 omega ]    D2 = diag(d_x cos^2 + d_y sin^2,  d_2)
                           [ 0   I_2 ]         [ S_0 omega   0         ]

The parameters are in `ModelGains`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from formation_controllers.compiled import part
from formation_controllers.gains import Gains, gain
from formation_controllers.kinematics import BY_ANGLE, Direction, Geometry, Matrix, Steering


@dataclass(frozen=True, kw_only=True)
class ModelGains(Gains):
    """Parameters of the reduced dynamics; the defaults belong to the car-like robot in section 5.1."""

    m: float = gain(30.0, "m_c, M", "kg", "mass, (56), (57)", above=0)
    I_1: float = gain(
        15.0, "I_c + I_f, I_θ1", "kg.m2", "inertia of the turning body about its axle, (56), (57)", at_least=0
    )
    I_2: float = gain(10.0, "I_f, I_θ0", "kg.m2", "inertia of the part that turns with omega, (56), (57)", above=0)
    S_0: float = gain(0.0, "a_0 m_0", "kg.m", "first moment of the tractor's mass about its axle, (57)")
    d_x: float = gain(25.0, "d_m1", "N.s/m", "damping along x, (1)", at_least=0)
    d_y: float = gain(25.0, "d_m2", "N.s/m", "damping along y, (1)", at_least=0)
    d_1: float = gain(25.0, "d_m3", "N.m.s/rad", "damping of psi or theta_1, (1)", at_least=0)
    d_2: float = gain(25.0, "d_m4", "N.m.s/rad", "damping of gamma, theta_0 or theta, (1)", at_least=0)


TRACTOR_TRAILER_MODEL: Final[Mapping[str, float]] = MappingProxyType(
    {"m": 30.0, "I_1": 35.7875, "I_2": 2.3375, "S_0": 2.25}
)
"""`ModelGains` of the tractor-trailer in section 5.2: I_1 = m_1 a_1^2 + m_0 d^2 + I_1, I_2 = m_0 a_0^2 + I_0."""

DIFFERENTIAL_DRIVE_MODEL: Final[Mapping[str, float]] = MappingProxyType(
    {"m": 44.0, "I_1": 0.0, "I_2": 2.7, "S_0": 3.6, "d_2": 2.0}
)
"""`ModelGains` of a differential-drive robot: a body of 36 kg, its centre of mass 0.1 m ahead of the axle, and two
wheels of 2 kg, radius 0.1 m and half track 0.25 m; m and I_2 contain what the wheels' spin adds."""


@part
def inertia(h: Steering, vehicle: Geometry, model: np.void) -> Matrix:
    """M2 of (3)."""
    k = h.tan / vehicle.length
    coupling = model["I_2"] * k if vehicle.steering == BY_ANGLE else 0.0
    return Matrix(model["m"] + model["I_1"] * k * k, coupling, coupling, model["I_2"])


@part
def coriolis(h: Steering, v: float, omega: float, vehicle: Geometry, model: np.void) -> Matrix:
    """C2 of (3) at the pseudo-velocities (v, omega); linear in them."""
    length, t = vehicle.length, h.tan
    k = t / length
    if vehicle.steering == BY_ANGLE:
        k_dot = omega * (1.0 + t * t) / length
        return Matrix(model["I_1"] * k * k_dot, 0.0, model["I_2"] * k_dot, 0.0)
    k_dot = (omega - v * k) * (1.0 + t * t) / length
    swing = model["S_0"] * omega / h.cos
    return Matrix(model["I_1"] * k * k_dot, -swing, swing, 0.0)


@part
def damping(heading: Direction, h: Steering, vehicle: Geometry, model: np.void) -> tuple[float, float]:
    """D2 of (3): its diagonal. The heading is the pose's third entry."""
    s, c = heading
    k = h.tan / vehicle.length
    return model["d_x"] * c * c + model["d_y"] * s * s + model["d_1"] * k * k, model["d_2"]
