"""The law, alone and in a closed loop with the plant's equations; found by name, as the package is installed."""

import numpy as np
import pytest
from formation_controllers import ControllerError, Desired, GainError, Leader, Team, load
from formation_controllers.geometry import formation_rates, range_bearing
from formation_controllers.testing import check_controller
from formation_controllers.vehicles import CarLike
from kinematic_bicycle.law import Follow, FollowGains, speed_and_steering
from kinematic_bicycle.model import model
from kinematic_bicycle.vehicle import KinematicBicycle

from plants import numeric

VEHICLE, PERIOD = KinematicBicycle(1.2), 0.02
ANYWHERE = FollowGains(v_max=1e3, gamma_max=1.5)


@pytest.fixture(scope="module")
def functions():
    return numeric.compile(model())


def desired(q, rate=None):
    q = np.atleast_2d(np.array(q, dtype=float))
    return Desired(
        q, np.zeros(q.shape) if rate is None else np.atleast_2d(np.array(rate, dtype=float)), np.zeros(q.shape)
    )


def test_it_is_found_by_name():
    assert load("bicycle-follow") is Follow


def test_it_keeps_what_controllers_promise():
    check_controller(Follow, vehicle=VEHICLE)
    check_controller(Follow, [FollowGains(K=k) for k in (0.4, 0.8, 1.2)], vehicle=VEHICLE)


def test_a_bicycle_in_its_place_at_rest_stands_still():
    pose, leader = np.array([[0.0, 0.0, 0.3]]), Leader(np.array([4.0, 1.0, 0.0]), np.zeros(2))
    law = Follow(Team(VEHICLE, 1, PERIOD))
    there = desired(range_bearing(pose, leader.pose, VEHICLE))
    law.start(pose, leader, there)
    assert law.step(pose, leader, there).tolist() == [[0.0, 0.0]]


def test_within_its_limits_the_error_decays_at_rate_K():
    """The rates of range and bearing under the command, by the equations of the formation: q' = q_d' - K (q - q_d)."""
    rng = np.random.default_rng(1)
    for _ in range(100):
        pose = rng.uniform([-1, -1, -0.5], [1, 1, 0.5], (3, 3))
        leader = Leader(
            np.array([*rng.uniform([5, -2], [7, 2]), rng.uniform(-1, 1)]), np.array([rng.uniform(0, 2), 0.1])
        )
        q = range_bearing(pose, leader.pose, VEHICLE)
        wanted = desired(q + rng.uniform(-0.3, 0.3, q.shape), rng.normal(0, 0.1, q.shape))
        law = Follow(Team(VEHICLE, 3, PERIOD), ANYWHERE)
        law.start(pose, leader, wanted)
        v, gamma = law.step(pose, leader, wanted).T
        R, delta = formation_rates(pose, leader.pose, leader.velocity[0], VEHICLE)
        rates = np.einsum("nij,nj->ni", R, np.stack([v, v * np.tan(gamma) / 1.2], axis=1)) + delta
        free = np.abs(gamma) < 1.5
        np.testing.assert_allclose(rates[free], (wanted.q_dot - 0.8 * (q - wanted.q))[free], atol=1e-9)
        assert free.any()
        np.testing.assert_allclose(law.telemetry()["error"], q - wanted.q, atol=1e-12)


def test_limits_keep_the_direction_as_nearly_as_they_can():
    gains = FollowGains(v_max=2.0, gamma_max=0.5)
    assert speed_and_steering(1.0, 0.2, gains) == pytest.approx((1.0, np.arctan(0.2)))
    assert speed_and_steering(-1.0, 0.2, gains) == pytest.approx((-1.0, -np.arctan(0.2)))
    assert speed_and_steering(4.0, 1.0, gains) == pytest.approx((2.0, np.arctan(0.25)))
    v, gamma = speed_and_steering(0.0, 1.0, gains)  # straight to the left: forward along a full turn
    assert (v, gamma) == pytest.approx((np.sin(0.5) * np.cos(0.5), 0.5))
    assert speed_and_steering(-0.1, -1.0, gains)[1] == 0.5
    assert speed_and_steering(0.004, 0.003, gains) == (0.0, 0.0)


@pytest.mark.parametrize("turn", [0.0, 0.15])
def test_a_team_of_bicycles_takes_its_places_behind_a_leader(functions, turn):
    """Three bicycles with lags, from rest, behind a leader that drives at 1 m/s, straight or on a circle."""
    wanted = desired([[3.0, 0.0], [4.0, 0.4], [4.0, -0.4]])
    law = Follow(Team(VEHICLE, 3, PERIOD))
    x = functions.start(x=[-4.0, -5.0, -5.0], y=[0.5, -3.0, 2.0], psi=[0.2, -0.2, 0.0])
    p = functions.parameters()
    errors = []
    for k in range(2000):
        psi = turn * k * PERIOD
        at = [np.sin(psi) / turn, (1 - np.cos(psi)) / turn] if turn else [k * PERIOD, 0.0]
        leader = Leader(np.array([*at, psi]), np.array([1.0, turn]))
        if k == 0:
            law.start(x[:, :3], leader, wanted)
        command = law.step(x[:, :3], leader, wanted)
        assert np.abs(command[:, 0]).max() <= 3.0
        assert np.abs(command[:, 1]).max() <= np.radians(35) + 1e-12
        x = functions.rk4(0.0, x, functions.inputs(v_command=command[:, 0], gamma_command=command[:, 1]), p, PERIOD)
        errors.append(np.abs(law.telemetry()["error"]).max(axis=0))
    assert errors[0][0] > 1.0
    assert np.max(errors[-200:]) < 0.02


def test_bad_use_is_refused_by_name():
    with pytest.raises(GainError, match=r"'gamma_max' is 1\.6: must be less than 1\.57"):
        FollowGains(gamma_max=1.6)
    with pytest.raises(ControllerError, match="Follow serves vehicles of kind kinematic_bicycle, not car_like"):
        Follow(Team(CarLike(1.2), 1, PERIOD))
    law = Follow(Team(VEHICLE, 1, PERIOD))
    with pytest.raises(ControllerError, match="pose"):
        law.start(np.zeros((1, 4)), Leader(np.zeros(3), np.zeros(2)), desired([3.0, 0.0]))
