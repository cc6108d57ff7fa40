"""The conditions (39) to (42) of Theorem 1, its region of attraction, and Remark 2."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from formation_controllers import ControllerError, GainError
from formation_controllers.analysis.gain_conditions import Bounds, check_gains, propose_gains
from formation_controllers.analysis.region_of_attraction import region_of_attraction
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePidGains
from formation_controllers.neural_high_gain import NeuralHighGainGains
from formation_controllers.observer_pid import ObserverPidGains
from hypothesis import assume, example, given, settings
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


def test_the_order_of_alpha_and_beta_is_the_one_that_41_and_42_allow():
    """With alpha < beta, (39) and (40) have more room for l, but above what (41) allows."""
    gains = replace(PRINTED, Lambda_0=2.32, Lambda_1=1.326, K_p=10, k_d=1e4)
    bounds = Bounds(0, 0, 0, 0, 0, lambda_m=5, lambda_d=0.5)
    report = check_gains(gains, bounds)
    assert report.satisfied
    assert (report.alpha, report.beta) == pytest.approx((1.3, 1.02))
    assert report.l == pytest.approx(0.99, abs=1e-3)
    assert min(c.margin for c in report.conditions) == pytest.approx(0.1005, abs=1e-4)
    assert literal(gains, bounds, 1.02, 1.3, grid).min(axis=0).max() == pytest.approx(-0.375, abs=1e-3)


def test_no_order_and_no_l_of_a_search_by_brute_force_does_better():
    """Of gains and bounds at random, some of which satisfy all conditions in one order alone, and either one does."""
    random = np.random.default_rng(3)
    fine = np.geomspace(1e-2, 1e2, 4001)
    verdicts = set()
    for _ in range(300):
        alpha, beta, K_p = *random.uniform(0.8, 3, 2), random.uniform(5, 20)
        gains = replace(PRINTED, Lambda_0=alpha + beta, Lambda_1=alpha * beta, K_p=K_p, k_d=random.uniform(2, 20))
        bounds = Bounds(*random.uniform(0, 3, 5), random.uniform(0.1, 5), random.uniform(0, 8))
        found = [literal(gains, bounds, *pair, fine).min(axis=0).max() for pair in ((alpha, beta), (beta, alpha))]
        report = check_gains(gains, bounds)
        least = min(c.margin for c in report.conditions)
        assert max(found) <= least + 1e-9 * K_p
        assert max(found) == pytest.approx(least, abs=0.01 * K_p * max(alpha, beta))
        if abs(least) > 0.01 * K_p * max(alpha, beta):
            assert report.satisfied == (max(found) > 0)
        verdicts.add((report.satisfied, min(found) > 0, report.alpha > report.beta))
    assert verdicts >= {(True, both, larger) for both in (False, True) for larger in (False, True)}
    assert (False, False, True) in verdicts


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


@pytest.mark.parametrize("name", ["c_1", "lambda_m", "lambda_d"])
@pytest.mark.parametrize("value", [None, "a", True, 1j, [1.0], math.nan, math.inf, -1])
def test_a_bound_that_is_no_number_of_at_least_zero_is_refused(name, value):
    with pytest.raises(ControllerError, match=rf"the bound {name} is .*: it must be a number, at least zero"):
        replace(BOUNDS, **{name: value})


def test_gains_of_another_law_and_bounds_that_are_none_are_refused():
    other = "the gains are NeuralHighGainGains: the theorem is about"
    for function in (check_gains, propose_gains, region_of_attraction):
        with pytest.raises(GainError, match=other):
            function(NeuralHighGainGains(), SMALL)
        with pytest.raises(ControllerError, match="the bounds are None: expected Bounds"):
            function(PRINTED, None)
    with pytest.raises(GainError, match="the gains are ObserverPidGains: the theorem is about NeuralAdaptivePidGains"):
        region_of_attraction(ObserverPidGains(), SMALL)


# Region of attraction ----------------------------------------------------------------------------------------

SMALL = Bounds(c_1=0.1, c_2=0.2, c_3=17, c_4=0.3, c_5=0.4, lambda_m=5, lambda_d=4, lambda_M=20)
# alpha = 8 and beta = 2, of which (39), (40) hold for l in (0.29, 1.71), and c_3 >= 2 sqrt(1 + 64 + 4) = 16.61
SATISFYING = replace(PRINTED, Lambda_0=10, Lambda_1=16, K_p=200, k_d=600, gamma_w=10, gamma_theta=0.5)


def test_the_radius_at_numbers_computed_by_hand():
    """With l = 0.5 the margins of (39) to (42) are 1000, 100, 103.925 and 2699.825."""
    region = region_of_attraction(SATISFYING, SMALL, l=0.5)
    margins = literal(SATISFYING, SMALL, 8, 2, np.array([0.5]))[:, 0]
    assert margins == pytest.approx(np.array([1000, 100, 103.925, 2699.825]))
    assert region.kappa_m == pytest.approx(100)
    assert region.kappa_7 == pytest.approx(25.9)  # (0.1/0.5 + 0.3/0.5 + 3 * 17)/2
    assert region.kappa_8 == pytest.approx(0.6)  # (0.2 + 0.4)/(2 * 0.5)
    assert region.lambda_x == 2.5
    assert region.lambda_vartheta == 100
    assert region.radius == pytest.approx(math.sqrt(2.5 * 74.1 / (0.6 * 100)))
    assert region.l == 0.5


positive_bounds = st.builds(
    lambda c, c_3, m, d, more: Bounds(c[0], c[1], c_3, c[2], c[3], lambda_m=m, lambda_d=d, lambda_M=m * more),
    c=st.tuples(*[st.floats(0.001, 0.2)] * 4),
    c_3=st.floats(17, 20),
    m=st.floats(1, 20),
    d=st.floats(0, 10),
    more=st.floats(1, 5),
)


@given(bounds=positive_bounds)
def test_no_constant_l_of_a_grid_has_a_larger_radius(bounds):
    """And kappa_m and the radius against (39) to (42), (44) and (52) as printed, over the grid."""
    region, report = region_of_attraction(SATISFYING, bounds), check_gains(SATISFYING, bounds)
    c = bounds
    kappa_m = literal(SATISFYING, bounds, report.alpha, report.beta, grid).min(axis=0)
    kappa_7 = 0.5 * (c.c_1 / grid + c.c_4 / grid + 3 * c.c_3)
    kappa_8 = 0.5 * (c.c_2 / grid + c.c_5 / grid)
    lambda_x = 0.5 * min(200, c.lambda_m)
    lambda_vartheta = 0.5 * max(200, c.lambda_M, 1 / 10, 1 / 0.5)
    squares = lambda_x * (kappa_m - kappa_7) / (kappa_8 * lambda_vartheta)
    assert squares.max() <= region.radius**2 * (1 + 1e-12)
    assert squares.max() == pytest.approx(region.radius**2, rel=1e-2)


def test_no_order_of_alpha_and_beta_has_a_larger_radius():
    """Of gains at random: the radius as printed over a grid of l in both orders, and at one l."""
    random = np.random.default_rng(5)
    fine = np.geomspace(1e-2, 1e2, 4001)
    orders = set()
    for _ in range(100):
        alpha, beta, K_p = *random.uniform(1.2, 8, 2), random.uniform(150, 400)
        gains = replace(SATISFYING, Lambda_0=alpha + beta, Lambda_1=alpha * beta, K_p=K_p, k_d=random.uniform(300, 900))
        c = replace(SMALL, c_3=2 * math.hypot(1, alpha, beta), lambda_d=random.uniform(0, 200))
        squares = []
        for pair in ((alpha, beta), (beta, alpha)):
            kappa_m = literal(gains, c, *pair, fine).min(axis=0)
            room = kappa_m - 0.5 * ((c.c_1 + c.c_4) / fine + 3 * c.c_3)
            squares.append(0.5 * c.lambda_m * room / (0.5 * (c.c_2 + c.c_5) / fine * 0.5 * max(K_p, c.lambda_M)))
        if np.max(squares) < 1e-3:
            continue
        region = region_of_attraction(gains, c)
        assert np.max(squares) <= region.radius**2 * (1 + 1e-12)
        assert np.max(squares) == pytest.approx(region.radius**2, rel=0.02)
        at = int(random.integers(1750, 2050))
        if np.max(squares, axis=0)[at] > 0:
            assert region_of_attraction(gains, c, l=fine[at]).radius ** 2 == pytest.approx(np.max(squares, axis=0)[at])
        orders.add((region.alpha > region.beta, region.alpha == pytest.approx(alpha)))
    assert len(orders) == 4


@pytest.mark.parametrize("name", ["c_1", "c_2", "c_3", "c_4", "c_5", "lambda_M"])
@settings(max_examples=15)
@given(bounds=positive_bounds, factor=st.floats(1.05, 2))
def test_a_larger_bound_never_enlarges_the_region(name, bounds, factor):
    larger = replace(bounds, **{name: getattr(bounds, name) * factor})
    before, after = region_of_attraction(SATISFYING, bounds).radius, region_of_attraction(SATISFYING, larger).radius
    assert after <= before
    if name == "c_3":
        assert after < before


@settings(max_examples=25)
@given(bounds=positive_bounds, factor=st.floats(1.05, 3))
def test_more_inertia_damping_or_observer_gain_never_shrinks_the_region(bounds, factor):
    radius = region_of_attraction(SATISFYING, bounds).radius
    wide = replace(bounds, lambda_M=bounds.lambda_m * 5)
    heavier = replace(wide, lambda_m=bounds.lambda_m * factor)
    assert region_of_attraction(SATISFYING, heavier).radius >= region_of_attraction(SATISFYING, wide).radius
    assert region_of_attraction(SATISFYING, replace(bounds, lambda_d=bounds.lambda_d * factor)).radius >= radius
    assert region_of_attraction(replace(SATISFYING, k_d=600 * factor), bounds).radius >= radius


def test_slow_adaptation_shrinks_the_region():
    """1/gamma_theta = 400 takes the place of K_p = 200 in lambda_vartheta."""
    radius = region_of_attraction(SATISFYING, SMALL).radius
    for name in ("gamma_w", "gamma_theta"):
        slow = region_of_attraction(replace(SATISFYING, **{name: 1 / 400}), SMALL)
        assert slow.radius == pytest.approx(radius / math.sqrt(2))
        assert region_of_attraction(replace(SATISFYING, **{name: 1e6}), SMALL).radius == radius


def test_no_K_p_makes_the_region_as_large_as_one_likes():
    """As K_p grows, lambda_x is lambda_m/2, lambda_vartheta K_p/2 and kappa_m at most (1 - l) K_p + lambda_d."""
    bound = math.sqrt(SMALL.lambda_m / (2 * (SMALL.c_2 + SMALL.c_5)))
    radii = [region_of_attraction(replace(SATISFYING, K_p=k, k_d=k), SMALL).radius for k in (1e4, 1e6, 1e8)]
    assert max(radii) < bound * (1 + 1e-3)
    assert radii[2] == pytest.approx(radii[1], rel=1e-3)


@given(
    bounds=positive_bounds,
    K_p=st.tuples(st.floats(100, 1e4), st.floats(100, 1e4)),
    roots=st.tuples(st.floats(0.5, 20), st.floats(1, 20)),
    k_d=st.floats(10, 1e5),
)
@example(bounds=SMALL, K_p=(200, 200), roots=(8, 2), k_d=600)
def test_no_gains_make_the_region_as_large_as_one_likes(bounds, K_p, roots, k_d):
    gains = replace(SATISFYING, K_p=K_p, Lambda_0=sum(roots), Lambda_1=math.prod(roots), k_d=k_d)
    least = replace(bounds, c_3=2 * math.hypot(1, *roots))
    try:
        radius = region_of_attraction(gains, least).radius
    except ControllerError as refusal:
        assert "Theorem 1 promises nothing" in str(refusal)  # noqa: PT017 (it is right of many gains)
        return
    largest = bounds.lambda_m / 2 + 4 * bounds.lambda_d * bounds.lambda_m / bounds.lambda_M
    assert radius**2 <= largest / (bounds.c_2 + bounds.c_5)


def test_a_c_3_is_refused_with_which_27_does_not_hold():
    """The least one against (26) from the definitions (16), (18) of x, and where it is attained."""
    alpha, beta = 8.0, 2.0
    random = np.random.default_rng(4)
    xi_o, q_tilde, s_o = random.normal(size=(3, 1000, 2))
    xi_o[0], q_tilde[0], s_o[0] = [-beta, 0], [-alpha, 0], [1, 0]
    integral = (xi_o - q_tilde) / alpha
    s_tilde = 2 * (s_o - (alpha + beta) * q_tilde - alpha * beta * integral)
    norms = np.sqrt(sum((part**2).sum(axis=1) for part in (xi_o, q_tilde, s_o)))
    ratios = np.linalg.norm(s_tilde, axis=1) / norms
    assert ratios.argmax() == 0
    assert region_of_attraction(SATISFYING, replace(SMALL, c_3=ratios[0])).radius > 0
    with pytest.raises(ControllerError, match=r"the bound c_3 is 16.5: with these gains \(27\) needs at least 16.6132"):
        region_of_attraction(SATISFYING, replace(SMALL, c_3=16.5))


def test_without_quadratic_bounds_the_region_is_everything():
    assert region_of_attraction(SATISFYING, replace(SMALL, c_2=0, c_5=0)).radius == math.inf


@pytest.mark.parametrize(
    ("gains", "bounds", "l", "message"),
    [
        (PRINTED, SMALL, None, r"not satisfied with l = .*, where all come nearest: \(40\), \(41\)"),
        (SATISFYING, SMALL, 3.0, r"not satisfied with l = 3, as given: \(40\), \(41\)"),
        (replace(SATISFYING, Lambda_0=2, Lambda_1=3), SMALL, None, "no real alpha and beta exist"),
        (SATISFYING, replace(SMALL, c_3=100), None, r"kappa_m exceeds kappa_7, \(52\), for no l"),
        (SATISFYING, replace(SMALL, c_3=100), 0.5, r"kappa_m does not exceed kappa_7, \(52\), with l = 0.5"),
    ],
)
def test_where_the_theorem_promises_nothing_the_radius_is_refused(gains, bounds, l, message):  # noqa: E741
    with pytest.raises(ControllerError, match=f"Theorem 1 promises nothing: {message}"):
        region_of_attraction(gains, bounds, l=l)


def test_a_region_of_attraction_that_cannot_be_asked_for_is_refused():
    with pytest.raises(ControllerError, match="the bound lambda_M is not given"):
        region_of_attraction(SATISFYING, replace(SMALL, lambda_M=None))
    with pytest.raises(ControllerError, match="the bound lambda_M is 4: it must be at least lambda_m, 5"):
        replace(SMALL, lambda_M=4)
    for name in ("gamma_w", "gamma_theta"):
        with pytest.raises(GainError, match=f"gain '{name}' is 0: Theorem 1 needs a positive one"):
            region_of_attraction(replace(SATISFYING, **{name: 0}), SMALL)
    for constant in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ControllerError, match=r"the constant l is .*: it must be positive and finite"):
            region_of_attraction(SATISFYING, SMALL, l=constant)


# Numbers at the edge of double precision, and what is no number -----------------------------------------------------


def test_a_double_root_is_real_whichever_way_it_is_rounded():
    """As decimals, Lambda_0 = 2 a and Lambda_1 = a^2: their discriminant is zero, that of the doubles often is not."""
    below = 0
    for i in range(1, 500):
        a = i / 100
        gains = replace(PRINTED, Lambda_0=round(2 * a, 2), Lambda_1=round(a * a, 4))
        report = check_gains(gains, BOUNDS)
        assert report.discriminant == 0.0
        assert report.alpha == pytest.approx(a, rel=1e-15)
        assert report.beta == pytest.approx(a, rel=1e-15)
        below += gains.Lambda_0[0] ** 2 - 4 * gains.Lambda_1[0] < 0
    assert below > 50
    satisfied = replace(PRINTED, Lambda_0=2.26, Lambda_1=1.2769, K_p=100, k_d=1e4)
    assert check_gains(satisfied, Bounds(0, 0, 0, 0, 0, 5, 50)).satisfied
    apart = replace(satisfied, Lambda_1=1.2769 * (1 + 1e-15))
    assert check_gains(apart, BOUNDS).discriminant < 0
    assert math.isnan(check_gains(apart, BOUNDS).alpha)


@pytest.mark.parametrize(
    ("total", "product", "larger", "smaller"),
    [
        (1e160, 1e308, 1e160, 1e148),
        (1e300, 1.0, 1e300, 1e-300),
        (1.7e308, 1.7e308, 1.7e308, 1.0),
        (2e-160, 7.5e-321, 1.5e-160, 5e-161),
        (1e-170, 1e-300, math.nan, math.nan),
        (1e-170, 1e308, math.nan, math.nan),
    ],
)
def test_roots_of_numbers_whose_squares_are_none(total, product, larger, smaller):
    report = check_gains(replace(PRINTED, Lambda_0=total, Lambda_1=product), BOUNDS)
    assert sorted((report.alpha, report.beta)) == pytest.approx([smaller, larger], rel=5e-3, abs=0.0, nan_ok=True)
    assert (report.discriminant < 0) == math.isnan(larger)


@pytest.mark.parametrize(
    "bearings", [np.array([5j + 0.1]), ["0.1"], "0.1", [True], [0.1, True], [10**400], [0.1, None], [[0.1], [0.1, 0.2]]]
)
def test_what_is_no_number_is_no_bearing(bearings):
    with pytest.raises(ControllerError, match="the desired bearing is"):
        check_gains(PRINTED, BOUNDS, bearings)


def test_bearings_may_be_arrays_of_one_number():
    largest = check_gains(PRINTED, BOUNDS, [np.array(0.1), np.array(-0.2), np.float32(0.125)])["Remark 2"].right
    assert largest == 0.2


@pytest.mark.parametrize("bearings", [np.ma.masked_array([0.1, 9.0], mask=[False, True]), [0.1, np.ma.masked]])
def test_a_masked_bearing_is_refused(bearings):
    with pytest.raises(ControllerError, match="the desired bearing is"):
        check_gains(PRINTED, BOUNDS, bearings)


def test_a_report_is_asked_for_the_conditions_that_it_has():
    report = check_gains(PRINTED, BOUNDS, [0.1])
    assert list(report) == ["(39)", "(40)", "(41)", "(42)", "Remark 2"]
    assert "(39)" in report
    assert "43" not in report


def test_every_refusal_is_a_controller_error():
    with pytest.raises(ControllerError, match=r"unknown condition '43'; known: \(39\), \(40\), \(41\), \(42\)"):
        check_gains(PRINTED, BOUNDS)["43"]
    with pytest.raises(ControllerError, match="the bound c_1 is 1000"):
        replace(BOUNDS, c_1=10**400)
    for l in ("a", None, 1j, True, 10**400, math.nan):  # noqa: E741
        with pytest.raises(ControllerError, match="the constant l is"):
            propose_gains(PRINTED, BOUNDS, l=l)
    for l in ("a", 1j, True, 10**400):  # noqa: E741
        with pytest.raises(ControllerError, match="the constant l is"):
            region_of_attraction(PRINTED, replace(BOUNDS, lambda_M=6), l=l)
    for margin in ("a", None, 1j, True, 10**400, math.nan):
        with pytest.raises(ControllerError, match="the margin is"):
            propose_gains(PRINTED, BOUNDS, margin=margin)


def test_bounds_are_doubles():
    exact = Bounds(*map(Fraction, ("1/10", "1/5", "1", "3", "1", "5", "4")))
    assert exact == Bounds(0.1, 0.2, 1.0, 3.0, 1.0, 5.0, 4.0)
    assert all(type(value) is float for name, value in vars(exact).items() if name != "lambda_M")
