"""The paper's law (24) to (34): against its matrix form, in closed loop, and as a well-behaved controller."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from formation_controllers import CarLike, ControllerError, Desired, DifferentialDrive, Leader, Team, TractorTrailer
from formation_controllers.geometry import formation_rates, input_matrix, posture_error, range_bearing
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePid, NeuralAdaptivePidGains
from hypothesis import given, settings
from hypothesis import strategies as st

SECOND = 50  # ticks


@pytest.fixture(scope="module")
def as_printed(first_simulation):
    """The first simulation as printed, whole."""
    simulation = first_simulation()
    return simulation, *simulation.run(100 * SECOND)


def test_first_simulation_follows_the_reference_run(as_printed):
    _, states, leaders, _ = as_printed
    at_5_s = [
        [3.857638, 2.536781, 0.962215, 0.234500],
        [3.399517, 8.457761, -0.820298, -0.235215],
        [-2.240889, 11.343745, -1.250853, 0.396454],
        [-2.172558, -0.506999, 1.289044, -0.391531],
    ]
    at_100_s = [[25.166945, 3.590951, -0.022545, 0.003651], [25.169945, 7.402873, 0.023088, -0.003713]]
    np.testing.assert_allclose(states[5 * SECOND, :, :4], at_5_s, rtol=0, atol=1e-5)
    np.testing.assert_allclose(states[100 * SECOND, 2:, :4], at_100_s, rtol=0, atol=1e-4)
    np.testing.assert_allclose(leaders[[20 * SECOND, 100 * SECOND], 0], [8.516, 34.116], rtol=0, atol=1e-6)
    assert leaders[-1, 4] == pytest.approx(0.32, abs=1e-6)


def test_as_printed_two_followers_oscillate_to_the_end_and_two_settle(as_printed):
    simulation, states, leaders, _ = as_printed
    last = simulation.errors(states, leaders)[-20 * SECOND :]
    rms = np.sqrt((last**2).mean(axis=0))
    np.testing.assert_allclose(rms[:2, 0], [0.41, 0.39], atol=0.005)
    np.testing.assert_allclose(np.degrees(rms[:2, 1]), [5.1, 5.0], atol=0.05)
    assert (rms[2:, 0] < 0.1).all()
    assert (np.degrees(rms[2:, 1]) < 2).all()
    # 0.88 rad/s, from the upward crossings of the mean
    error = last[:, :2, 0] - last[:, :2, 0].mean(axis=0)
    for robot in range(2):
        crossings = np.flatnonzero((error[:-1, robot] < 0) & (error[1:, robot] >= 0))
        assert 2 * math.pi / (np.diff(crossings).mean() / SECOND) == pytest.approx(0.88, abs=0.02)


def test_as_printed_the_drive_gain_changes_sign_on_the_way(as_printed):
    _, _, _, telemetry = as_printed
    assert ((telemetry["drive_gain"] < 0).any(axis=0) == [True, True, False, False]).all()
    assert (telemetry["det_R"] > 0).all()


def test_telemetry_keeps_its_bounds_and_matches_the_run(as_printed):
    simulation, states, _, telemetry = as_printed
    gains = simulation.controller.gains
    assert telemetry["weight_norm"].max() <= math.sqrt(gains.W_m) * (1 + 1e-12)
    assert telemetry["weight_norm"].max() > 0.999 * math.sqrt(gains.W_m)
    assert telemetry["gain_estimate"].max() == gains.theta_m
    assert (np.diff(telemetry["gain_estimate"], axis=0) >= 0).all()
    assert np.abs(telemetry["torque_command"]).max() > 200  # unsaturated
    # the velocities that the observer finds for those who settle
    last = slice(-20 * SECOND, None)
    np.testing.assert_allclose(telemetry["speed_estimate"][last, 2:], states[:-1, 2:, 4][last], atol=1e-3)
    np.testing.assert_allclose(telemetry["steering_rate_estimate"][last, 2:], states[:-1, 2:, 5][last], atol=1e-3)


def test_a_smaller_weight_bound_lets_all_followers_settle_under_noise(first_simulation):
    simulation = first_simulation(gains=NeuralAdaptivePidGains(W_m=100), noise=1e-3, seed=1)
    states, leaders, telemetry = simulation.run(100 * SECOND)
    rms = np.sqrt((simulation.errors(states, leaders)[-20 * SECOND :] ** 2).mean(axis=0))
    assert (rms[:, 0] < 0.1).all()
    assert (np.degrees(rms[:, 1]) < 2).all()
    # and within the theory's domain
    assert (telemetry["drive_gain"] > 0).all()
    assert (telemetry["det_R"] > 0).all()


@pytest.mark.parametrize(
    "vehicle",
    [
        *(CarLike(1.2, drive) for drive in ("as_printed", "front_wheel", "rear_wheel")),
        TractorTrailer(1.5, 0.15, 0.4),
        DifferentialDrive(0.15, 0.4),
    ],
    ids=lambda vehicle: getattr(vehicle, "drive", vehicle.kind),
)
def test_one_tick_is_the_law_in_matrix_form(vehicle):
    """Torque and all states after one tick, from random states, against (24) to (34) written with matrices."""
    random = np.random.default_rng(7)
    n, h = 50, 0.02
    gains = NeuralAdaptivePidGains(
        K_p=(10, 7), Lambda_0=(2, 3), Lambda_1=(0.05, 0.1), k_d=8, theta_m=5, W_m=20, widths=np.linspace(5, 12, 9)
    )
    entries = len(vehicle.pose)
    pose = random.uniform([-6, -3, -1, -1], [-4, 3, 1, 1], (n, 4))[:, :entries]
    leader = Leader(np.array([1.0, 0.5, 0.3, 0.2])[:entries], np.array([0.4, -0.1]))
    gamma_d = {"tractor_trailer": [-0.1], "car_like": [0.2], "differential_drive": []}[vehicle.kind]
    desired = Desired(*random.normal(size=(3, n, 2)))
    controller = NeuralAdaptivePid(Team(vehicle, n, h), gains)
    controller.start(pose, leader, desired)
    state = {name: random.normal(size=value.shape) for name, value in controller.get_state().items()}
    state["theta"] = random.uniform(0, 5, n)
    state["bearing"] = random.uniform(-20, 20, n)
    controller.set_state(state)
    torque, after, told = controller.step(pose, leader, desired), controller.get_state(), controller.telemetry()

    q = range_bearing(pose, leader.pose, vehicle)
    q[:, 1] += 2 * np.pi * np.round((state["bearing"] - q[:, 1]) / (2 * np.pi))
    e = posture_error(pose, leader.pose, vehicle)
    R, delta = formation_rates(pose, leader.pose, leader.velocity[0], vehicle)
    B2 = input_matrix(pose, vehicle)
    K_p, L0, L1 = np.diag(gains.K_p), np.diag(gains.Lambda_0), np.diag(gains.Lambda_1)
    for i in range(n):
        own = {name: value[i] for name, value in state.items()}
        eps, eps_hat, tilde = q[i] - desired.q[i], own["q_hat"] - desired.q[i], q[i] - own["q_hat"]
        v_hat = np.linalg.solve(R[i], own["p"] + L0 @ tilde + gains.k_d * tilde - delta[i])  # (32)
        q_hat_dot = R[i] @ v_hat + delta[i]
        eps_hat_dot = q_hat_dot - desired.q_dot[i]
        s = eps_hat_dot + L0 @ (eps + tilde) + L1 @ own["epsilon_q_tilde_integral"]  # (25)
        x = np.concatenate([e[i], gamma_d, leader.velocity, q_hat_dot, desired.q_dot[i], desired.q_ddot[i]])
        sigma = np.exp(-((x - np.array(gains.centres)[:, None]) ** 2).sum(axis=1) / np.array(gains.widths) ** 2)
        u = -K_p @ eps_hat_dot - K_p @ L0 @ eps_hat - K_p @ L1 @ own["epsilon_hat_integral"] - own["W"] @ sigma
        u -= s * own["theta"] ** 2 / (own["theta"] * np.linalg.norm(s) + gains.epsilon_t)
        expected = {
            "bearing": q[i, 1],
            "q_hat": own["q_hat"] + h * q_hat_dot,
            "p": own["p"] + h * (desired.q_ddot[i] + gains.k_d * L0 @ tilde + L1 @ tilde + own["zeta"]),
            "zeta": own["zeta"] + h * gains.k_d * L1 @ tilde,
            "epsilon_hat_integral": own["epsilon_hat_integral"] + h * eps_hat,
            "epsilon_q_tilde_integral": own["epsilon_q_tilde_integral"] + h * (eps + tilde),
            "theta": min(own["theta"] + h * gains.gamma_theta * np.linalg.norm(s), gains.theta_m),
        }
        rate = np.outer(s, sigma)
        if np.trace(own["W"].T @ own["W"]) >= gains.W_m and sigma @ own["W"].T @ s > 0:
            rate -= sigma @ own["W"].T @ s / np.trace(own["W"].T @ own["W"]) * own["W"]
        W = own["W"] + h * gains.gamma_w * rate
        expected["W"] = W * min(1.0, math.sqrt(gains.W_m / np.trace(W.T @ W)))
        np.testing.assert_allclose(torque[i], np.linalg.solve(B2[i], R[i].T @ u), rtol=1e-9, atol=1e-9)
        for name, value in expected.items():
            np.testing.assert_allclose(after[name][i], value, rtol=1e-9, atol=1e-9, err_msg=name)
        np.testing.assert_allclose([told["speed_estimate"][i], told["steering_rate_estimate"][i]], v_hat, rtol=1e-9)
        np.testing.assert_allclose(told["weight_norm"][i], np.linalg.norm(own["W"]), rtol=1e-12)
        np.testing.assert_allclose(told["det_R"][i], np.linalg.det(R[i]), rtol=1e-9)
        radius = 1.0 if vehicle.kind == "car_like" else vehicle.wheel_radius
        assert told["drive_gain"][i] == B2[i, 0, 0] * radius
    np.testing.assert_array_equal(told["torque_command"], torque)


def test_the_bearing_stays_continuous_while_the_leader_circles_the_robot():
    vehicle = CarLike(1.2)
    controller = NeuralAdaptivePid(Team(vehicle, 1, 0.02))
    desired = Desired(np.array([[3.0, 0.5]]), np.zeros((1, 2)), np.zeros((1, 2)))
    pose = np.zeros((1, 4))
    estimates = []
    for k in range(2000):
        angle = 0.01 * k
        leader = Leader(np.array([1.2 + 3 * math.cos(angle), 3 * math.sin(angle), 0.0, 0.0]), np.zeros(2))
        if k == 0:
            controller.start(pose, leader, desired)
        controller.step(pose, leader, desired)
        assert controller.get_state()["bearing"][0] == pytest.approx(angle, abs=1e-9)
        estimates.append(controller.telemetry()["bearing_estimate"][0])
    assert np.abs(np.diff(estimates)).max() < 0.03
    assert estimates[-1] == pytest.approx(20.0, abs=0.2)


@pytest.mark.parametrize("desired_bearing", [2.0, -2.0])
def test_the_bearing_starts_on_the_turn_nearest_to_the_desired_one(desired_bearing):
    """Behind the leader's back: noise decides the sign of atan2, but not the turn that the law works with."""
    desired = Desired(np.array([[3.0, desired_bearing]]), np.zeros((1, 2)), np.zeros((1, 2)))
    for side in (1e-3, -1e-3):
        controller = NeuralAdaptivePid(Team(CarLike(1.2), 1, 0.02))
        controller.start(np.zeros((1, 4)), Leader(np.array([-3.0, side, 0, 0]), np.zeros(2)), desired)
        start = controller.get_state()
        assert (
            start["bearing"][0]
            == start["q_hat"][0, 1]
            == pytest.approx(math.copysign(math.pi, desired_bearing), abs=1e-3)
        )


def test_a_robot_whose_front_axle_is_under_the_leader_is_named():
    controller = NeuralAdaptivePid(Team(CarLike(1.2), 2, 0.02))
    pose = np.array([[-5.0, 0, 0, 0], [0, 0, 0, 0]])
    leader = Leader(np.array([1.2, 0, 0, 0]), np.array([0.3, 0]))
    desired = Desired(np.ones((2, 2)), np.zeros((2, 2)), np.zeros((2, 2)))
    controller.start(pose, leader, desired)
    with pytest.raises(ControllerError, match=r"robot 1: the torque is not finite, at range_estimate = 0\.0 m") as e:
        controller.step(pose, leader, desired)
    assert e.value.robot == 1


@settings(max_examples=20)
@given(order=st.permutations(range(4)), size=st.integers(1, 4))
def test_a_row_depends_on_itself_alone(order, size, first_simulation):
    """Any followers in any order: each moves to the last bit as in the whole team."""
    rows = order[:size]
    whole, _, told = first_simulation().run(2 * SECOND)
    part, _, part_told = first_simulation(rows=rows).run(2 * SECOND)
    np.testing.assert_array_equal(part, whole[:, rows])
    np.testing.assert_array_equal(part_told, told[:, rows])


def test_a_reset_controller_starts_afresh(first_simulation):
    fresh, _, _ = first_simulation().run(SECOND)
    simulation, used = first_simulation(), first_simulation()
    used.run(SECOND)
    used.controller.reset()
    used.controller.start(*simulation.sensed())
    simulation.controller = used.controller
    again, _, _ = simulation.run(SECOND)
    np.testing.assert_array_equal(again, fresh)


@pytest.mark.parametrize("how", ["copy", "state", "bytes", "pickle"])
def test_state_goes_on_to_the_last_bit(how, first_simulation):
    simulation = first_simulation()
    simulation.run(SECOND)
    if how == "copy":
        twin = simulation.controller.copy()
    elif how == "pickle":
        twin = pickle.loads(pickle.dumps(simulation.controller))
    else:
        twin = NeuralAdaptivePid(simulation.controller.team)
        if how == "state":
            twin.set_state(simulation.controller.get_state())
        else:
            twin.from_bytes(simulation.controller.to_bytes())
    for _ in range(SECOND):
        inputs = simulation.sensed()
        simulation.tick()
        twin.step(*inputs)
        for name, value in simulation.controller.telemetry().items():
            np.testing.assert_array_equal(twin.telemetry()[name], value)
    assert twin.to_bytes() == simulation.controller.to_bytes()


def test_the_next_tick_tells_whether_inputs_were_left_alone(first_simulation):
    simulation = first_simulation()
    pose, leader, desired = simulation.sensed()
    copies = pose.copy(), *(a.copy() for a in leader[:2]), *(a.copy() for a in desired)
    simulation.controller.step(pose, leader, desired)
    for given_array, copy in zip((pose, *leader[:2], *desired), copies, strict=True):
        np.testing.assert_array_equal(given_array, copy)
