"""The symbolic model against the paper's equations."""

import numpy as np
import pytest
import sympy
from sympy import cos, sin, tan

import plants
from plants import numeric
from plants.tractor_trailer import model as tractor
from plants.tractor_trailer import reference

from .test_vehicles import is_zero

h = tractor.theta_01
PARAMETERS = ("m_0", "m_1", "I_0", "I_1", "r", "b", "a_0", "a_1", "d")
# What (57) abbreviates.
ABBREVIATIONS = {term.symbol: term.expression for term in tractor.SYSTEM.terms[:4]}


def test_coriolis_is_what_the_paper_prints() -> None:
    theta_1_dot = tractor.v * tan(tractor.hitch) / tractor.d
    a_0, m_0, d, L, omega = tractor.a_0, tractor.m_0, tractor.d, tractor.L, tractor.omega
    printed = sympy.Matrix(
        [
            -a_0 * m_0 * cos(tractor.theta_0) * omega**2 - L * cos(tractor.theta_1) * theta_1_dot**2,
            -a_0 * m_0 * sin(tractor.theta_0) * omega**2 - L * sin(tractor.theta_1) * theta_1_dot**2,
            -a_0 * d * m_0 * omega**2 * sin(tractor.hitch),
            a_0 * d * m_0 * theta_1_dot**2 * sin(tractor.hitch),
        ]
    )
    assert is_zero(tractor.SYSTEM, tractor.SYSTEM.C1 * tractor.SYSTEM.eta_dot - printed)


def test_inertia_is_that_of_two_rigid_bodies() -> None:
    """M1 of (57), its lost row included, gives the kinetic energy of tractor and trailer."""
    rates = sympy.Matrix(sympy.symbols("x_dot y_dot theta_1_dot theta_0_dot"))
    trailer = sympy.Matrix([tractor.x, tractor.y]) + tractor.a_1 * direction(tractor.theta_1)
    truck = sympy.Matrix([tractor.x, tractor.y])
    truck += tractor.d * direction(tractor.theta_1) + tractor.a_0 * direction(tractor.theta_0)
    energy = (tractor.I_1 * rates[2] ** 2 + tractor.I_0 * rates[3] ** 2) / 2
    for mass, centre in ((tractor.m_1, trailer), (tractor.m_0, truck)):
        velocity = centre.jacobian(tractor.SYSTEM.eta) * rates
        energy += mass * velocity.dot(velocity) / 2
    assert is_zero(tractor.SYSTEM, (rates.T * tractor.M1 * rates / 2).subs(ABBREVIATIONS) - sympy.Matrix([energy]))


def direction(angle: sympy.Expr) -> sympy.Matrix:
    return sympy.Matrix([cos(angle), sin(angle)])


def test_reduced_matrices() -> None:
    M2 = sympy.diag(tractor.M + tractor.I_theta1 * tan(h) ** 2 / tractor.d**2, tractor.I_theta0)
    assert tractor.SYSTEM.M2 == M2
    # Sums of positive terms: positive definite wherever tan(h) is finite.
    assert all(entry.is_positive for entry in M2.subs(tan(h), sympy.Symbol("t", real=True)).diagonal())
    B2 = sympy.Matrix([[1 / cos(h), 1 / cos(h)], [tractor.b, -tractor.b]]) / tractor.r
    assert is_zero(tractor.SYSTEM, tractor.SYSTEM.B2 - B2)


def test_inertia_is_positive_definite_with_the_printed_numbers() -> None:
    rng = np.random.default_rng(1)
    numbers = {p.symbol: p.start for p in tractor.SYSTEM.parameters}
    for name in ("M1", "M2"):
        matrix = getattr(tractor.SYSTEM, name).subs(ABBREVIATIONS).subs(h, tractor.hitch).subs(numbers)
        at = sympy.lambdify([tractor.theta_1, tractor.theta_0], matrix)
        for theta_1 in rng.uniform(-4, 4, 100):
            values = at(theta_1, theta_1 + rng.uniform(-1.5, 1.5))
            assert np.linalg.eigvalsh(values).min() > 0.01


def test_right_wheel_turns_the_tractor_left() -> None:
    model = numeric.compile(plants.load("tractor_trailer"))
    forward, turn = model.rhs(0.0, model.start(), model.inputs(tau_right=1.0), model.parameters())[4:]
    assert forward == pytest.approx(1 / (0.15 * 30))
    assert turn == pytest.approx(0.4 / 0.15 / (15 * 0.15**2 + 2))


def test_hitch_angle_is_an_output() -> None:
    model = numeric.compile(plants.load("tractor_trailer"))
    assert [output.name for output in model.model.outputs] == ["hitch"]
    assert model.outputs(0.0, [0, 0, 0.2, 0.5, 0, 0], model.inputs(), model.parameters()) == pytest.approx([0.3])


def test_reduction_agrees_with_the_constrained_dynamics() -> None:
    """The reduced model against (1) solved with its multipliers, at random states, inputs and parameters."""
    rng = np.random.default_rng(2)
    numpy_model = numeric.compile(plants.load("tractor_trailer"))
    for _ in range(200):
        x = rng.uniform([-9, -9, -4, -1.3, -2, -2], [9, 9, 4, 1.3, 2, 2])
        x[3] += x[2]
        u = rng.uniform(-50, 50, 6)
        values = rng.uniform([1, 1, 0.5, 0.5, 0.05, 0.1, -0.5, -0.5, 0.3], [80, 80, 20, 20, 1, 1, 0.5, 0.5, 3])
        stated = dict(zip(PARAMETERS, values, strict=True))
        damping = rng.uniform(0, 50, 4)
        p = numpy_model.parameters(**stated, **dict(zip(("d_m1", "d_m2", "d_m3", "d_m4"), damping, strict=True)))
        expected = reference.rhs(x, u, **stated, d_m=tuple(damping))
        np.testing.assert_allclose(numpy_model.rhs(0.0, x, u, p), expected, rtol=1e-9, atol=1e-9)
