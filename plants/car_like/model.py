"""The car-like mobile robot of section 5.1: equation (56) with the motion basis of (2). See the README.md here."""

from math import pi

import sympy
from sympy import cos, sin, tan

from plants import car_like
from plants.effects import SMALLEST, end_stop, friction
from plants.nonholonomic import NonholonomicSystem, disturbances
from plants.ode import Enumeration, Input, Limit, OdeModel, Parameter, State

# Coordinates eta and pseudo-velocities v of (1) and (2).
x, y, psi, gamma, v, omega = sympy.symbols("x y psi gamma v omega", real=True)
# Inputs: torques tau of (1).
tau_drive, tau_steer = sympy.symbols("tau_drive tau_steer", real=True)
# Parameters of (56); l_c cancels in the reduction (3).
a, m_c, l_c, I_c, I_f = sympy.symbols("a m_c l_c I_c I_f", positive=True)
d = sympy.symbols("d_x d_y d_psi d_gamma", nonnegative=True)

drive = Enumeration(
    sympy.Symbol("drive", integer=True),
    {
        "as_printed": "third row of B1 as printed, a sin(psi): the drive gain depends on the absolute heading",
        "front_wheel": "force along the front wheels",
        "rear_wheel": "force along the body",
    },
    "How the drive torque acts: first column of B1 in (56)",
)

# (2): no side slip at the rear axle; the heading turns with tan(gamma)/a.
S = sympy.Matrix([[cos(psi), 0], [sin(psi), 0], [tan(gamma) / a, 0], [0, 1]])

# The same as constraints: neither axle slips sideways.
A = sympy.Matrix([[sin(psi), -cos(psi), 0, 0], [sin(psi + gamma), -cos(psi + gamma), -a * cos(gamma), 0]])
# (56)
M1 = sympy.Matrix(
    [
        [m_c, 0, -m_c * l_c * sin(psi), 0],
        [0, m_c, m_c * l_c * cos(psi), 0],
        [-m_c * l_c * sin(psi), m_c * l_c * cos(psi), I_c + I_f, I_f],
        [0, 0, I_f, I_f],
    ]
)
B1 = sympy.Matrix(
    [
        [drive.select(as_printed=cos(psi), front_wheel=cos(psi + gamma), rear_wheel=cos(psi)), 0],
        [drive.select(as_printed=sin(psi), front_wheel=sin(psi + gamma), rear_wheel=sin(psi)), 0],
        [drive.select(as_printed=a * sin(psi), front_wheel=a * sin(gamma), rear_wheel=0), 0],
        [0, 1],
    ]
)
D1 = sympy.diag(*d)

COORDINATES = (
    State(x, "m", "Position of the rear axle's midpoint, along the earth-fixed X axis"),
    State(y, "m", "Position of the rear axle's midpoint, along the earth-fixed Y axis"),
    State(psi, "rad", "Heading of the body, counter-clockwise from the X axis"),
    State(gamma, "rad", "Steering angle of the front wheels, counter-clockwise from the body"),
)
VELOCITIES = (
    State(v, "m/s", "Forward velocity of the rear axle's midpoint"),
    State(omega, "rad/s", "Steering rate, der(gamma)"),
)

FRICTION = tuple(map(friction, VELOCITIES))
STOP = end_stop("gamma", gamma, omega)
F2 = sympy.Matrix([f.resistance for f in FRICTION]) + sympy.Matrix([0, STOP.resistance])

SYSTEM = NonholonomicSystem(
    name="car_like",
    description=str(car_like.__doc__).rstrip("."),
    coordinates=COORDINATES,
    velocities=VELOCITIES,
    inputs=(
        Input(
            tau_drive, "N.m", "Drive torque; B1 of (56) takes it as a force, as at a wheel of radius 1 m", nominal=10.0
        ),
        Input(tau_steer, "N.m", "Steering torque", nominal=10.0),
    ),
    disturbances=disturbances(COORDINATES),
    parameters=(
        Parameter(a, "m", "Wheelbase", start=1.2, min=SMALLEST),
        Parameter(m_c, "kg", "Mass of the body", start=30.0, min=SMALLEST, nominal=10.0),
        Parameter(l_c, "m", "Distance from the rear axle's midpoint to the centre of mass", start=0.55),
        Parameter(I_c, "kg.m2", "Moment of inertia of the body", start=5.0, min=SMALLEST),
        Parameter(I_f, "kg.m2", "Moment of inertia of the front axle", start=10.0, min=SMALLEST, nominal=10.0),
        Parameter(d[0], "N.s/m", "Damping of motion along X", start=25.0, min=0.0, nominal=10.0),
        Parameter(d[1], "N.s/m", "Damping of motion along Y", start=25.0, min=0.0, nominal=10.0),
        Parameter(d[2], "N.m.s/rad", "Damping of the heading", start=25.0, min=0.0, nominal=10.0),
        Parameter(d[3], "N.m.s/rad", "Damping of the steering angle", start=25.0, min=0.0, nominal=10.0),
        drive,
        *(parameter for effect in (*FRICTION, STOP) for parameter in effect.parameters),
    ),
    terms=tuple(term for effect in (*FRICTION, STOP) for term in effect.terms),
    limits=(Limit(gamma, -pi / 2, pi / 2, "tan(gamma) is singular at 90 degrees"),),
    S=S,
    M1=M1,
    D1=D1,
    B1=B1,
    A=A,
    F2=F2,
)


def model() -> OdeModel:
    """Return the car-like robot as an ordinary differential equation with the states (x, y, psi, gamma, v, omega)."""
    return SYSTEM.ode()
