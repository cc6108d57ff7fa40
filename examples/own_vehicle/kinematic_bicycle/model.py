"""The plant: a bicycle whose drive and steering follow their commands with a lag of first order.

The reference point is the midpoint of the rear axle. Neither wheel slips sideways, so that it turns at
omega = v tan(gamma)/a. The steering goes no further than gamma_max.
"""

from math import pi, radians

import sympy
from sympy import Max, Min, cos, sin, tan

from plants.ode import Input, Limit, OdeModel, Output, Parameter, State, Term, Terminal

x, y, psi, v, gamma = sympy.symbols("x y psi v gamma", real=True)
v_command, gamma_command = sympy.symbols("v_command gamma_command", real=True)
a, T_v, T_gamma, gamma_max = sympy.symbols("a T_v T_gamma gamma_max", positive=True)
turn, gamma_reached, omega = sympy.symbols("turn gamma_reached omega", real=True)


def model() -> OdeModel:
    """Return the bicycle as an ordinary differential equation with the states (x, y, psi, v, gamma)."""
    return OdeModel(
        name="kinematic_bicycle",
        description="Bicycle without slip, whose speed and steering angle follow their commands with a lag",
        states=(
            State(x, "m", "Position of the rear axle's midpoint, along the earth-fixed X axis"),
            State(y, "m", "Position of the rear axle's midpoint, along the earth-fixed Y axis"),
            State(psi, "rad", "Heading of the body, counter-clockwise from the X axis"),
            State(v, "m/s", "Forward velocity of the rear axle's midpoint"),
            State(gamma, "rad", "Steering angle of the front wheel, counter-clockwise from the body"),
        ),
        inputs=(
            Input(v_command, "m/s", "Commanded forward velocity"),
            Input(gamma_command, "rad", "Commanded steering angle", nominal=0.1),
        ),
        parameters=(
            Parameter(a, "m", "Wheelbase", start=1.2, min=1e-6),
            Parameter(T_v, "s", "Time constant of the drive", start=0.3, min=1e-3, nominal=0.1),
            Parameter(T_gamma, "s", "Time constant of the steering", start=0.1, min=1e-3, nominal=0.1),
            Parameter(gamma_max, "rad", "Largest steering angle, to either side", start=radians(35), min=1e-3, max=1.5),
        ),
        terms=(
            Term(turn, v * tan(gamma) / a, "rad/s"),
            Term(gamma_reached, Max(-gamma_max, Min(gamma_max, gamma_command)), "rad"),
        ),
        derivatives=(v * cos(psi), v * sin(psi), turn, (v_command - v) / T_v, (gamma_reached - gamma) / T_gamma),
        outputs=(Output(omega, turn, "rad/s", "Angular velocity, der(psi)"),),
        limits=(Limit(gamma, -pi / 2, pi / 2, "tan(gamma) is singular at 90 degrees"),),
        terminals=(
            Terminal("pose", (x, y, psi)),
            Terminal("velocity", (v, omega)),
            Terminal("command", (v_command, gamma_command)),
        ),
    )
