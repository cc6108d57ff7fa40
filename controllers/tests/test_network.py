"""The radial-basis-function network (11) and the projections (28) to (30)."""

from __future__ import annotations

import numpy as np
import pytest
from formation_controllers import network, projection
from formation_controllers.columns import columns
from formation_controllers.gains import gain_records
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

HIDDEN = 9


def basis(x, gains):
    """Return sigma (robots, neurons) of inputs (robots, inputs)."""
    of_block = columns(network.columns(x.shape[1], HIDDEN))
    of_block["x"][0, :, : len(x)] = x.T
    network.basis(of_block[0], gain_records(gains), 0, len(x))
    assert not of_block["sigma"].ravel()[HIDDEN * len(x) :].any()
    return np.array([network.sigma_of(of_block[0], r, len(x)) for r in range(len(x))])


def test_basis_and_output_are_the_formula():
    random = np.random.default_rng(0)
    x, widths = random.normal(size=(5, 13)), random.uniform(1, 10, (5, HIDDEN))
    centres = np.arange(-4.0, 5.0) + random.normal(size=(5, 1))
    gains = [network.NetworkGains(centres=c, widths=w) for c, w in zip(centres, widths, strict=True)]
    of_all = basis(x, gains)
    expected = np.exp(-((x[:, None] - centres[..., None]) ** 2).sum(axis=2) / widths**2)
    np.testing.assert_allclose(of_all, expected, rtol=1e-13)
    W, sigma = random.normal(size=(2, HIDDEN)), of_all[0].copy()
    np.testing.assert_allclose([network.output(W, sigma, m) for m in range(2)], W @ sigma, rtol=1e-13)


def test_a_basis_function_is_one_at_its_centre():
    (sigma,) = basis(np.full((1, 13), 2.0), [network.NetworkGains()])
    assert sigma[6] == 1.0
    assert np.argmax(sigma) == 6


numbers = st.floats(-1e3, 1e3)
weights = arrays(float, (2, HIDDEN), elements=numbers)
errors = arrays(float, 2, elements=numbers)
bases = arrays(float, HIDDEN, elements=st.floats(0, 1))
bounds = st.floats(1e-3, 1e4)


few = settings(max_examples=50)  # an example has some thirty numbers


@few
@given(W=weights, steps=st.lists(st.tuples(errors, bases), max_size=20), W_m=bounds, gamma_w=st.floats(0, 1e3))
def test_weights_never_leave_their_bound(W, steps, W_m, gamma_w):
    for s, sigma in steps:
        projection.step_weights(W, projection.norm_squared(W), s, sigma, gamma_w, W_m, 0.02)
        assert np.trace(W.T @ W) <= W_m * (1 + 1e-12)


@few
@given(W=weights, s=errors, sigma=bases)
def test_inside_the_bound_weights_follow_the_gradient(W, s, sigma):
    W_m = 4 * np.trace(W.T @ W) + 1e6
    expected = W + 0.02 * 0.01 * np.outer(s, sigma)
    projection.step_weights(W, projection.norm_squared(W), s, sigma, 0.01, W_m, 0.02)
    np.testing.assert_allclose(W, expected, rtol=1e-13, atol=1e-13)


@few
@given(W=weights, s=errors, sigma=bases, W_m=bounds)
def test_on_the_bound_the_rate_has_no_outward_part(W, s, sigma, W_m):
    if not np.trace(W.T @ W) > 1e-6:
        W = np.ones_like(W)
    W = W * np.sqrt(W_m / np.trace(W.T @ W))
    rate = np.empty_like(W)
    projection.weight_rates(W, projection.norm_squared(W), s, sigma, 1.0, W_m, rate)
    scale = np.linalg.norm(W) * np.linalg.norm(np.outer(s, sigma))
    assert np.sum(W * rate) <= 1e-9 * max(scale, 1.0)
    if s @ W @ sigma <= 0:
        np.testing.assert_array_equal(rate, np.outer(s, sigma))


@few
@given(W=weights, ideal=weights, s=errors, sigma=bases, W_m=bounds)
def test_projection_does_not_hurt_the_lyapunov_function(W, ideal, s, sigma, W_m):
    """The second inequality of (50), for any ideal weights within the bound."""

    def within(V):
        return V * np.sqrt(W_m / max(np.trace(V.T @ V), W_m))

    W, ideal = within(W), within(ideal)
    rate = np.outer(s, sigma) - projection.outward(W, projection.norm_squared(W), s, sigma, W_m) * W
    wrong = ideal - W
    scale = np.linalg.norm(wrong) * np.linalg.norm(np.outer(s, sigma))
    assert s @ wrong @ sigma - np.sum(wrong * rate) <= 1e-8 * max(scale, 1.0)


@given(theta_m=st.floats(0, 100), norms=st.lists(st.floats(0, 1e6), max_size=20))
def test_the_robust_gain_grows_up_to_its_bound(theta_m, norms):
    theta = 0.0
    for norm in norms:
        stepped = projection.step_gain(theta, norm, 0.5, theta_m, 0.02)
        assert theta <= stepped <= theta_m
        assert stepped == pytest.approx(min(theta + 0.01 * norm, theta_m))
        theta = stepped


@few
@given(W=weights, s=errors, sigma=bases, W_m=bounds, theta=st.floats(0, 10), theta_m=st.floats(0, 10))
def test_steps_follow_the_rates(W, s, sigma, W_m, theta, theta_m):
    """Where a short step does not meet the bound it is the rate times the period."""
    period, rate = 1e-6, np.empty_like(W)
    stepped = W.copy()
    projection.weight_rates(W, projection.norm_squared(W), s, sigma, 0.7, W_m, rate)
    projection.step_weights(stepped, projection.norm_squared(W), s, sigma, 0.7, W_m, period)
    if np.trace((W + period * rate).T @ (W + period * rate)) <= W_m:
        np.testing.assert_allclose(stepped, W + period * rate, rtol=1e-12, atol=1e-12)
    theta = min(theta, theta_m)
    expected = theta + period * projection.gain_rate(theta, 2.0, 0.5, theta_m)
    assert projection.step_gain(theta, 2.0, 0.5, theta_m, period) == pytest.approx(min(expected, theta_m))
    assert projection.gain_rate(theta_m, 2.0, 0.5, theta_m) == 0.0
