"""The symbolic model against two rigid wheels on a body, and the motion of such a robot."""

from dataclasses import replace

import numpy as np
import pytest
import sympy
from sympy import cos, sin

import plants
from plants import numeric
from plants.differential_drive import model as robot
from plants.differential_drive import reference
from plants.nonholonomic import disturbances

from .test_vehicles import NUMPY, is_zero

PARAMETERS = ("m_c", "m_w", "I_c", "I_w", "I_m", "c", "r", "b")
ABBREVIATIONS = {term.symbol: term.expression for term in reversed(robot.SYSTEM.terms[:4])}


def in_parameters(matrix: sympy.Matrix) -> sympy.Matrix:
    return matrix.subs(ABBREVIATIONS)


def test_inertia_is_that_of_a_body_and_two_rolling_wheels() -> None:
    """M1 gives their kinetic energy, where the axle does not slip sideways and the wheels roll."""
    x_dot, y_dot, theta_dot = rates = sympy.Matrix(sympy.symbols("x_dot y_dot theta_dot"))
    ahead, left = (
        sympy.Matrix([cos(robot.theta), sin(robot.theta)]),
        sympy.Matrix([-sin(robot.theta), cos(robot.theta)]),
    )
    axle = sympy.Matrix([x_dot, y_dot])
    body = axle + robot.c * theta_dot * left
    energy = robot.m_c * body.dot(body) / 2 + robot.I_c * theta_dot**2 / 2
    for side in (1, -1):  # right, left
        hub = axle + side * robot.b * theta_dot * ahead
        spin = hub.dot(ahead) / robot.r
        energy += (robot.m_w * hub.dot(hub) + robot.I_m * theta_dot**2 + robot.I_w * spin**2) / 2
    stated = (rates.T * in_parameters(robot.M1) * rates / 2)[0]
    assert is_zero(robot.SYSTEM, sympy.Matrix([stated - energy]))


def test_reduced_matrices() -> None:
    system, omega = robot.SYSTEM, robot.omega
    assert sympy.diag(robot.M + robot.m_spin, robot.I_theta) == system.M2
    assert all(entry.is_positive for entry in system.M2.diagonal())
    assert robot.L * omega * sympy.Matrix([[0, -1], [1, 0]]) == system.C2
    assert is_zero(system, system.B2 - sympy.Matrix([[1, 1], [robot.b, -robot.b]]) / robot.r)


def test_inertia_is_positive_definite() -> None:
    matrix = in_parameters(robot.M1).subs({p.symbol: p.start for p in robot.SYSTEM.parameters})
    at = sympy.lambdify([robot.theta], matrix)
    for theta in np.random.default_rng(1).uniform(-4, 4, 100):
        assert np.linalg.eigvalsh(at(theta)).min() > 0.1


def test_reduction_agrees_with_the_constrained_dynamics() -> None:
    """The reduced model against (1) with the wheels' angles and three multipliers, at random points."""
    rng, functions = np.random.default_rng(2), NUMPY["differential_drive"]
    for _ in range(200):
        x = rng.uniform([-9, -9, -4, -2, -2], [9, 9, 4, 2, 2])
        u = rng.uniform(-50, 50, 5)
        values = rng.uniform([1, 0.1, 0.5, 0, 0, -0.5, 0.05, 0.1], [80, 20, 20, 1, 1, 0.5, 1, 1])
        stated = dict(zip(PARAMETERS, values, strict=True))
        damping = rng.uniform(0, 50, 3)
        p = functions.parameters(**stated, **dict(zip(("d_x", "d_y", "d_theta"), damping, strict=True)))
        expected = reference.rhs(x, u, **stated, d=tuple(damping))
        np.testing.assert_allclose(functions.rhs(0.0, x, u, p), expected, rtol=1e-9, atol=1e-9)


def test_right_wheel_turns_the_robot_left() -> None:
    functions = NUMPY["differential_drive"]
    forward, turn = functions.rhs(0.0, functions.start(), functions.inputs(tau_right=1.0), functions.parameters())[3:]
    assert forward == pytest.approx(1 / 0.1 / (36 + 2 * 2 + 2 * 0.02 / 0.1**2))
    assert turn == pytest.approx(0.25 / 0.1 / (1.83 + 36 * 0.1**2 + 2 * 0.005 + 2 * 0.25**2 * (2 + 0.02 / 0.1**2)))


@pytest.mark.parametrize("c", [0.1, -0.1])
def test_a_free_robot_ends_with_its_centre_of_mass_in_front(c: float) -> None:
    """Without damping: forward motion is stable with the centre of mass ahead of the axle, else the ends swap."""
    functions = NUMPY["differential_drive"]
    p = functions.parameters(c=c, d_x=0, d_y=0, d_theta=0)
    x = functions.start(v=1.0, omega=0.01)
    start = energy(functions, x, p)
    for k in range(3000):
        x = functions.rk4(k * 0.01, x, functions.inputs(), p, 0.01)
    v, omega = x[3:]
    assert energy(functions, x, p) == pytest.approx(start, rel=1e-9)
    assert omega == pytest.approx(0.0, abs=1e-3)
    assert v == pytest.approx(np.sign(c), rel=1e-3)


def energy(functions: numeric.NumericModel, x: np.ndarray, p: np.ndarray) -> float:
    values = dict(zip((parameter.symbol for parameter in functions.model.parameters), p, strict=True))
    M2 = in_parameters(robot.SYSTEM.M2).subs(values)
    v = sympy.Matrix(x[3:])
    return float((v.T * M2 * v)[0] / 2)


def test_disturbances_follow_from_the_coordinates() -> None:
    assert [d.name for d in disturbances(robot.COORDINATES)] == ["tau_d_x", "tau_d_y", "tau_d_theta"]
    with pytest.raises(plants.ModelError, match="disturbance on 'x': its unit is 'km', it must be one of m, rad"):
        disturbances([replace(robot.COORDINATES[0], unit="km")])
