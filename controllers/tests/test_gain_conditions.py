"""The conditions (39) to (42) of Theorem 1, and Remark 2."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from formation_controllers import ControllerError, GainError
from formation_controllers.gain_conditions import Bounds, check_gains, propose_gains
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePidGains
from formation_controllers.observer_pid import ObserverPidGains
from hypothesis import assume, given
from hypothesis import strategies as st

PRINTED = NeuralAdaptivePidGains()
BOUNDS = Bounds(c_1=1, c_2=2, c_3=1, c_4=3, c_5=1, lambda_m=5, lambda_d=4)
grid = np.geomspace(1e-4, 1e4, 20001)


def literal(gains, bounds, alpha, beta, l):  # noqa: E741
    """Left less right side of (39) to (42) as printed, for arrays of l."""
    K_p = np.diag(gains.K_p)
    low, high = np.linalg.eigvalsh(K_p)[[0, -1]]
    D, M = bounds.lambda_d * np.eye(2), bounds.lambda_m * np.eye(2)
    return np.array(
        [
            alpha * low - (0.5 * high / l + 0.5 * beta * high / l),
            beta * low - (0.5 * high / l + 0.5 * beta * l * high),
            np.linalg.eigvalsh(K_p + D)[0] - (l * high + 0.5 * l * (bounds.c_1 + bounds.c_2)),
            np.linalg.eigvalsh(gains.k_d * M - K_p)[0] - (l * high + 0.5 * l * (bounds.c_4 + bounds.c_5)),
        ]
    )


def roots(gains):
    return np.roots([1, -gains.Lambda_0[0], gains.Lambda_1[0]])


def test_printed_gains_satisfy_39_and_40_for_no_constant():
    """Over a grid of l and both orders of alpha and beta, and by the closed form."""
    for alpha, beta in (roots(PRINTED), roots(PRINTED)[::-1]):
        assert (literal(PRINTED, BOUNDS, alpha, beta, grid)[:2].min(axis=0) < 0).all()
    report = check_gains(PRINTED, BOUNDS)
    assert not report.satisfied
    assert max(report["(39)"].l_above, report["(40)"].l_above) >= min(report["(39)"].l_below, report["(40)"].l_below)


def test_39_and_40_need_a_lambda_1_above_about_0_88_whatever_lambda_0():
    """The least Lambda_1 over all alpha and beta, by the closed form; and that it is enough."""
    betas = np.linspace(1.0001, 3, 20000)
    alphas = (1 + betas) / (2 * (1 + np.sqrt(1 - 1 / betas)))
    products = alphas * betas
    best = products.argmin()
    assert products[best] == pytest.approx(0.8817, abs=1e-4)
    assert betas[best] == pytest.approx(1.066, abs=5e-3)
    loose = Bounds(0, 0, 0, 0, 0, lambda_m=1e6, lambda_d=1e6)
    for factor, holds in ((1.001, True), (0.999, False)):
        alpha, beta = factor * alphas[best], betas[best]
        gains = replace(PRINTED, Lambda_0=alpha + beta, Lambda_1=alpha * beta)
        assert check_gains(gains, loose).satisfied is holds


positive = st.floats(0.05, 50)


@given(
    K_p=st.tuples(positive, positive),
    Lambda_0=positive,
    share=st.floats(0.01, 1.2),
    k_d=positive,
    c=st.tuples(*[st.floats(0, 20)] * 4),
    eigenvalues=st.tuples(positive, positive),
)
def test_a_report_is_what_the_conditions_say(K_p, Lambda_0, share, k_d, c, eigenvalues):
    """Sides, margins and intervals against (39) to (42) as printed; and no l of a grid does better."""
    gains = ObserverPidGains(K_p=K_p, Lambda_0=Lambda_0, Lambda_1=share * Lambda_0**2 / 4, k_d=k_d)
    bounds = Bounds(c[0], c[1], 0, c[2], c[3], *eigenvalues)
    report = check_gains(gains, bounds)
    if share > 1:
        assert math.isnan(report.alpha)
        assert not report.satisfied
        return
    assert report.alpha + report.beta == pytest.approx(Lambda_0)
    assert report.alpha * report.beta == pytest.approx(gains.Lambda_1[0])
    expected = literal(gains, bounds, report.alpha, report.beta, np.array([report.l]))[:, 0]
    scale = max(abs(c.left) + abs(c.right) for c in report.conditions)
    np.testing.assert_allclose([c.margin for c in report.conditions], expected, atol=1e-9 * scale)
    on_grid = literal(gains, bounds, report.alpha, report.beta, grid)
    assert on_grid.min(axis=0).max() <= expected.min() + 1e-9 * scale
    for condition, margins in zip(report.conditions, on_grid, strict=True):
        inside = (grid > condition.l_above * (1 + 1e-9)) & (grid < condition.l_below * (1 - 1e-9))
        outside = (grid < condition.l_above * (1 - 1e-9)) | (grid > condition.l_below * (1 + 1e-9))
        assert (margins[inside] > -1e-9 * scale).all()
        assert (margins[outside] < 1e-9 * scale).all()
    both = [literal(gains, bounds, *pair, grid) for pair in (roots(gains), roots(gains)[::-1])]
    if any((margins[:2].min(axis=0) > 1e-9 * scale).any() for margins in both):
        first, second = report["(39)"], report["(40)"]
        assert max(first.l_above, second.l_above) < min(first.l_below, second.l_below)


@given(
    c=st.tuples(*[st.floats(0, 50)] * 5),
    eigenvalues=st.tuples(st.floats(0.01, 50), st.floats(0, 50)),
    constant=st.floats(0.05, 0.95),
    K_p=st.tuples(positive, positive),
)
def test_proposed_gains_satisfy_all_conditions(c, eigenvalues, constant, K_p):
    bounds = Bounds(*c, *eigenvalues)
    proposed = propose_gains(replace(PRINTED, K_p=K_p), bounds, l=constant)
    report = check_gains(proposed, bounds, [0.7, -0.7])
    assert report.satisfied
    assert all(condition.margin > 0 for condition in report.conditions)
    assert (literal(proposed, bounds, report.alpha, report.beta, np.array([report.l])) > 0).all()
    assert proposed.K_p[0] == proposed.K_p[1] >= max(K_p)
    assert (proposed.W_m, proposed.theta_m) == (PRINTED.W_m, PRINTED.theta_m)


@given(bearing=st.floats(-2, 2))
def test_remark_2_asks_for_bearings_below_90_degrees(bearing):
    assume(abs(abs(bearing) - math.pi / 2) > 1e-9)
    condition = check_gains(PRINTED, BOUNDS, [0.1, bearing])["Remark 2"]
    assert condition.satisfied == (abs(bearing) < math.pi / 2)
    assert condition.margin == pytest.approx(math.pi / 2 - max(0.1, abs(bearing)))


def test_a_report_reads_as_a_table():
    text = str(check_gains(PRINTED, BOUNDS, 0.7))
    assert text.splitlines()[0].startswith("alpha = ")
    assert "(40)" in text
    assert "for no l" in text
    assert "Remark 2" in text
    assert "FAILS by" in text
    assert "holds by" in text


def test_a_report_without_real_roots_says_so():
    """Lambda_0 = 2 and Lambda_1 = 3: a discriminant of 4 - 12."""
    text = str(check_gains(replace(PRINTED, Lambda_0=2, Lambda_1=3), BOUNDS))
    assert text.splitlines()[0].startswith("no real alpha and beta exist: Lambda_0^2 - 4 Lambda_1 = -8")
    assert "(39)     FAILS: it needs real alpha and beta" in text
    assert "nan" not in text


@pytest.mark.parametrize("bearing", [math.nan, [], [0.1, math.inf], "left"])
def test_a_desired_bearing_that_is_no_number_is_refused(bearing):
    with pytest.raises(ControllerError, match=r"the desired bearing is .*: expected one or more finite numbers"):
        check_gains(PRINTED, BOUNDS, bearing)


def test_what_the_theorem_does_not_cover_is_refused():
    with pytest.raises(GainError, match="must be the same for range and bearing"):
        check_gains(replace(PRINTED, Lambda_0=(1, 2)), BOUNDS)
    with pytest.raises(ControllerError, match="the bound c_2 is -1"):
        replace(BOUNDS, c_2=-1)
    with pytest.raises(ControllerError, match="the bound lambda_m is 0"):
        replace(BOUNDS, lambda_m=0)
    with pytest.raises(ControllerError, match="the constant l is 1"):
        propose_gains(PRINTED, BOUNDS, l=1)
    with pytest.raises(ControllerError, match="the margin is 0"):
        propose_gains(PRINTED, BOUNDS, margin=0)
