"""The velocity observer (32) to (34)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from formation_controllers import observer


def test_observer_is_equivalent_to_its_error_equation():
    """(35): ds_c/dt = ds_o/dt + k_d s_o + Lambda_0 d(epsilon)/dt + Lambda_1 epsilon, from (32) to (34)."""
    random = np.random.default_rng(0)
    for _ in range(100):
        L0, L1, k_d = random.uniform(0.01, 10, 3)
        q_ddot, qd_ddot, eps, eps_dot, tilde, tilde_dot, tilde_int = random.normal(size=7)
        zeta = k_d * L1 * tilde_int  # (34), integrated
        assert observer.zeta_dot(tilde, L1, k_d) == pytest.approx(k_d * L1 * tilde)
        # the time derivative of (32), with (33)
        q_hat_ddot = observer.rate_estimate(observer.p_dot(zeta, tilde, qd_ddot, L0, L1, k_d), tilde_dot, L0, k_d)
        s_c_dot = (q_ddot - qd_ddot) + L0 * eps_dot + L1 * eps
        s_o = tilde_dot + L0 * tilde + L1 * tilde_int
        s_o_dot = (q_ddot - q_hat_ddot) + L0 * tilde_dot + L1 * tilde
        assert s_c_dot == pytest.approx(s_o_dot + k_d * s_o + L0 * eps_dot + L1 * eps, abs=1e-9)


def test_the_estimated_rate_converges_to_that_of_a_moving_range():
    h, L0, L1, k_d = 0.001, 2.0, 0.05, 10.0
    q_hat, p, zeta = 0.0, 0.0, 0.0
    for k in range(20_000):
        q = math.sin(0.3 * k * h)
        tilde = q - q_hat
        rate = observer.rate_estimate(p, tilde, L0, k_d)
        p_dot = observer.p_dot(zeta, tilde, -0.09 * q, L0, L1, k_d)
        q_hat, p, zeta = q_hat + h * rate, p + h * p_dot, zeta + h * observer.zeta_dot(tilde, L1, k_d)
    assert abs(rate - 0.3 * math.cos(0.3 * k * h)) < 1e-3
