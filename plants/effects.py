"""Optional effects of real vehicles: friction, and an end stop. Off by default, and then of no effect on any bit.

Each is a resistance, a term of F2 in (3) (see `plants.nonholonomic`), made for one velocity or one angle together with
the parameters it needs. Their expressions are piecewise smooth, so that they can be differentiated and written in C.
"""

import math
from typing import NamedTuple

import sympy

from plants.errors import ModelError
from plants.ode import Parameter, State, Term

SMALLEST = 1e-6
"""Lower bound of a parameter that must be positive (a mass, a length, a velocity), in its unit."""

# Units of the force and of the damping that belong to a unit of velocity.
_FORCES = {"m/s": ("N", "N.s/m"), "rad/s": ("N.m", "N.m.s/rad")}


class Effect(NamedTuple):
    """A resistance (positive opposes motion), the named terms that define it, and its parameters."""

    resistance: sympy.Symbol
    terms: tuple[Term, ...]
    parameters: tuple[Parameter, ...]


def friction(velocity: State) -> Effect:
    """Return Coulomb and viscous friction on a velocity: F_c tanh(v/v_s) + F_v v.

    Parameters
    ----------
    velocity
        The pseudo-velocity v, in m/s or rad/s.

    Returns
    -------
    Effect
        Resistance ``friction_v`` in N or N.m, with the parameters ``F_c_v`` (Coulomb, 0), ``F_v_v`` (viscous, 0) and
        ``v_s`` (the velocity at which 76 % of F_c are reached, 0.01).

    Raises
    ------
    ModelError
        The velocity has another unit.
    """
    v, name = velocity.symbol, velocity.name
    if velocity.unit not in _FORCES:
        raise ModelError(f"friction on {name!r}: its unit is {velocity.unit!r}, it must be one of {', '.join(_FORCES)}")
    force, slope = _FORCES[velocity.unit]
    F_c, F_v = sympy.symbols(f"F_c_{name} F_v_{name}", nonnegative=True)
    v_s = sympy.Symbol(f"{name}_s", positive=True)
    resistance = sympy.Symbol(f"friction_{name}", real=True)
    # The branch spares the hyperbolic tangent where there is no friction.
    coulomb = sympy.Piecewise((F_c * sympy.tanh(v / v_s), F_c > 0), (0, True))
    return Effect(
        resistance,
        (Term(resistance, coulomb + F_v * v, force, "friction"),),
        (
            Parameter(F_c, force, f"Coulomb friction on {name}: 0 for none", min=0.0),
            Parameter(F_v, slope, f"Viscous friction on {name}: 0 for none", min=0.0),
            Parameter(v_s, velocity.unit, f"Coulomb friction on {name} grows as tanh({name}/{v_s})", 0.01, SMALLEST),
        ),
    )


def end_stop(name: str, angle: sympy.Expr, rate: sympy.Expr) -> Effect:
    """Return a stop on both sides of an angle, a one-sided spring with a damper that acts where the spring does.

    Beyond the largest angle by e, the torque is k e (1 + c e'), but never pulls (Hunt and Crossley, 1975): unlike with
    a linear damper, it is continuous at the contact.

    Parameters
    ----------
    name
        The name of the angle: ``gamma`` gives the parameter ``gamma_max``.
    angle, rate
        The angle [rad] and its time derivative [rad/s], in terms of the states.

    Returns
    -------
    Effect
        Resistance ``T_stop`` in N.m, about the angle, with the parameters ``gamma_max`` (60 degrees), ``k_stop`` (0)
        and ``c_stop`` (1 s/rad).
    """
    largest = sympy.Symbol(f"{name}_max", positive=True)
    k, c = sympy.symbols("k_stop c_stop", nonnegative=True)
    beyond, closing, torque = sympy.symbols("e_stop e_dot_stop T_stop", real=True)
    above, below = angle > largest, angle < -largest
    damped = sympy.Piecewise((1 + c * closing, c * closing > -1), (0, True))
    return Effect(
        torque,
        (
            Term(beyond, sympy.Piecewise((angle - largest, above), (angle + largest, below), (0, True)), "rad", "stop"),
            Term(closing, sympy.Piecewise((-rate, below), (rate, True)), "rad/s", "stop"),
            Term(torque, k * beyond * damped, "N.m", "stop"),
        ),
        (
            Parameter(largest, "rad", f"Largest {name} before the stop", math.radians(60), SMALLEST, math.pi / 2),
            Parameter(k, "N.m/rad", "Stiffness of the stop: 0 for none", min=0.0, nominal=1e4),
            Parameter(c, "s/rad", "Damping of the stop, relative to its spring", 1.0, 0.0),
        ),
    )
