"""The reduced dynamics of both vehicles and the formation model (9), (10) with its Properties 1 to 4."""

from __future__ import annotations

import math

import numpy as np
import pytest
from formation_controllers import CarLike, ControllerError, DifferentialDrive, Leader, TractorTrailer
from formation_controllers.analysis.formation_model import ReducedDynamics, formation_model
from formation_controllers.dynamics import TRACTOR_TRAILER_MODEL, ModelGains
from formation_controllers.geometry import formation_rates, range_bearing

POINTS = 60


class CarPlant:
    """(56) as printed, with the motion basis of (2)."""

    vehicle, model = CarLike(1.2), ModelGains()
    a, m_c, I_c, I_f, l_c = 1.2, 30.0, 5.0, 10.0, 0.55

    def S(self, eta):
        return np.array([[math.cos(eta[2]), 0], [math.sin(eta[2]), 0], [math.tan(eta[3]) / self.a, 0], [0, 1]])

    def M1(self, eta):
        s, c, ml = math.sin(eta[2]), math.cos(eta[2]), self.m_c * self.l_c
        return np.array(
            [
                [self.m_c, 0, -ml * s, 0],
                [0, self.m_c, ml * c, 0],
                [-ml * s, ml * c, self.I_c + self.I_f, self.I_f],
                [0, 0, self.I_f, self.I_f],
            ]
        )

    def C1_eta_dot(self, eta, eta_dot):
        ml = self.m_c * self.l_c
        return np.array([-ml * eta_dot[2] ** 2 * math.cos(eta[2]), -ml * eta_dot[2] ** 2 * math.sin(eta[2]), 0, 0])

    def B1(self, eta):
        s = math.sin(eta[2])
        return np.array([[math.cos(eta[2]), 0], [s, 0], [self.a * s, 0], [0, 1]])


class TractorPlant:
    """(57) as printed, with the motion basis of section 4."""

    vehicle, model = TractorTrailer(1.5, 0.15, 0.4), ModelGains(**TRACTOR_TRAILER_MODEL)
    d, m_0, m_1, I_0, I_1, r, b, a_0, a_1 = 1.5, 15.0, 15.0, 2.0, 2.0, 0.15, 0.4, 0.15, 0.05

    def S(self, eta):
        turn = math.tan(eta[3] - eta[2]) / self.d
        return np.array([[math.cos(eta[2]), 0], [math.sin(eta[2]), 0], [turn, 0], [0, 1]])

    def M1(self, eta):
        M, L, k = self.m_0 + self.m_1, self.a_1 * self.m_1 + self.d * self.m_0, self.a_0 * self.m_0
        upper = np.array(
            [
                [M, 0, -L * math.sin(eta[2]), -k * math.sin(eta[3])],
                [0, M, L * math.cos(eta[2]), k * math.cos(eta[3])],
                [
                    0,
                    0,
                    self.m_1 * self.a_1**2 + self.m_0 * self.d**2 + self.I_1,
                    k * self.d * math.cos(eta[3] - eta[2]),
                ],
                [0, 0, 0, self.m_0 * self.a_0**2 + self.I_0],
            ]
        )
        return upper + np.triu(upper, 1).T

    def C1_eta_dot(self, eta, eta_dot):
        L, k = self.a_1 * self.m_1 + self.d * self.m_0, self.a_0 * self.m_0
        _, _, w_1, w_0 = eta_dot
        swing = k * self.d * math.sin(eta[3] - eta[2])
        return np.array(
            [
                -k * math.cos(eta[3]) * w_0**2 - L * math.cos(eta[2]) * w_1**2,
                -k * math.sin(eta[3]) * w_0**2 - L * math.sin(eta[2]) * w_1**2,
                -swing * w_0**2,
                swing * w_1**2,
            ]
        )

    def B1(self, eta):
        row = np.array([math.cos(eta[3]), math.sin(eta[3]), self.d * math.sin(eta[3] - eta[2])])
        return np.column_stack([np.append(row, self.b), np.append(row, -self.b)]) / self.r


class DifferentialPlant:
    """Two driven wheels on an axle, the centre of mass c ahead of it, by Lagrange's equations."""

    vehicle = DifferentialDrive(0.15, 0.4)
    m, I, r, b, c = 15.0, 2.0, 0.15, 0.4, 0.15  # noqa: E741 (the usual letter)
    model = ModelGains(m=m, I_2=I + m * c**2, S_0=m * c)

    def S(self, eta):
        return np.array([[math.cos(eta[2]), 0], [math.sin(eta[2]), 0], [0, 1]])

    def M1(self, eta):
        s, c, mc = math.sin(eta[2]), math.cos(eta[2]), self.m * self.c
        return np.array([[self.m, 0, -mc * s], [0, self.m, mc * c], [-mc * s, mc * c, self.I + mc * self.c]])

    def C1_eta_dot(self, eta, eta_dot):
        pull = self.m * self.c * eta_dot[2] ** 2
        return np.array([-pull * math.cos(eta[2]), -pull * math.sin(eta[2]), 0])

    def B1(self, eta):
        row = [math.cos(eta[2]), math.sin(eta[2])]
        return np.column_stack([[*row, self.b], [*row, -self.b]]) / self.r


PLANTS = pytest.mark.parametrize(
    "plant", [CarPlant(), TractorPlant(), DifferentialPlant()], ids=lambda plant: plant.vehicle.kind
)


def reduced(plant, eta, v):
    """M2, C2 v, D2 v and B2 of (3), from (1) and (2), the rate of S by differences."""
    S, eps = plant.S(eta), 1e-6
    eta_dot = S @ v
    S_dot = (plant.S(eta + eps * eta_dot) - plant.S(eta - eps * eta_dot)) / (2 * eps)
    coriolis = S.T @ (plant.M1(eta) @ S_dot @ v + plant.C1_eta_dot(eta, eta_dot))
    return S.T @ plant.M1(eta) @ S, coriolis, 25.0 * S.T @ S @ v, S.T @ plant.B1(eta)


def situations(plant, seed=0):
    """Random poses, leaders and rates, away from the singularities."""
    random = np.random.default_rng(seed)
    found = 0
    while found < POINTS:
        pose, leader_pose = random.uniform([-5, -5, -3, -0.8], [5, 5, 3, 0.8], (2, 4))
        if isinstance(plant, TractorPlant):
            pose[3] += pose[2]
            leader_pose[3] += leader_pose[2]
        pose, leader_pose = (entries[: len(plant.vehicle.pose)] for entries in (pose, leader_pose))
        rho, bearing = range_bearing(pose, leader_pose, plant.vehicle)
        if rho < 1 or abs(math.cos(bearing)) < 0.3:
            continue
        found += 1
        yield pose, Leader(leader_pose, *random.uniform(-1, 1, (2, 2))), random.uniform(-1, 1, 2), random


@PLANTS
def test_dynamics_are_the_reduction_of_those_printed(plant):
    dynamics = ReducedDynamics.of_vehicle(plant.vehicle, plant.model)
    for pose, _, v, _ in situations(plant):
        inertia, coriolis, damping, inputs = reduced(plant, pose, v)
        M2, D2, B2 = dynamics.at(pose)
        np.testing.assert_allclose(M2, inertia, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(dynamics.C2(pose, v) @ v, coriolis, atol=1e-7)
        np.testing.assert_allclose(D2 @ v, damping, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(B2, inputs, rtol=1e-12, atol=1e-12)


def acceleration_of_q(plant, pose, leader, v, tau):
    """q_ddot of the plant under a torque: (3), and the rate of (8) along the motion by central differences."""
    inertia, coriolis, damping, inputs = reduced(plant, pose, v)
    v_dot = np.linalg.solve(inertia, inputs @ tau - coriolis - damping)
    eps, rates = 1e-5, []
    for t in (-eps, eps):
        # one midpoint step: of second order, as the difference is
        own = pose + t * plant.S(pose + t / 2 * plant.S(pose) @ v) @ (v + t / 2 * v_dot)
        middle = leader.pose + t / 2 * plant.S(leader.pose) @ leader.velocity
        other = leader.pose + t * plant.S(middle) @ (leader.velocity + t / 2 * leader.acceleration)
        R, delta = formation_rates(own, other, leader.velocity[0] + t * leader.acceleration[0], plant.vehicle)
        rates.append(R @ (v + t * v_dot) + delta)
    return (rates[1] - rates[0]) / (2 * eps)


@PLANTS
@pytest.mark.parametrize("how", ["exact", "symmetrised"])
def test_the_model_is_the_plant_in_other_coordinates(plant, how):
    """(10) against the plant's own equations transformed numerically."""
    dynamics = ReducedDynamics.of_vehicle(plant.vehicle, plant.model)
    if how == "symmetrised":
        dynamics = dynamics.symmetrised()
    for pose, leader, v, random in situations(plant):
        tau = random.uniform(-20, 20, 2)
        R, delta = formation_rates(pose, leader.pose, leader.velocity[0], plant.vehicle)
        q_dot = R @ v + delta
        model = formation_model(pose, leader, q_dot, plant.vehicle, dynamics, exact=how == "exact")
        np.testing.assert_allclose(model.velocity, v, atol=1e-12)
        expected = acceleration_of_q(plant, pose, leader, v, tau)
        found = model.acceleration(q_dot, tau)
        np.testing.assert_allclose(found, expected, atol=1e-5 * (1 + np.abs(expected).max()))
        np.testing.assert_allclose(model.force(q_dot, found), model.B @ tau, atol=1e-9 * (1 + np.abs(model.B).max()))


@PLANTS
def test_as_printed_the_model_is_exact_only_where_the_leader_rests(plant):
    """Without Property 2.2 the printed D_bar and f leave C2(a) b - C2(b) a, with a = R^-1 q_dot, b = R^-1 delta."""
    dynamics = ReducedDynamics.of_vehicle(plant.vehicle, plant.model)
    worst = 0.0
    for pose, leader, v, random in situations(plant):
        tau = random.uniform(-20, 20, 2)
        for told in (leader, leader._replace(velocity=np.zeros(2), acceleration=np.zeros(2))):
            R, delta = formation_rates(pose, told.pose, told.velocity[0], plant.vehicle)
            q_dot = R @ v + delta
            model = formation_model(pose, told, q_dot, plant.vehicle, dynamics)
            expected = acceleration_of_q(plant, pose, told, v, tau)
            wrong = model.force(q_dot, expected) - model.B @ tau
            a, b = np.linalg.solve(R, q_dot), np.linalg.solve(R, delta)
            gap = np.linalg.solve(R.T, dynamics.C2(pose, a) @ b - dynamics.C2(pose, b) @ a)
            np.testing.assert_allclose(wrong, gap, atol=1e-5 * (1 + np.abs(model.M @ expected).max()))
            if not told.velocity.any():
                assert not gap.any()
            worst = max(worst, np.abs(gap).max())
    assert worst > 1.0  # N: no rounding error


@PLANTS
def test_property_1_m_is_symmetric_and_positive_definite(plant):
    dynamics = ReducedDynamics.of_vehicle(plant.vehicle, plant.model)
    for pose, leader, q_dot, _ in situations(plant):
        M = formation_model(pose, leader, q_dot, plant.vehicle, dynamics).M
        np.testing.assert_allclose(M, M.T, rtol=1e-12)
        assert np.linalg.eigvalsh(M).min() > 0


def m_dot(plant, pose, leader, v):
    """Rate of M along the motion, by central differences."""
    dynamics = ReducedDynamics.of_vehicle(plant.vehicle, plant.model)
    ends, eps = [], 1e-6
    for t in (-eps, eps):
        other = leader._replace(pose=leader.pose + t * plant.S(leader.pose) @ leader.velocity)
        ends.append(formation_model(pose + t * plant.S(pose) @ v, other, np.zeros(2), plant.vehicle, dynamics).M)
    return (ends[1] - ends[0]) / (2 * eps)


@PLANTS
def test_property_2_1_holds_while_the_leader_rests_and_else_misses_c2_of_the_leaders_share(plant):
    dynamics = ReducedDynamics.of_vehicle(plant.vehicle, plant.model)
    missed = 0.0
    for pose, moving, v, random in situations(plant):
        x = random.normal(size=2)
        for leader in (moving, moving._replace(velocity=np.zeros(2))):
            R, delta = formation_rates(pose, leader.pose, leader.velocity[0], plant.vehicle)
            model = formation_model(pose, leader, R @ v + delta, plant.vehicle, dynamics)
            form = x @ (m_dot(plant, pose, leader, v) - 2 * model.C) @ x
            y, b = np.linalg.solve(R, x), np.linalg.solve(R, delta)
            leaders_share = -2 * y @ dynamics.C2(pose, b) @ y
            assert form == pytest.approx(leaders_share, abs=1e-4 * (1 + np.linalg.norm(model.C) * (x @ x)))
            if leader is not moving:
                assert leaders_share == 0
            missed = max(missed, abs(leaders_share))
    if isinstance(plant, DifferentialPlant):  # C2 is skew itself
        assert missed < 1e-12
    else:
        assert missed > 1.0


@PLANTS
def test_m2_dot_less_twice_c2_is_skew(plant):
    dynamics = ReducedDynamics.of_vehicle(plant.vehicle, plant.model)
    eps = 1e-6
    for pose, _, v, random in situations(plant):
        x, step = random.normal(size=2), eps * plant.S(pose) @ v
        M2_dot = (dynamics.at(pose + step)[0] - dynamics.at(pose - step)[0]) / (2 * eps)
        assert x @ (M2_dot - 2 * dynamics.C2(pose, v)) @ x == pytest.approx(0, abs=1e-5)


@PLANTS
def test_property_2_2_fails_for_c2_and_holds_for_its_symmetric_part_which_loses_property_2_1(plant):
    dynamics = ReducedDynamics.of_vehicle(plant.vehicle, plant.model)
    symmetric = dynamics.symmetrised()
    asymmetry = skewness = 0.0
    eps = 1e-6
    for pose, _, v, random in situations(plant):
        x, y = random.normal(size=(2, 2))
        asymmetry = max(asymmetry, np.abs(dynamics.C2(pose, x) @ y - dynamics.C2(pose, y) @ x).max())
        np.testing.assert_allclose(symmetric.C2(pose, x) @ y, symmetric.C2(pose, y) @ x, atol=1e-12)
        np.testing.assert_allclose(symmetric.C2(pose, x) @ x, dynamics.C2(pose, x) @ x, atol=1e-12)
        step = eps * plant.S(pose) @ v
        M2_dot = (dynamics.at(pose + step)[0] - dynamics.at(pose - step)[0]) / (2 * eps)
        skewness = max(skewness, abs(x @ (M2_dot - 2 * symmetric.C2(pose, v)) @ x))
    assert asymmetry > 1.0
    assert skewness > 1.0


@PLANTS
def test_properties_2_3_and_2_4_c2_is_linear_and_bounded(plant):
    """Of C2; the term with R_dot in C is affine in q_dot once the leader moves, linear while it rests."""
    dynamics = ReducedDynamics.of_vehicle(plant.vehicle, plant.model)
    for pose, leader, x_1, random in situations(plant):
        x_2, y = random.normal(size=(2, 2))
        together, apart = dynamics.C2(pose, x_1 + x_2) @ y, (dynamics.C2(pose, x_1) + dynamics.C2(pose, x_2)) @ y
        np.testing.assert_allclose(together, apart, atol=1e-12)
        bound = np.linalg.norm([dynamics.C2(pose, axis) for axis in np.eye(2)])  # of the trilinear form
        assert np.linalg.norm(dynamics.C2(pose, x_1) @ x_2) <= bound * np.linalg.norm(x_1) * np.linalg.norm(x_2)

        def C(q_dot, told):
            return formation_model(pose, told, q_dot, plant.vehicle, dynamics).C  # noqa: B023

        for told, linear in ((leader._replace(velocity=np.zeros(2)), True), (leader, False)):
            rest = C(np.zeros(2), told)
            np.testing.assert_allclose(C(x_1 + x_2, told) + rest, C(x_1, told) + C(x_2, told), atol=1e-8)
            linear = linear or isinstance(plant, DifferentialPlant)  # whose R depends on range and bearing alone
            assert (np.abs(rest).max() < 1e-12) == linear


@PLANTS
def test_properties_3_and_4_damping_is_positive_definite_and_disturbances_are_bounded(plant):
    dynamics = ReducedDynamics.of_vehicle(plant.vehicle, plant.model)
    for pose, leader, q_dot, random in situations(plant):
        model = formation_model(pose, leader, q_dot, plant.vehicle, dynamics)
        np.testing.assert_allclose(model.D, model.D.T, rtol=1e-12)
        assert np.linalg.eigvalsh(model.D).min() > 0
        tau_d2 = random.uniform(-1, 1, 2)
        smallest = np.linalg.svd(model.R, compute_uv=False)[-1]
        assert np.linalg.norm(np.linalg.solve(model.R.T, tau_d2)) <= np.linalg.norm(tau_d2) / smallest * (1 + 1e-12)


def test_constant_matrices_will_do():
    """A point mass of 2 kg and 3 kg.m2 without damping: (10) with constant M2, B2 and no C2, D2."""
    leader, q_dot = Leader(np.array([4.0, 1.0, 0.2, 0.0]), np.array([0.3, 0.0])), np.array([0.1, -0.2])
    matrices = ReducedDynamics(np.diag([2.0, 3.0]), np.zeros((2, 2)), np.zeros((2, 2)), np.eye(2))
    model = formation_model(np.zeros(4), leader, q_dot, CarLike(1.2), matrices)
    R_inverse = np.linalg.inv(model.R)
    np.testing.assert_allclose(model.M, R_inverse.T @ np.diag([2.0, 3.0]) @ R_inverse)
    np.testing.assert_allclose(model.B, R_inverse.T)
    assert not model.D.any()


def test_what_is_singular_or_of_the_wrong_shape_is_refused():
    good = ReducedDynamics(np.eye(2), np.zeros((2, 2)), np.eye(2), np.eye(2))
    leader = Leader(np.array([4.0, 1.0, 0.2, 0.0]), np.zeros(2))
    with pytest.raises(ControllerError, match="singular at range 0 m"):
        formation_model([0, 0, 0, 0], leader._replace(pose=np.array([1.2, 0, 0, 0])), [0, 0], CarLike(1.2), good)
    abreast = leader._replace(pose=np.array([1.2, 3.0, 0, 0]))
    for steering in (0.0, 1e-12):
        with pytest.raises(ControllerError, match=r"singular at range 3 m and bearing 1.5708 rad"):
            formation_model([0, 0, 0, steering], abreast, [0, 0], CarLike(1.2), good)
    assert np.isfinite(formation_model([0, 0, 0, 1e-6], abreast, [0, 0], CarLike(1.2), good).M).all()
    with pytest.raises(ControllerError, match=r"pose has shape \(3,\): expected \(4,\)"):
        formation_model([0, 0, 0], leader, [0, 0], CarLike(1.2), good)
    bad = ReducedDynamics(np.eye(3), np.zeros((2, 2)), np.eye(2), np.eye(2))
    with pytest.raises(ControllerError, match=r"M2 has shape \(3, 3\): expected \(2, 2\)"):
        formation_model([0, 0, 0, 0], leader, [0, 0], CarLike(1.2), bad)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("name", "index", "message"),
    [
        ("pose", 2, "pose component psi is {}: expected a finite number"),
        ("q_dot", 1, "q_dot component bearing is {}: expected a finite number"),
        ("leader", 3, "the leader's pose component gamma is {}"),
        ("velocity", 1, "the leader's velocity component omega is {}"),
        ("acceleration", 0, "the leader's acceleration component v is {}"),
    ],
)
def test_numbers_that_are_not_finite_are_refused_by_name(name, index, message, value):
    reduced = ReducedDynamics.of_vehicle(CarLike(1.2))
    leader = {"leader": np.array([4.0, 1, 0, 0]), "velocity": np.zeros(2), "acceleration": np.zeros(2)}
    arrays = {"pose": np.zeros(4), "q_dot": np.zeros(2)} | leader
    arrays[name][index] = value
    told = Leader(*(arrays[part] for part in leader))
    with pytest.raises(ControllerError, match=message.format(value)):
        formation_model(arrays["pose"], told, arrays["q_dot"], CarLike(1.2), reduced)


def test_what_is_no_leader_no_vehicle_or_no_array_is_refused():
    reduced, leader = ReducedDynamics.of_vehicle(CarLike(1.2)), Leader(np.array([4.0, 1, 0, 0]), np.zeros(2))
    with pytest.raises(ControllerError, match="the leader is a tuple: expected a Leader"):
        formation_model(np.zeros(4), tuple(leader), np.zeros(2), CarLike(1.2), reduced)
    with pytest.raises(ControllerError, match="the vehicle is None: expected one that states its formation"):
        formation_model(np.zeros(4), leader, np.zeros(2), None, reduced)
    with pytest.raises(ControllerError, match="q_dot is not an array of numbers"):
        formation_model(np.zeros(4), leader, "fast", CarLike(1.2), reduced)
