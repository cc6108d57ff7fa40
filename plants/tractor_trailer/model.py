"""The on-axle tractor-trailer of section 5.2: equation (57), motion basis of section 4. See the README.md here."""

from math import pi

import sympy
from sympy import cos, sin, tan

from plants import tractor_trailer
from plants.effects import SMALLEST, end_stop, friction
from plants.nonholonomic import NonholonomicSystem, disturbances
from plants.ode import Input, Limit, OdeModel, Output, Parameter, State, Term

# Coordinates eta and pseudo-velocities v of (1) and (2).
x, y, theta_1, theta_0, v, omega = sympy.symbols("x y theta_1 theta_0 v omega", real=True)
# Inputs: torques tau of (1).
tau_right, tau_left = sympy.symbols("tau_right tau_left", real=True)
# Parameters of (57).
m_0, m_1, I_0, I_1, r, b, d = sympy.symbols("m_0 m_1 I_0 I_1 r b d", positive=True)
a_0, a_1 = sympy.symbols("a_0 a_1", real=True)
d_m = sympy.symbols("d_m1:5", nonnegative=True)
# Their combinations that (57) names.
M, I_theta1, I_theta0 = sympy.symbols("M I_theta1 I_theta0", positive=True)
L = sympy.Symbol("L", real=True)

hitch = theta_0 - theta_1
theta_01 = sympy.Symbol("theta_01", real=True)

# (2), section 4: the trailer's wheels at (x, y) and the tractor's at the hitch do not slip sideways.
S = sympy.Matrix([[cos(theta_1), 0], [sin(theta_1), 0], [tan(hitch) / d, 0], [0, 1]])

# (57)
A = sympy.Matrix([[sin(theta_0), -cos(theta_0), -d * cos(hitch), 0], [sin(theta_1), -cos(theta_1), 0, 0]])
# (57); the last row of M1, lost in print, follows from symmetry.
M1 = sympy.Matrix(
    [
        [M, 0, -L * sin(theta_1), -a_0 * m_0 * sin(theta_0)],
        [0, M, L * cos(theta_1), a_0 * m_0 * cos(theta_0)],
        [-L * sin(theta_1), L * cos(theta_1), I_theta1, a_0 * d * m_0 * cos(hitch)],
        [-a_0 * m_0 * sin(theta_0), a_0 * m_0 * cos(theta_0), a_0 * d * m_0 * cos(hitch), I_theta0],
    ]
)
B1 = sympy.Matrix(
    [[cos(theta_0), cos(theta_0)], [sin(theta_0), sin(theta_0)], [d * sin(hitch), d * sin(hitch)], [b, -b]]
) / r  # fmt: skip
D1 = sympy.diag(*d_m)

COORDINATES = (
    State(x, "m", "Position of the trailer's axle midpoint, along the earth-fixed X axis"),
    State(y, "m", "Position of the trailer's axle midpoint, along the earth-fixed Y axis"),
    State(theta_1, "rad", "Heading of the trailer, counter-clockwise from the X axis"),
    State(theta_0, "rad", "Heading of the tractor, counter-clockwise from the X axis"),
)
VELOCITIES = (
    State(v, "m/s", "Forward velocity of the trailer's axle midpoint"),
    State(omega, "rad/s", "Angular velocity of the tractor, der(theta_0)"),
)

FRICTION = tuple(map(friction, VELOCITIES))
STOP = end_stop("hitch", theta_01, omega - tan(theta_01) / d * v)
# The stop turns tractor and trailer against each other.
F2 = sympy.Matrix([f.resistance for f in FRICTION]) + S.T * sympy.Matrix([0, 0, -STOP.resistance, STOP.resistance])

SYSTEM = NonholonomicSystem(
    name="tractor_trailer",
    description=str(tractor_trailer.__doc__).rstrip("."),
    coordinates=COORDINATES,
    velocities=VELOCITIES,
    inputs=(
        Input(tau_right, "N.m", "Torque of the tractor's right wheel, first column of B1 in (57)", nominal=10.0),
        Input(tau_left, "N.m", "Torque of the tractor's left wheel, second column of B1 in (57)", nominal=10.0),
    ),
    disturbances=disturbances(COORDINATES),
    parameters=(
        Parameter(m_0, "kg", "Mass of the tractor", start=15.0, min=SMALLEST, nominal=10.0),
        Parameter(m_1, "kg", "Mass of the trailer", start=15.0, min=SMALLEST, nominal=10.0),
        Parameter(I_0, "kg.m2", "Moment of inertia of the tractor", start=2.0, min=SMALLEST),
        Parameter(I_1, "kg.m2", "Moment of inertia of the trailer", start=2.0, min=SMALLEST),
        Parameter(r, "m", "Radius of the tractor's wheels", start=0.15, min=SMALLEST, nominal=0.1),
        Parameter(b, "m", "Half the distance between the tractor's wheels", start=0.4, min=SMALLEST),
        Parameter(a_0, "m", "Distance of the tractor's centre of mass ahead of its axle", start=0.15, nominal=0.1),
        Parameter(a_1, "m", "Distance of the trailer's centre of mass ahead of its axle", start=0.05, nominal=0.1),
        Parameter(d, "m", "Distance from the trailer's axle to the hitch", start=1.5, min=SMALLEST),
        Parameter(d_m[0], "N.s/m", "Damping of motion along X", start=25.0, min=0.0, nominal=10.0),
        Parameter(d_m[1], "N.s/m", "Damping of motion along Y", start=25.0, min=0.0, nominal=10.0),
        Parameter(d_m[2], "N.m.s/rad", "Damping of the trailer's heading", start=25.0, min=0.0, nominal=10.0),
        Parameter(d_m[3], "N.m.s/rad", "Damping of the tractor's heading", start=25.0, min=0.0, nominal=10.0),
        *(parameter for effect in (*FRICTION, STOP) for parameter in effect.parameters),
    ),
    terms=(
        Term(M, m_0 + m_1, "kg", "(57)"),
        Term(L, a_1 * m_1 + d * m_0, "kg.m", "(57)"),
        Term(I_theta1, m_1 * a_1**2 + m_0 * d**2 + I_1, "kg.m2", "(57)"),
        Term(I_theta0, m_0 * a_0**2 + I_0, "kg.m2", "(57)"),
        *(term for effect in (*FRICTION, STOP) for term in effect.terms),
    ),
    angles=(Term(theta_01, hitch, "rad"),),
    outputs=(Output(sympy.Symbol("hitch", real=True), hitch, "rad", "Hitch angle, from the trailer to the tractor"),),
    limits=(Limit(hitch, -pi / 2, pi / 2, "tan(theta_0 - theta_1) is singular at 90 degrees", "rad"),),
    S=S,
    M1=M1,
    D1=D1,
    B1=B1,
    A=A,
    F2=F2,
)


def model() -> OdeModel:
    """Return the tractor-trailer as an ordinary differential equation, states (x, y, theta_1, theta_0, v, omega)."""
    return SYSTEM.ode()
