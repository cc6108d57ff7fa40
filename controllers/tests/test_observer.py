"""The velocity observer (32) to (34), and the errors (25) that it gives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from formation_controllers import CarLike, Desired, Leader, Team, robot_view
from formation_controllers import velocity_observer as observer
from formation_controllers.interface import TickInputs
from formation_controllers.observer_pid import ObserverPid, ObserverPidGains, estimate


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


def test_the_approximation_25_and_its_error_26_add_up_to_17_and_18():
    """(25) as the law computes it, for a robot that moves at rates that it does not know."""
    random, n = np.random.default_rng(1), 15
    gains = ObserverPidGains(Lambda_0=(2, 3), Lambda_1=(0.05, 0.1), k_d=8)
    controller = ObserverPid(Team(CarLike(1.2), n, 0.02), gains)
    pose, leader = random.uniform([-6, -3, -1, -1], [-4, 3, 1, 1], (n, 4)), Leader(np.zeros(4), np.array([0.4, 0.1]))
    desired = Desired(*random.normal(size=(3, n, 2)))
    controller.start(pose, leader, desired)
    controller.set_state({name: random.normal(size=value.shape) for name, value in controller.get_state().items()})
    records, nothing = controller._records, np.zeros((n, 2))
    robot_view.see(TickInputs(pose, nothing, *leader[:2], np.zeros(2), *desired), records, 0, n)
    view, c = records.seen[0], records.columns[0]
    for i, own in enumerate(controller._state):
        estimate(view["q"][:, i], c, i, own, records.gains[i], desired.q[i], desired.q_dot[i])
        q, q_tilde, q_hat_dot, s = view["q"][:, i], *(c[name][:, i] for name in ("q_tilde", "q_hat_dot", "s"))
        q_dot, integral_of_tilde = random.normal(size=(2, 2))
        integral_of_epsilon = own["epsilon_q_tilde_integral"] - integral_of_tilde
        epsilon, tilde_dot = q - desired.q[i], q_dot - q_hat_dot
        s_c = q_dot - desired.q_dot[i] + np.multiply(gains.Lambda_0, epsilon)
        s_c += np.multiply(gains.Lambda_1, integral_of_epsilon)  # (17)
        pull = np.multiply(gains.Lambda_0, q_tilde) + np.multiply(gains.Lambda_1, integral_of_tilde)
        s_o = tilde_dot + pull  # (18)
        np.testing.assert_allclose(s + 2 * (s_o - pull), s_c + s_o, rtol=1e-12, atol=1e-12)


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
