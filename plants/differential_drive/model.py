"""The differential-drive robot, stated as the paper states its vehicles, by (1) and (2). See the README.md here."""

import sympy
from sympy import cos, sin

from plants import differential_drive
from plants.effects import SMALLEST, friction
from plants.nonholonomic import NonholonomicSystem, disturbances
from plants.ode import Input, OdeModel, Parameter, State, Term

# Coordinates eta and pseudo-velocities v of (1) and (2).
x, y, theta, v, omega = sympy.symbols("x y theta v omega", real=True)
# Inputs: torques tau of (1).
tau_right, tau_left = sympy.symbols("tau_right tau_left", real=True)
# Parameters.
m_c, m_w, I_c, r, b = sympy.symbols("m_c m_w I_c r b", positive=True)
I_w, I_m = sympy.symbols("I_w I_m", nonnegative=True)
c = sympy.Symbol("c", real=True)
d = sympy.symbols("d_x d_y d_theta", nonnegative=True)
# Their combinations that M1 names.
M, m_spin, I_theta = sympy.symbols("M m_spin I_theta", positive=True)
L = sympy.Symbol("L", real=True)

# (2): the axle does not slip sideways.
S = sympy.Matrix([[cos(theta), 0], [sin(theta), 0], [0, 1]])

# The same as a constraint.
A = sympy.Matrix([[sin(theta), -cos(theta), 0]])
# Kinetic energy of the body, of the wheels as masses on the axle, and of their spin, whose rates follow from rolling.
M1 = sympy.Matrix(
    [
        [M + m_spin * cos(theta) ** 2, m_spin * sin(theta) * cos(theta), -L * sin(theta)],
        [m_spin * sin(theta) * cos(theta), M + m_spin * sin(theta) ** 2, L * cos(theta)],
        [-L * sin(theta), L * cos(theta), I_theta],
    ]
)
B1 = sympy.Matrix([[cos(theta), cos(theta)], [sin(theta), sin(theta)], [b, -b]]) / r
D1 = sympy.diag(*d)

COORDINATES = (
    State(x, "m", "Position of the axle's midpoint, along the earth-fixed X axis"),
    State(y, "m", "Position of the axle's midpoint, along the earth-fixed Y axis"),
    State(theta, "rad", "Heading, counter-clockwise from the X axis"),
)
VELOCITIES = (
    State(v, "m/s", "Forward velocity of the axle's midpoint"),
    State(omega, "rad/s", "Angular velocity, der(theta)"),
)

FRICTION = tuple(map(friction, VELOCITIES))

SYSTEM = NonholonomicSystem(
    name="differential_drive",
    description=str(differential_drive.__doc__).rstrip("."),
    coordinates=COORDINATES,
    velocities=VELOCITIES,
    inputs=(
        Input(tau_right, "N.m", "Torque of the right wheel: forward"),
        Input(tau_left, "N.m", "Torque of the left wheel: forward"),
    ),
    disturbances=disturbances(COORDINATES),
    parameters=(
        Parameter(m_c, "kg", "Mass of the body, without the driven wheels", start=36.0, min=SMALLEST, nominal=10.0),
        Parameter(m_w, "kg", "Mass of a driven wheel with its motor", start=2.0, min=SMALLEST),
        Parameter(I_c, "kg.m2", "Moment of inertia of the body about its centre of mass", start=1.83, min=SMALLEST),
        Parameter(
            I_w, "kg.m2", "Moment of inertia of a wheel and its motor about the axle", start=0.02, min=0.0, nominal=0.01
        ),
        Parameter(
            I_m,
            "kg.m2",
            "Moment of inertia of a wheel and its motor about the vertical",
            start=0.005,
            min=0.0,
            nominal=0.01,
        ),
        Parameter(c, "m", "Distance of the body's centre of mass ahead of the axle", start=0.1, nominal=0.1),
        Parameter(r, "m", "Radius of the wheels", start=0.1, min=SMALLEST, nominal=0.1),
        Parameter(b, "m", "Half the distance between the wheels", start=0.25, min=SMALLEST, nominal=0.1),
        Parameter(d[0], "N.s/m", "Damping of motion along X", start=25.0, min=0.0, nominal=10.0),
        Parameter(d[1], "N.s/m", "Damping of motion along Y", start=25.0, min=0.0, nominal=10.0),
        Parameter(d[2], "N.m.s/rad", "Damping of the heading", start=2.0, min=0.0),
        *(parameter for effect in FRICTION for parameter in effect.parameters),
    ),
    terms=(
        Term(M, m_c + 2 * m_w, "kg"),
        Term(m_spin, 2 * I_w / r**2, "kg"),
        Term(L, c * m_c, "kg.m"),
        Term(I_theta, I_c + c**2 * m_c + 2 * I_m + b**2 * (2 * m_w + m_spin), "kg.m2"),
        *(term for effect in FRICTION for term in effect.terms),
    ),
    S=S,
    M1=M1,
    D1=D1,
    B1=B1,
    A=A,
    F2=sympy.Matrix([f.resistance for f in FRICTION]),
)


def model() -> OdeModel:
    """Return the differential-drive robot as an ordinary differential equation, states (x, y, theta, v, omega)."""
    return SYSTEM.ode()
