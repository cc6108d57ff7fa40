"""All laws of the package: their claims, in closed loop on reduced plants, near singularities and at limits."""

from __future__ import annotations

import functools
import importlib.util
import math
import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import FunctionType

import numba
import numpy as np
import pytest
from formation_controllers import (
    CarLike,
    ControllerError,
    Desired,
    DifferentialDrive,
    GainError,
    Leader,
    Team,
    TractorTrailer,
    singularities,
)
from formation_controllers import load as find
from formation_controllers.analysis.formation_model import ReducedDynamics, formation_model
from formation_controllers.analysis.linearisation import linearised
from formation_controllers.columns import BLOCK
from formation_controllers.controller import Controller
from formation_controllers.dynamics import DIFFERENTIAL_DRIVE_MODEL, TRACTOR_TRAILER_MODEL
from formation_controllers.feedback_linearisation import FeedbackLinearisation, FeedbackLinearisationGains
from formation_controllers.geometry import first_range_bearing, formation_rates, input_matrix, range_bearing
from formation_controllers.interface import TickInputs
from formation_controllers.lqg import Lqg, LqgGains
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePid, NeuralAdaptivePidGains
from formation_controllers.neural_high_gain import NeuralHighGain, NeuralHighGainGains
from formation_controllers.observer_pid import ObserverPid, ObserverPidGains
from formation_controllers.testing import check_controller
from numba.core.runtime import rtsys
from numba.core.runtime._nrt_python import memsys_disable_stats, memsys_enable_stats

PACKAGE = "formation_controllers"
SECOND = 50  # ticks
load = functools.cache(find)  # which searches every installed package
NAMES = ["feedback-linearisation", "lqg", "neural-adaptive-pid", "neural-high-gain", "observer-pid"]
ALL = pytest.mark.parametrize("name", NAMES)

# Section 5.1, second simulation, and 5.2: "same as the previous simulation"
ON_A_CIRCLE = NeuralAdaptivePidGains(gamma_theta=0.25, theta_m=20, gamma_w=0.1, W_m=100)
SETTLING = {
    "line": {"neural-adaptive-pid": NeuralAdaptivePidGains(W_m=100)},
    "circle": {"neural-adaptive-pid": ON_A_CIRCLE},
    "tractor_trailer": {
        "neural-adaptive-pid": ON_A_CIRCLE,
        "feedback-linearisation": FeedbackLinearisationGains(**TRACTOR_TRAILER_MODEL),
        "lqg": LqgGains(**TRACTOR_TRAILER_MODEL),
    },
    "differential": {
        "neural-adaptive-pid": ON_A_CIRCLE,
        "feedback-linearisation": FeedbackLinearisationGains(**DIFFERENTIAL_DRIVE_MODEL),
        "lqg": LqgGains(**DIFFERENTIAL_DRIVE_MODEL),
        "neural-high-gain": NeuralHighGainGains(K_2=(60, 15)),  # a quarter of the car's inertia turns with omega
    },
}


@ALL
def test_every_law_keeps_what_controllers_promise(name):
    check_controller(load(name))


@ALL
def test_a_follower_beside_fifteen_others_or_alone_moves_to_the_same_bit(name):
    """Laws take followers in blocks; here are a full one and one that is not."""
    check_controller(load(name), size=BLOCK + 5)


def turned_far(angle):
    """Return a direction alike, as near as numbers there allow, beyond all angles for which a block is quick."""
    return angle + 2 * math.pi * 2e5


@ALL
def test_one_angle_that_is_far_away_leaves_the_rest_of_its_block_alone(name):
    random, n = np.random.default_rng(6), 5
    pose = random.uniform([-6, -3, -0.4, -0.3], [-4, 3, 0.4, 0.3], (n, 4))
    leader, nothing = Leader(np.array([0.0, 0.0, 0.02, 0.01]), np.array([0.3, 0.01])), np.zeros((n, 2))
    q = range_bearing(pose, leader.pose, CarLike(1.2)) + 0.1
    far = pose.copy()
    far[2, 2] = turned_far(far[2, 2])
    torques = []
    for poses in (pose, far):
        controller = load(name)(Team(CarLike(1.2), n, 0.02))
        desired = Desired(q.copy(), nothing, nothing)
        controller.start(poses, leader, desired)
        torques.append([controller.step(poses, leader, desired, nothing + 0.1) for _ in range(3)])
    near, beyond = map(np.array, torques)
    others = [0, 1, 3, 4]
    np.testing.assert_array_equal(beyond[:, others], near[:, others])
    if name not in ("neural-adaptive-pid", "lqg"):  # the one feels e_3 itself, the others its sine alone
        np.testing.assert_allclose(beyond[:, 2], near[:, 2], rtol=1e-6)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
@ALL
def test_a_tick_asks_for_no_memory(name):
    controller, pose = load(name)(Team(CarLike(1.2), 2, 0.02)), np.array([[-5.0, 0, 0, 0], [-5.0, 2, 0, 0]])
    leader = Leader(np.zeros(4), np.array([0.3, 0.0]), np.zeros(2))
    desired = Desired(np.full((2, 2), 4.0), np.zeros((2, 2)), np.zeros((2, 2)))
    controller.start(pose, leader, desired)
    tick, own = controller.compiled_tick()

    @numba.njit(error_model="numpy")
    def often(inputs, own, torque, times):
        for _ in range(times):
            tick(inputs, own, torque)

    def allocations(times):
        before = rtsys.get_allocation_stats().alloc
        often(TickInputs(pose, np.zeros((2, 2)), *leader, *desired), own, np.zeros((2, 2)), times)
        return rtsys.get_allocation_stats().alloc - before

    memsys_enable_stats()
    try:
        allocations(1)
        assert allocations(100) == allocations(1)
    finally:
        memsys_disable_stats()


@ALL
def test_every_law_serves_followers_with_gains_of_their_own(name):
    """Row i equals row i of a team in which all followers have the gains of i."""
    law = load(name)
    own = [law.gains_type(guard=guard) for guard in (0.0, 0.1, 0.2, 0.9)]
    if issubclass(law, ObserverPid):
        own = [replace(gains, K_p=(10 + i, 8), k_d=9 + i) for i, gains in enumerate(own)]
    check_controller(law, own)
    with pytest.raises(GainError, match="have gains of their own: see robot_gains"):
        _ = law(Team(CarLike(1.2), 4, 0.02), own).gains
    with pytest.raises(GainError, match="gains for 4 followers: expected 3"):
        law(Team(CarLike(1.2), 3, 0.02), own)


@pytest.mark.parametrize("course", SETTLING)
@ALL
def test_every_law_settles_under_noise(name, course, request):
    """On the line, on the circle, with the other two vehicles: the last 20 of 100 s, all four followers."""
    fixture = {
        "line": "first_simulation",
        "circle": "second_simulation",
        "tractor_trailer": "third_simulation",
        "differential": "differential_simulation",
    }
    simulation = request.getfixturevalue(fixture[course])(
        law=load(name), gains=SETTLING[course].get(name), noise=1e-3, seed=3
    )
    states, leaders, _ = simulation.run(100 * SECOND)
    rms = simulation.last_rms(states, leaders, 20 * SECOND)
    slow = name in ("neural-adaptive-pid", "observer-pid")  # the slow pole of Lambda_1 = 0.05, and tails on a circle
    assert (rms[:, 0] < (0.25 if slow and course == "circle" else 0.1)).all()
    assert (rms[:, 1] < 1).all()


@pytest.mark.parametrize("drive", ["front_wheel", "rear_wheel"])
@ALL
def test_every_law_settles_with_other_drives(name, drive, first_simulation):
    simulation = first_simulation(law=load(name), gains=SETTLING["line"].get(name), drive=drive)
    states, leaders, _ = simulation.run(100 * SECOND)
    assert (simulation.last_rms(states, leaders, 20 * SECOND) < [0.1, 1]).all()


# The PID law is the paper's without network and robust term -----------------------------------------------


def test_observer_pid_is_the_papers_law_without_adaptation(first_simulation):
    """Equal to the last bit, as W = 0 and theta = 0 add nothing."""
    still = first_simulation(gains=NeuralAdaptivePidGains(gamma_w=0, theta_m=0))
    plain = first_simulation(law=ObserverPid)
    expected, _, told = still.run(10 * SECOND)
    found, _, plain_told = plain.run(10 * SECOND)
    np.testing.assert_array_equal(found, expected)
    for name in plain_told.dtype.names:
        np.testing.assert_array_equal(plain_told[name], told[name])
    assert not told["weight_norm"].any()


# Feedback linearisation ------------------------------------------------------------------------------------

CAR, TRACTOR, DIFFERENTIAL = CarLike(1.2), TractorTrailer(1.5, 0.15, 0.4), DifferentialDrive(0.15, 0.4)
MODELS = pytest.mark.parametrize(
    ("vehicle", "gains"),
    [
        (CAR, FeedbackLinearisationGains(K_0=(1, 2), K_1=(3, 2.5))),
        (TRACTOR, FeedbackLinearisationGains(**TRACTOR_TRAILER_MODEL, K_0=(1, 2), K_1=(3, 2.5))),
        (DIFFERENTIAL, FeedbackLinearisationGains(**DIFFERENTIAL_DRIVE_MODEL, K_0=(1, 2), K_1=(3, 2.5))),
    ],
    ids=["car_like", "tractor_trailer", "differential_drive"],
)


def situation(n, vehicle, seed=0):
    random = np.random.default_rng(seed)
    entries = len(vehicle.pose)
    pose = random.uniform([-6, -3, -0.6, -0.6], [-4, 3, 0.6, 0.6], (n, 4))[:, :entries]
    leader = Leader(np.array([1.0, 0.5, 0.3, 0.2])[:entries], np.array([0.4, -0.1]), np.array([0.1, 0.2]))
    q = range_bearing(pose, leader.pose, vehicle)
    return random, pose, leader, Desired(q + random.normal(0, 0.3, (n, 2)), *random.normal(0, 0.3, (2, n, 2)))


@MODELS
def test_feedback_linearisation_makes_the_error_of_10_linear(vehicle, gains):
    """Its torque, put into (10), gives q_ddot = q_d_ddot - K_1 epsilon_dot - K_0 epsilon."""
    random, pose, leader, desired = situation(50, vehicle)
    velocity = random.uniform(-0.5, 0.5, (50, 2))
    controller = FeedbackLinearisation(Team(vehicle, 50, 0.02), gains)
    controller.start(pose, leader, desired)
    torque = controller.step(pose, leader, desired, velocity)
    told = controller.telemetry()
    reduced = ReducedDynamics.of_vehicle(vehicle, gains)
    R, delta = formation_rates(pose, leader.pose, leader.velocity[0], vehicle)
    q = range_bearing(pose, leader.pose, vehicle)
    for i in range(50):
        q_dot = R[i] @ velocity[i] + delta[i]
        np.testing.assert_allclose([told["range_rate"][i], told["bearing_rate"][i]], q_dot, atol=1e-12)
        model = formation_model(pose[i], leader, q_dot, vehicle, reduced, exact=True)
        wanted = desired.q_ddot[i] - np.multiply(gains.K_1, q_dot - desired.q_dot[i])
        wanted -= np.multiply(gains.K_0, q[i] - desired.q[i])
        np.testing.assert_allclose(model.acceleration(q_dot, torque[i]), wanted, atol=1e-8)


def test_feedback_linearisation_asks_for_velocities():
    _, pose, leader, desired = situation(2, CAR)
    controller = FeedbackLinearisation(Team(CAR, 2, 0.02))
    assert controller.needs == ("velocity",)
    controller.start(pose, leader, desired)
    with pytest.raises(ControllerError, match="FeedbackLinearisation needs the measured velocities"):
        controller.step(pose, leader, desired)
    with pytest.raises(ControllerError, match=r"velocity has shape \(2,\): expected \(2, 2\)"):
        controller.step(pose, leader, desired, np.zeros(2))
    with pytest.raises(ControllerError, match="robot 1: velocity component omega is nan") as caught:
        controller.step(pose, leader, desired, [[0, 0], [0, math.nan]])
    assert caught.value.robot == 1
    assert np.isfinite(controller.step(pose, leader, desired, np.zeros((2, 2)))).all()


@pytest.mark.parametrize("name", sorted(set(NAMES) - {"feedback-linearisation"}))
def test_other_laws_do_not_look_at_velocities(name):
    _, pose, leader, desired = situation(2, CAR)
    assert load(name).needs == ()
    torques = []
    for velocity in (None, np.full((2, 2), math.nan)):
        controller = load(name)(Team(CAR, 2, 0.02))
        controller.start(pose, leader, desired)
        torques.append(controller.step(pose, leader, desired, velocity))
    np.testing.assert_array_equal(*torques)


# The comparator --------------------------------------------------------------------------------------------


def test_one_tick_of_the_comparator_is_58_and_59_in_matrix_form():
    vehicle, n, h = TRACTOR, 30, 0.02
    random, pose, leader, desired = situation(n, vehicle, seed=5)
    g = NeuralHighGainGains(K_1=(0.6, 0.8), K_2=(60, 50), Gamma=3, sigma=0.2, epsilon=0.1, gamma_1=1.5)
    controller = NeuralHighGain(Team(vehicle, n, h), g)
    controller.start(pose, leader, desired)
    state = {name: random.normal(size=value.shape) for name, value in controller.get_state().items()}
    state["ticks"] = np.arange(n) % 3.0
    q = range_bearing(pose, leader.pose, vehicle)
    state["bearing"] = q[:, 1]
    controller.set_state(state)
    torque, after = controller.step(pose, leader, desired), controller.get_state()
    R, delta = formation_rates(pose, leader.pose, leader.velocity[0], vehicle)
    B2 = input_matrix(pose, vehicle)
    for i in range(n):
        own = {name: value[i] for name, value in state.items()}
        R_inverse, z_1 = np.linalg.inv(R[i]), q[i] - desired.q[i]
        alpha = R_inverse @ (desired.q_dot[i] - np.multiply(g.K_1, z_1) - delta[i])
        v_hat = R_inverse @ (own["pi_2"] / g.epsilon - delta[i])
        alpha_dot = (alpha - own["alpha_1"]) / h if own["ticks"] else np.zeros(2)  # at first there is no last one
        Z = np.concatenate([q[i], v_hat, alpha, alpha_dot])
        S = np.exp(-((Z - np.arange(-4, 5)[:, None]) ** 2).sum(axis=1) / 100)
        force = -R[i].T @ z_1 - np.multiply(g.K_2, v_hat - alpha) + own["Theta"] @ S
        np.testing.assert_allclose(torque[i], np.linalg.solve(B2[i], force), rtol=1e-9, atol=1e-9)
        Theta_dot = -g.Gamma * (np.outer(v_hat - alpha, S) + g.sigma * own["Theta"])
        np.testing.assert_allclose(after["Theta"][i], own["Theta"] + h * Theta_dot, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(after["pi_1"][i], own["pi_1"] + h / g.epsilon * own["pi_2"], rtol=1e-12)
        pi_2_dot = (-g.gamma_1 * own["pi_2"] - own["pi_1"] + q[i]) / g.epsilon
        np.testing.assert_allclose(after["pi_2"][i], own["pi_2"] + h * pi_2_dot, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("epsilon", "gamma_1"), [(0.005, 2.0), (0.02, 2.5), (0.1, 0.1)])
def test_a_high_gain_observer_that_the_period_makes_unstable_is_refused(epsilon, gamma_1):
    """And it would be: an eigenvalue of its Euler steps is not inside the unit circle."""
    with pytest.raises(GainError, match=r"robot 1: gain 'epsilon' is .* Euler steps of 0.02 s make the observer unst"):
        NeuralHighGain(
            Team(CAR, 2, 0.02), [NeuralHighGainGains(), NeuralHighGainGains(epsilon=epsilon, gamma_1=gamma_1)]
        )
    steps = np.eye(2) + 0.02 / epsilon * np.array([[0, 1], [-1, -gamma_1]])
    assert np.abs(np.linalg.eigvals(steps)).max() >= 1


# The linear-quadratic design -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("vehicle", "gains"),
    [
        (CAR, LqgGains()),
        (TRACTOR, LqgGains(**TRACTOR_TRAILER_MODEL)),
        (DIFFERENTIAL, LqgGains(**DIFFERENTIAL_DRIVE_MODEL)),
    ],
    ids=["car", "tractor", "differential"],
)
def test_the_linearisation_is_that_of_10(vehicle, gains):
    """epsilon_ddot of (10) against A and B, for small deviations from the straight motion."""
    rho, bearing = 3.0, 0.6
    A, B, _ = linearised(vehicle, gains, gains.v_0, rho, bearing)
    reduced = ReducedDynamics.of_vehicle(vehicle, gains)
    ahead = {CAR: 1.2, TRACTOR: 1.5, DIFFERENTIAL: 0.0}[vehicle]
    own = np.zeros(len(vehicle.pose))
    random = np.random.default_rng(2)
    for _ in range(20):
        x, u = 1e-5 * random.normal(size=4), 1e-5 * random.normal(size=2)
        q_1, q_2 = rho + x[0], bearing + x[1]
        leader = Leader(own.copy(), np.array([gains.v_0, 0]))
        leader.pose[:2] = ahead + q_1 * math.cos(q_2), q_1 * math.sin(q_2)
        model = formation_model(own, leader, x[2:], vehicle, reduced, exact=True)
        pace = np.linalg.solve(model.R.T, reduced.at(own)[1] @ [gains.v_0, 0])
        q_ddot = np.linalg.solve(model.M, u + pace - model.force(x[2:], np.zeros(2)))
        np.testing.assert_allclose(q_ddot, (A @ x + B @ u)[2:], atol=1e-8)


def test_the_design_is_stable_and_its_filter_too():
    _, pose, leader, desired = situation(8, CAR)
    controller = Lqg(Team(CAR, 8, 0.02))
    controller.start(pose, leader, desired)
    state, seen = controller.get_state(), np.eye(2, 4)
    for Phi, Gamma, K, L in zip(state["Phi"], state["Gamma"], state["K"], state["L"], strict=True):
        whole = np.block([[Phi, np.zeros((4, 2))], [0.02 * seen, np.eye(2)]]) - np.vstack([Gamma, np.zeros((2, 2))]) @ K
        assert np.abs(np.linalg.eigvals(whole)).max() < 1
        assert np.abs(np.linalg.eigvals(Phi @ (np.eye(4) - L @ seen))).max() < 1


def test_a_formation_without_a_design_is_refused_by_robot():
    _, pose, leader, desired = situation(2, CAR)
    controller = Lqg(Team(CAR, 2, 0.02))
    for wanted in ([3.0, math.pi / 2], [0.0, 0.5]):
        with pytest.raises(ControllerError, match=r"robot 1: a range of .* is singular, \(8\)"):
            controller.start(pose, leader, desired._replace(q=np.array([[3.0, 0.5], wanted])))


# Singularities ---------------------------------------------------------------------------------------------

AT_REST = Desired(np.array([[3.0, 0.5]]), np.zeros((1, 2)), np.zeros((1, 2)))
PLACES = pytest.mark.parametrize(
    ("signal", "vehicle"),
    [
        *((signal, CAR) for signal in ("relative_range", "cos_bearing", "cos_steering", "drive_gain")),
        *((signal, TRACTOR) for signal in ("relative_range", "cos_bearing", "cos_steering")),  # whose gain has no zero
        *((signal, DIFFERENTIAL) for signal in ("relative_range", "cos_bearing")),  # and nothing of this one steers
    ],
    ids=lambda value: getattr(value, "kind", value),
)
NEAR = (-1e-3, -1e-9, 0.0, 1e-9, 1e-3)
"""Distances from a singularity [m] or [rad]; at zero, the cosines are not zero in floating point but 6e-17."""


def beside(signal, vehicle, distance):
    """Return poses of a follower and of the leader at this distance from where the signal is zero."""
    if vehicle is DIFFERENTIAL:
        return {
            "relative_range": ([-distance, 0, 0], [0, 0, 0]),
            "cos_bearing": ([0, 0, distance], [0, 2, 0]),
        }[signal]
    length = 1.2 if vehicle is CAR else 1.5
    return {
        "relative_range": ([-distance, 0, 0, 0], [length, 0, 0, 0]),
        "cos_bearing": ([0, 0, 0, distance], [length, 2, 0, 0]),
        "cos_steering": ([0, 0, 0, math.pi / 2 - distance], [5, 1, 0, 0]),  # at this heading all laws blow up
        "drive_gain": ([0, 0, -math.pi / 4, math.atan(math.sqrt(2)) - distance], [5, 0, 0, 0]),
    }[signal]


def first_torque(law, vehicle, poses, **gains):
    """Return the first torque or its error, and the controller."""
    pose, leader_pose = poses
    controller = law(Team(vehicle, 1, 0.02), law.gains_type(**gains))
    leader = Leader(np.array(leader_pose, dtype=float), np.array([0.3, 0.0]))
    controller.start(np.array([pose]), leader, AT_REST)
    try:
        return controller.step(np.array([pose]), leader, AT_REST, np.array([[0.2, 0.1]])), controller
    except ControllerError as refusal:
        return refusal, controller


def told(controller, signal):
    return float(controller.telemetry()[signal][0])


def expected(signal, vehicle, distance):
    """Return the signal's value there, written anew from its definition."""
    if signal == "relative_range":
        return abs(distance) / {CAR: 1.2, TRACTOR: 1.5, DIFFERENTIAL: 0.4}[vehicle]
    if signal == "drive_gain":
        return 1 - math.tan(math.atan(math.sqrt(2)) - distance) / math.sqrt(2)
    return math.sin(distance)


@PLACES
@ALL
def test_without_a_guard_a_torque_is_finite_or_refused_by_name_and_the_telemetry_tells(name, signal, vehicle):
    """At singularities and near them; only a range of zero and a drive gain of zero are zero in floating point."""
    (stated,) = (s for s in load(name).signals if s.name == signal)
    for distance in NEAR:
        torque, controller = first_torque(load(name), vehicle, beside(signal, vehicle, distance))
        value = told(controller, signal)
        assert value == pytest.approx(expected(signal, vehicle, distance), rel=1e-6, abs=1e-15)
        assert abs(value) < stated.singular_below
        assert told(controller, "guarded") == 0
        assert isinstance(torque, ControllerError) == (value == 0)
        if value == 0:
            assert str(torque).startswith("robot 0: the torque is not finite, at ")
            assert str(torque).endswith(f"; {signal} is near zero, where {stated.singular_at_zero}")
            assert torque.robot == 0
        else:
            assert np.isfinite(torque).all()
    assert expected(signal, vehicle, 0.0) == pytest.approx(0, abs=1e-15)
    if signal != "relative_range":  # whose sign never changes
        first, second = (first_torque(load(name), vehicle, beside(signal, vehicle, d))[1] for d in (-1e-9, 1e-9))
        assert told(first, signal) < 0 < told(second, signal)


@PLACES
@ALL
def test_a_guard_bounds_the_torque_at_every_singularity_and_tells(name, signal, vehicle):
    """The telemetry shows the robot's true distance from a singularity, not the guarded one."""
    for distance in NEAR:
        torque, controller = first_torque(load(name), vehicle, beside(signal, vehicle, distance), guard=0.1)
        assert np.abs(torque).max() < 1e3
        assert told(controller, "guarded") == 1
        assert told(controller, signal) == pytest.approx(expected(signal, vehicle, distance), rel=1e-6, abs=1e-15)


@pytest.mark.parametrize("vehicle", [CAR, TRACTOR, CarLike(0.4)], ids=["car", "tractor", "short"])
@ALL
def test_the_guard_of_the_range_is_a_share_of_the_length(name, vehicle):
    """Just within it and just beyond."""
    length = vehicle.hitch_length if vehicle is TRACTOR else vehicle.wheelbase
    for share, guarded in ((0.49, 1), (0.51, 0)):
        _, controller = first_torque(load(name), vehicle, ([-share * length, 0, 0, 0], [length, 0, 0, 0]), guard=0.5)
        assert told(controller, "relative_range") == pytest.approx(share)
        assert told(controller, "guarded") == guarded


@ALL
def test_both_cosines_are_told_of_the_measured_angles_where_the_guard_turns_the_steering(name):
    pose, leader_pose = [0, 0, 0.2, 1.4], [5, 3, 0, 0]
    _, controller = first_torque(load(name), CAR, (pose, leader_pose), guard=0.5)
    assert told(controller, "guarded") == 1
    assert told(controller, "cos_steering") == pytest.approx(math.cos(1.4))
    assert told(controller, "cos_bearing") == pytest.approx(math.cos(range_bearing(pose, leader_pose, CAR)[1]))


@PLACES
@ALL
def test_a_guard_leaves_the_rest_of_the_world_as_it_is(name, signal, vehicle):
    """Well away from singularities, to the last bit; and no signal is near zero."""
    away = beside(signal, vehicle, 0.5)
    literal, _ = first_torque(load(name), vehicle, away)
    torque, controller = first_torque(load(name), vehicle, away, guard=0.05)
    assert told(controller, "guarded") == 0
    np.testing.assert_array_equal(torque, literal)
    for stated in load(name).signals:
        assert not np.any(np.abs(controller.telemetry()[stated.name]) < stated.singular_below), stated.name


@pytest.mark.parametrize("radius", [0.15, 20.0])
@ALL
def test_the_drive_gain_of_a_tractor_trailer_has_no_unit_and_needs_no_guard(name, radius):
    """It is 1/cos(theta_0 - theta_1) whatever the wheels, and never below 1: no guard touches it."""
    vehicle, poses = TractorTrailer(1.5, radius, 0.4), ([0, 0, 0.3, 0.7], [5, 1, 0.1, 0.2])
    literal, _ = first_torque(load(name), vehicle, poses)
    torque, controller = first_torque(load(name), vehicle, poses, guard=0.5)
    assert told(controller, "drive_gain") == pytest.approx(1 / math.cos(0.4), rel=1e-14)
    assert told(controller, "guarded") == 0
    np.testing.assert_array_equal(torque, literal)


@ALL
def test_every_law_tells_how_near_each_singularity_is(name):
    """Each signal once: det R is one cosine over the other; a law also divides by drive gain and range."""
    flagged = {s.name: s.singular_below for s in load(name).signals if s.singular_at_zero}
    assert flagged == dict.fromkeys(("drive_gain", "relative_range", "cos_bearing", "cos_steering"), singularities.NEAR)


# Saturation ------------------------------------------------------------------------------------------------

HOLDING = sorted(set(NAMES) - {"feedback-linearisation"})


@pytest.mark.parametrize("name", HOLDING)
def test_integrals_and_adaptation_wait_for_saturated_actuators(name):
    _, pose, leader, desired = situation(4, CAR)
    waiting = {"epsilon_hat_integral", "epsilon_q_tilde_integral", "W", "theta", "Theta", "integral"}
    changes = {}
    for limit in (1e-9, math.inf):
        law = load(name)
        controller = law(Team(CAR, 4, 0.02), law.gains_type(torque_limit=limit))
        controller.start(pose, leader, desired)
        for _ in range(3):
            before = controller.get_state()
            torque = controller.step(pose, leader, desired)
        after = controller.get_state()
        changes[limit] = {s for s in before if (before[s] != after[s]).any(axis=tuple(range(1, before[s].ndim))).all()}
        assert (controller.telemetry()["held"] == (np.abs(torque) > limit).any(axis=1)).all()
    assert not changes[1e-9] & waiting
    assert changes[math.inf] - changes[1e-9] == waiting & set(before)
    assert changes[1e-9], "the observer goes on"


def test_a_torque_limit_that_is_never_reached_changes_no_bit(first_simulation):
    literal, _, _ = first_simulation().run(5 * SECOND)
    limited, _, told = first_simulation(gains=NeuralAdaptivePidGains(torque_limit=1e9)).run(5 * SECOND)
    np.testing.assert_array_equal(limited, literal)
    assert not told["held"].any()


def test_weights_stand_still_exactly_while_a_torque_is_beyond_its_limit(first_simulation):
    _, _, told = first_simulation(gains=NeuralAdaptivePidGains(torque_limit=50.0)).run(5 * SECOND)
    held = told["held"].astype(bool)
    assert held.any()
    assert (held == (np.abs(told["torque_command"]) > 50).any(axis=-1)).all()
    moved = np.diff(told["weight_norm"], axis=0) != 0
    assert not moved[held[:-1]].any()
    assert moved[~held[:-1]].any()


# Plain Python ----------------------------------------------------------------------------------------------


@contextmanager
def second_package(disable_jit):
    """Import package and simulations a second time, as plain Python or compiled, beside the ones that are loaded."""

    def ours():
        return {name: module for name, module in sys.modules.items() if name.split(".")[0] == PACKAGE}

    first = ours()
    spec = importlib.util.spec_from_file_location("second_conftest", Path(__file__).with_name("conftest.py"))
    simulations = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numba.config, "DISABLE_JIT", disable_jit)
        patch.setitem(sys.modules, spec.name, simulations)
        for name in first:
            del sys.modules[name]
        try:
            spec.loader.exec_module(simulations)
            yield simulations
        finally:
            for name in ours():
                del sys.modules[name]
            sys.modules.update(first)


def test_plain_python_gives_the_same_bits(
    first_simulation, second_simulation, third_simulation, differential_simulation, bits_of_a_run
):
    """The same formulas uncompiled: not a bit differs after 2 s, in any law."""
    courses = first_simulation, second_simulation, third_simulation, differential_simulation
    compiled = [bits_of_a_run(name, course) for name in NAMES for course in courses]
    with second_package(1 - numba.config.DISABLE_JIT) as other:  # what this process is not
        assert (type(other.euler) is FunctionType) == bool(numba.config.DISABLE_JIT)
        courses = other.FirstSimulation, other.SecondSimulation, other.ThirdSimulation, other.DifferentialSimulation
        found = [other.bits(name, course) for name in NAMES for course in courses]
    assert found == compiled


# The start ---------------------------------------------------------------------------------------------------


@ALL
def test_the_compiled_start_sets_what_start_does(name):
    for vehicle in (CarLike(1.2), DifferentialDrive(0.1, 0.25)):
        _, pose, leader, desired = situation(5, vehicle)
        controller = load(name)(Team(vehicle, 5, 0.02))
        controller.start(pose, leader, desired)
        expected = controller.to_bytes()
        q = first_range_bearing(pose, leader.pose, desired.q, vehicle)
        assert controller.get_state()["bearing"].tobytes() == q[:, 1].tobytes()

        function, own, prepared = controller.compiled_start()
        for field in own.state.dtype.names:
            if field not in prepared:
                own.state[field] = 0.0
        velocity = np.full((5, len(vehicle.velocity)), np.nan)
        function(TickInputs(pose, velocity, leader.pose, leader.velocity, np.zeros(2), *desired), own)
        assert controller.to_bytes() == expected


def test_a_law_may_still_start_in_python():
    class Older(load("observer-pid")):
        def start_states(self, q, desired):
            super().start_states(q, desired)
            self._state["p"] = 2 * q

    _, pose, leader, desired = situation(3, CAR)
    older = Older(Team(CAR, 3, 0.02))
    older.start(pose, leader, desired)
    state, q = older.get_state(), first_range_bearing(pose, leader.pose, desired.q, CAR)
    assert np.array_equal(state["q_hat"], q)
    assert np.array_equal(state["p"], 2 * q)
    assert older.compiled_start() is None


def other(kind, *names):
    """Return a law whose methods of these names are its own, though they do as those of the law do."""

    def same(name):
        def method(self, *arguments):
            return getattr(super(law, self), name)(*arguments)

        return property(method) if name == "telemetry_record" else method

    law = type("Other", (kind,), {name: same(name) for name in names})
    return law(Team(CAR, 2, 0.02))


@pytest.mark.parametrize("kind", [ObserverPid, NeuralAdaptivePid, Lqg])
def test_a_law_that_starts_or_steps_otherwise_is_not_called_as_the_law_it_derives_from(kind):
    for name in ("start", "on_start", "start_states", "_clear"):
        assert other(kind, name).compiled_start() is None, name
        assert other(kind, name).compiled_tick() is not None
    for name in ("step", "on_step", "telemetry_record", "_checked_velocity"):
        assert other(kind, name).compiled_tick() is None, name
        assert other(kind, name).compiled_start() is not None
    for name in ("_checked", "_inputs"):
        assert other(kind, name).compiled_tick() is None, name
        assert other(kind, name).compiled_start() is None
    plain = other(kind, "reset", "copy", "to_bytes")
    assert plain.compiled_tick() is not None
    assert plain.compiled_start().prepared == kind.prepared
    for name in ("step", "start"):
        setattr(plain, name, getattr(plain, name))
    assert plain.compiled_tick() is None
    assert plain.compiled_start() is None


def test_a_law_with_other_prepared_states_prepares_them_itself():
    class Preparing(Lqg):
        prepared = (*Lqg.prepared, "integral")

        def on_start(self, pose, leader, desired):
            super().on_start(pose, leader, desired)
            self._state["integral"] = 0.5

    class Stating(Lqg):
        prepared = (*Lqg.prepared, "integral")

    class Mixing(Preparing):
        prepared = Lqg.prepared

    team = Team(CAR, 2, 0.02)
    assert Preparing(team).compiled_start().prepared == Preparing.prepared
    assert Stating(team).compiled_start() is None
    assert Mixing(team).compiled_start() is None


def test_a_law_that_begins_otherwise_is_called_as_it_begins():
    class Beginning(ObserverPid):
        @staticmethod
        def begin(inputs, team):
            ObserverPid.begin(inputs, team)
            team.state["p"][:] = 0.25

    _, pose, leader, desired = situation(2, CAR)
    law = Beginning(Team(CAR, 2, 0.02))
    law.start(pose, leader, desired)
    assert (law.get_state()["p"] == 0.25).all()
    assert law.compiled_start().function is Beginning.begin


# An older controller ---------------------------------------------------------------------------------------


def test_a_law_that_reads_one_set_of_gains_refuses_many():
    class Older(Controller):
        interface, vehicles, gains_type, signals = "1.0", ("car_like",), ObserverPidGains, ()

        def state_shapes(self):
            return {"nothing": ()}

        def on_start(self, pose, leader, desired):
            pass

        def on_step(self, pose, leader, desired):
            return self.gains.k_d * np.ones((self.team.size, 2))

    _, pose, leader, desired = situation(2, CAR)
    for gains, fits in (([ObserverPidGains()] * 2, True), ([ObserverPidGains(), ObserverPidGains(k_d=7)], False)):
        controller = Older(Team(CAR, 2, 0.02), gains)
        controller.start(pose, leader, desired)
        if fits:
            assert controller.step(pose, leader, desired).tolist() == [[10, 10]] * 2
        else:
            with pytest.raises(GainError, match="the followers of this Older have gains of their own"):
                controller.step(pose, leader, desired)


def test_every_law_is_the_one_named():
    laws = [FeedbackLinearisation, Lqg, NeuralAdaptivePid, NeuralHighGain, ObserverPid]
    assert [load(name) for name in NAMES] == laws
