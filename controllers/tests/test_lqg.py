"""The linear-quadratic law: its design against that of python-control, one tick in matrix form."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from formation_controllers import (
    CarLike,
    ControllerError,
    Desired,
    DifferentialDrive,
    Leader,
    Team,
    TractorTrailer,
    lqg,
)
from formation_controllers.analysis.formation_model import ReducedDynamics
from formation_controllers.analysis.linearisation import linearised
from formation_controllers.dynamics import TRACTOR_TRAILER_MODEL
from formation_controllers.geometry import formation_rates, input_matrix, range_bearing
from formation_controllers.lqg import Lqg, LqgGains

design = pytest.importorskip("control")

H, N = 0.02, 6
C = np.eye(2, 4)
VEHICLES = pytest.mark.parametrize(
    ("vehicle", "model"),
    [
        (CarLike(1.2), {}),
        (TractorTrailer(1.5, 0.15, 0.4), TRACTOR_TRAILER_MODEL),
        (DifferentialDrive(0.15, 0.4), {"I_1": 0.0, "I_2": 2.3, "S_0": 2.25}),
    ],
    ids=["car_like", "tractor_trailer", "differential_drive"],
)


def design_problem(vehicle, model):
    """Return a started controller with gains, a range and a bearing of each follower's own, and its inputs."""
    random = np.random.default_rng(11)
    pairs = ("q_max", "rate_max", "integral_max", "force_max", "force_noise", "q_noise")
    gains = [
        LqgGains(
            v_0=random.uniform(0.1, 0.6),
            torque_limit=math.inf if i % 2 else 2.0,
            **{name: tuple(random.uniform(0.5, 2, 2) * getattr(LqgGains(), name)) for name in pairs},
            **(model | {name: random.uniform(10, 40) for name in ("m", "d_x", "d_y", "d_1", "d_2")}),
        )
        for i in range(N)
    ]
    entries = len(vehicle.pose)
    pose = random.uniform([-6, -3, -0.5, -0.5], [-4, 3, 0.5, 0.5], (N, 4))[:, :entries]
    leader = Leader(np.array([1.0, 0.5, 0.3, 0.2])[:entries], np.array([0.4, -0.1]), np.array([0.7, 0.2]))
    q = range_bearing(pose, leader.pose, vehicle)
    desired = Desired(q + random.uniform(-0.3, 0.3, (N, 2)), *random.normal(size=(2, N, 2)))
    controller = Lqg(Team(vehicle, N, H), gains)
    controller.start(pose, leader, desired)
    return random, gains, pose, leader, desired, controller


@VEHICLES
def test_the_design_is_that_of_python_control(vehicle, model):
    _, gains, _, _, desired, controller = design_problem(vehicle, model)
    state = controller.get_state()
    for i, g in enumerate(gains):
        A, B, M = linearised(vehicle, g, g.v_0, *desired.q[i])
        held = design.ss(A, B, C, np.zeros((2, 2))).sample(H, "zoh")
        Phi, Gamma = held.A, held.B
        F = np.block([[Phi, np.zeros((4, 2))], [H * C, np.eye(2)]])
        G = np.vstack([Gamma, np.zeros((2, 2))])
        Q = np.diag(1 / np.square([*g.q_max, *g.rate_max, *g.integral_max]))
        R = np.diag(1 / np.square(g.force_max))
        K, _, _ = design.dlqr(F, G, Q, R)
        predicting, _, _ = design.dlqe(Phi, Gamma, C, np.diag(np.square(g.force_noise)), np.diag(np.square(g.q_noise)))
        L = np.linalg.solve(Phi, predicting)  # at the measurement, of which the prediction is a period later
        for name, expected in {"Phi": Phi, "Gamma": Gamma, "K": K, "L": L, "M": M}.items():
            found = state[name][i]
            np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max(), err_msg=name)
    assert np.ptp(state["K"], axis=0).min() > 0
    assert np.ptp(state["L"], axis=0).min() > 0


@VEHICLES
def test_a_weak_integral_action_is_designed_as_any_other(vehicle, model):
    """It grows with the inverse of what weighs one, also where it is the slowest mode by far."""
    weakest = None
    for largest in (1e6, 1e8, 1e9, 1e15, 1e16, 1e30, 1e154):
        K = lqg._design(vehicle, LqgGains(integral_max=largest, **model), H, 3.0, 0.5)[2]
        scaled = largest * K[:, 4:]
        weakest = scaled if weakest is None else weakest
        np.testing.assert_allclose(scaled, weakest, rtol=1e-4, atol=1e-4 * np.abs(weakest).max())
    K = lqg._design(vehicle, LqgGains(integral_max=1e200, **model), H, 3.0, 0.5)[2]
    assert not K[:, 4:].any()  # its square is no number any more


@VEHICLES
def test_one_tick_is_the_law_in_matrix_form(vehicle, model):
    """Filter, feedback, feedforward, clipping and prediction, each follower with a design of its own."""
    random, gains, pose, leader, desired, controller = design_problem(vehicle, model)
    state, q = controller.get_state(), range_bearing(pose, leader.pose, vehicle)
    np.testing.assert_array_equal(state["x_hat"], np.hstack([q - desired.q, np.zeros((N, 2))]))
    state["bearing"] = random.uniform(-20, 20, N)
    q[:, 1] += 2 * np.pi * np.round((state["bearing"] - q[:, 1]) / (2 * np.pi))
    state["x_hat"], state["integral"] = random.normal(size=(N, 4)), random.normal(size=(N, 2))
    controller.set_state(state)
    torque, after, told = controller.step(pose, leader, desired), controller.get_state(), controller.telemetry()
    R, _ = formation_rates(pose, leader.pose, leader.velocity[0], vehicle)
    B2 = input_matrix(pose, vehicle)
    for i, g in enumerate(gains):
        own = {name: value[i] for name, value in state.items()}
        epsilon = q[i] - desired.q[i]
        x = own["x_hat"] + own["L"] @ (epsilon - C @ own["x_hat"])
        u = -own["K"] @ np.concatenate([x, own["integral"]])
        heading = pose[i, 2]
        d_1 = g.d_x * math.cos(heading) ** 2 + g.d_y * math.sin(heading) ** 2
        pace = np.array([g.m * leader.acceleration[0] + d_1 * leader.velocity[0], 0.0])
        tau = np.linalg.solve(B2[i], R[i].T @ (u + own["M"] @ desired.q_ddot[i]) + pace)
        applied = np.clip(tau, -g.torque_limit, g.torque_limit)
        M2, _, _ = ReducedDynamics.of_vehicle(vehicle, g).at(pose[i])
        lost = R[i] @ np.linalg.solve(M2, B2[i] @ (applied - tau))  # of q_ddot
        x_hat = own["Phi"] @ x + own["Gamma"] @ (u + own["M"] @ lost)
        integral = own["integral"] + (0 if told["held"][i] else H) * epsilon
        close = {"rtol": 1e-9, "atol": 1e-9}
        np.testing.assert_allclose(torque[i], tau, **close)
        np.testing.assert_allclose(after["bearing"][i], q[i, 1], **close)
        np.testing.assert_allclose(after["x_hat"][i], x_hat, **close)
        np.testing.assert_allclose(after["integral"][i], integral, **close)
        names = ["range_estimate", "bearing_estimate", "range_rate_estimate", "bearing_rate_estimate"]
        estimates = x + np.concatenate([desired.q[i], desired.q_dot[i]])
        np.testing.assert_allclose([told[name][i] for name in names], estimates, **close)
    assert told["held"].tolist() == [1.0, 0.0] * (N // 2)


def test_a_state_is_redesigned_for_the_robots_that_have_other_gains():
    """An estimate goes on, and a design stays to the last bit where the gains are those of the state."""
    _, gains, pose, leader, desired, controller = design_problem(CarLike(1.2), {})
    controller.step(pose, leader, desired)
    state = controller.get_state()
    state["K"][0] += 1.0  # no design of these gains
    others = [gains[0], *(replace(own, q_max=0.1) for own in gains[1:])]
    fresh = Lqg(controller.team, others)
    fresh.start(pose, leader, desired)
    again = Lqg(controller.team, others)
    again.set_state(state)
    found, expected = again.get_state(), fresh.get_state()
    for name in Lqg.prepared:
        np.testing.assert_array_equal(found[name][0], state[name][0])
        np.testing.assert_array_equal(found[name][1:], expected[name][1:])
    for name in ("x_hat", "integral", "bearing"):
        np.testing.assert_array_equal(found[name], state[name])
    assert not np.allclose(state["K"][1:], expected["K"][1:])


def test_a_state_for_whose_gains_no_design_exists_is_refused(monkeypatch):
    _, gains, _, _, _, controller = design_problem(CarLike(1.2), {})
    state = controller.get_state()
    again = Lqg(controller.team, [*gains[:2], replace(gains[2], q_max=0.2), *gains[3:]])

    def impossible(*_):
        raise np.linalg.LinAlgError("no solution")

    monkeypatch.setattr(lqg, "riccati", impossible)
    with pytest.raises(ControllerError, match=r"no linear-quadratic design exists .* no solution") as error:
        again.set_state(state)
    assert error.value.robot == 2
    with pytest.raises(ControllerError, match="before the controller was started"):
        again.get_state()
