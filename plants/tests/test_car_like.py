"""The symbolic model against the paper's equations."""

import numpy as np
import pytest
import sympy
from sympy import cos, sin, tan

import plants
from plants import numeric
from plants.car_like import model as car
from plants.car_like import reference

DRIVES = ("as_printed", "front_wheel", "rear_wheel")


def is_zero(expression: sympy.Expr | sympy.Matrix) -> bool:
    return sympy.simplify(expression) == 0 * expression


def test_coriolis_is_what_the_paper_prints() -> None:
    psi_dot = car.v * tan(car.gamma) / car.a
    arm = car.m_c * car.l_c
    printed = sympy.Matrix([-arm * psi_dot**2 * cos(car.psi), -arm * psi_dot**2 * sin(car.psi), 0, 0])
    assert is_zero(car.SYSTEM.C1 * car.SYSTEM.eta_dot - printed)


def test_reduced_inertia() -> None:
    t = tan(car.gamma) / car.a
    expected = sympy.Matrix([[car.m_c + (car.I_c + car.I_f) * t**2, car.I_f * t], [car.I_f * t, car.I_f]])
    assert is_zero(car.SYSTEM.M2 - expected)
    assert car.SYSTEM.M2.is_symmetric()
    # Leading minors, sums of positive terms: positive definite wherever tan(gamma) is finite.
    assert is_zero(car.SYSTEM.M2.det() - car.I_f * (car.m_c + car.I_c * t**2))


@pytest.mark.parametrize(
    ("drive", "gain"),
    [
        ("as_printed", 1 + tan(car.gamma) * sin(car.psi)),
        ("front_wheel", 1 / cos(car.gamma)),
        ("rear_wheel", sympy.S.One),
    ],
)
def test_drive_gain(drive: str, gain: sympy.Expr) -> None:
    B2 = car.SYSTEM.B2.subs(car.drive.symbol, car.drive.number(drive))
    assert is_zero(B2 - sympy.Matrix([[gain, 0], [0, 1]]))


def test_position_of_the_centre_of_mass_cancels() -> None:
    model = plants.load("car_like")
    assert car.l_c in car.M1.free_symbols
    assert "l_c" not in [parameter.name for parameter in model.parameters]


@pytest.mark.parametrize("drive", DRIVES)
def test_reduction_agrees_with_the_constrained_dynamics(drive: str) -> None:
    """The reduced model against (1) solved with its multipliers, at random states, inputs and parameters."""
    rng = np.random.default_rng(1)
    numpy_model = numeric.compile(plants.load("car_like"))
    for _ in range(200):
        x = rng.uniform([-9, -9, -4, -1.3, -2, -2], [9, 9, 4, 1.3, 2, 2])
        u = rng.uniform(-50, 50, 6)
        masses = dict(zip(("a", "m_c", "I_c", "I_f"), rng.uniform([0.3, 1, 0.5, 0.5], [3, 80, 20, 20]), strict=True))
        damping = rng.uniform(0, 50, 4)
        p = numpy_model.parameters(
            drive=drive, **masses, **dict(zip(("d_x", "d_y", "d_psi", "d_gamma"), damping, strict=True))
        )
        expected = reference.rhs(x, u, **masses, d=tuple(damping), l_c=rng.uniform(0, 0.1), drive=drive)
        np.testing.assert_allclose(numpy_model.rhs(0.0, x, u, p), expected, rtol=1e-9, atol=1e-9)
