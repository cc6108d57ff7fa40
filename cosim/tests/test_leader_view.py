"""Followers see a leader of another kind as one of their own kind on the same path."""

import math
from dataclasses import replace

import numpy as np
import pytest
from formation_controllers import CarLike, DifferentialDrive, TractorTrailer
from formation_controllers.vehicles import Vehicle
from numpy.typing import NDArray

from cosim.control.leader_view import LeaderView
from cosim.errors import InputError
from cosim.vehicle.car_like import CAR_LIKE
from cosim.vehicle.differential_drive import DIFFERENTIAL_DRIVE
from cosim.vehicle.kinds import kind_named

CAR, LONG_CAR = CarLike(1.2), CarLike(2.0)
TRUCK = TractorTrailer(1.5, 0.15, 0.4)
STATES = [np.array([1.0, 2.0, 0.4, 0.7, 0.8, -0.3]), np.array([0.0, 0.0, -2.0, -2.5, -0.5, 0.2])]


def view(vehicle: Vehicle, leader: Vehicle) -> LeaderView:
    return LeaderView(kind_named(vehicle.kind), vehicle, kind_named(leader.kind), leader)


def path_rates(vehicle: Vehicle, pose: NDArray[np.float64], velocity: NDArray[np.float64]) -> tuple[float, float]:
    """Return the rate of the heading and the rate of the path's curvature, by the kinematics of (2) and section 4."""
    if isinstance(vehicle, TractorTrailer):
        length, angle = vehicle.hitch_length, pose[3] - pose[2]
        heading_rate = velocity[0] * math.tan(angle) / length
        angle_rate = velocity[1] - heading_rate
    else:
        assert isinstance(vehicle, CarLike)
        length, angle = vehicle.wheelbase, pose[3]
        heading_rate = velocity[0] * math.tan(angle) / length
        angle_rate = velocity[1]
    return heading_rate, angle_rate / (length * math.cos(angle) ** 2)


@pytest.mark.parametrize("state", STATES)
def test_an_equal_vehicle_is_told_as_it_is(state: NDArray[np.float64]) -> None:
    acceleration = np.array([0.1, 0.2])
    leader = view(CAR, CarLike(1.2, "rear_wheel")).seen(state, acceleration)
    assert np.array_equal(leader.pose, state[:4])
    assert np.array_equal(leader.velocity, state[4:])
    assert leader.acceleration is acceleration


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize(("follower", "leader"), [(TRUCK, CAR), (CAR, TRUCK), (LONG_CAR, CAR)])
def test_path_and_speed_are_kept(follower: Vehicle, leader: Vehicle, state: NDArray[np.float64]) -> None:
    if isinstance(leader, CarLike):
        state = state.copy()
        state[3] = 0.5
    seen = view(follower, leader).seen(state, np.zeros(2))
    assert np.array_equal(seen.pose[:3], state[:3])
    assert seen.velocity[0] == state[4]
    assert path_rates(follower, seen.pose, seen.velocity) == pytest.approx(
        path_rates(leader, state[:4], state[4:]), rel=1e-12
    )
    assert seen.acceleration is None


def test_a_kind_of_ones_own_is_asked_itself_though_its_vehicle_is_a_built_in_one() -> None:
    mine = replace(CAR_LIKE, name="my_car", on_path=None)
    seen = LeaderView(mine, LONG_CAR, mine, CAR)
    seen.check()  # without a motion along a path, the pose is read as it is
    assert np.array_equal(seen.seen(STATES[0], None).pose, STATES[0][:4])
    with pytest.raises(InputError, match="the kind my_car states no motion along a path"):
        LeaderView(mine, CAR, kind_named("tractor_trailer"), TRUCK).check()
    with pytest.raises(InputError, match="the kind my_car states no motion along a path"):
        LeaderView(kind_named("tractor_trailer"), TRUCK, mine, CAR).check()
    with pytest.raises(InputError, match="the kind my_car states no motion along a path"):
        LeaderView(mine, CAR, kind_named("car_like"), LONG_CAR).check()


def test_vehicles_of_one_class_with_other_poses_are_not_alike() -> None:
    class Rolls(CarLike):
        pose = (*CarLike.pose[:3], ("roll", "rad"), CarLike.pose[3])

    mine = replace(CAR_LIKE, name="rolls", on_path=None)
    assert not LeaderView(kind_named("car_like"), CAR, mine, Rolls(1.2)).alike


def test_a_vehicle_may_be_of_a_kind_that_is_not_installed() -> None:
    class Mine(CarLike):
        kind = "mine"

    mine = replace(CAR_LIKE, name="my_car")
    seen = LeaderView(DIFFERENTIAL_DRIVE, DifferentialDrive(0.1, 0.3), mine, Mine(1.2)).seen(STATES[0], None)
    assert np.array_equal(seen.pose, STATES[0][:3])
    assert LeaderView(mine, Mine(1.2), mine, Mine(1.2)).alike
    assert not LeaderView(mine, Mine(1.2), mine, Mine(1.3)).alike
