"""A leader on a given path moves as its kind of vehicle can, exactly along it."""

import math
from collections.abc import Callable
from pathlib import Path

import formation_controllers as fc
import numpy as np
import pytest
from formation_controllers.vehicles import Vehicle
from scipy.integrate import cumulative_simpson, solve_ivp
from scipy.interpolate import make_interp_spline

from cosim.clock import Clock
from cosim.errors import InputError, Location
from cosim.scenario.scenario import Trajectory
from cosim.signals import trajectory as trajectories
from cosim.storage import Storage
from cosim.vehicle.kinds import kind_named
from cosim.vehicle.path import Motion

WHERE = Location("scenario.xml", 9, 5)
CAR = fc.CarLike(1.2)
TRAILER = fc.TractorTrailer(1.5, 0.15, 0.4)
VEHICLES = pytest.mark.parametrize("vehicle", [CAR, TRAILER], ids=["car", "tractor-trailer"])
CLOCK = Clock(0.02, 1000)
TIMES = CLOCK.times

Path2 = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def along(path: Path2, time: np.ndarray, smoothing: float = 0.0) -> Trajectory:
    x, y = path(time)
    return Trajectory(tuple(zip(time.tolist(), x.tolist(), y.tolist(), strict=True)), None, smoothing, WHERE)


def leader_motion(trajectory: Trajectory, vehicle: Vehicle, clock: Clock, storage: Storage) -> Motion:
    return trajectories.leader_motion(trajectory, kind_named(vehicle.kind), vehicle, clock, storage)


def eight(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A curve with turns both ways, at a speed that changes."""
    return 8 * np.sin(0.5 * t) + 0.2 * t, 5 * np.sin(t) * np.cos(0.03 * t)


def circle(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return 1 + 6 * np.cos(0.4 * t - 1), 2 + 6 * np.sin(0.4 * t - 1)


@VEHICLES
def test_a_straight_line(vehicle: fc.CarLike | fc.TractorTrailer) -> None:
    motion = leader_motion(
        along(lambda t: (3 - 1.2 * t, 1 + 0.9 * t), np.linspace(-1, 21, 8)), vehicle, CLOCK, Storage()
    )
    heading = math.atan2(0.9, -1.2)
    last = heading if vehicle is TRAILER else 0.0
    expected = np.column_stack([3 - 1.2 * TIMES, 1 + 0.9 * TIMES, *np.tile([[heading], [last], [1.5], [0.0]], 1001)])
    assert motion.state == pytest.approx(expected, abs=1e-10)
    assert motion.acceleration == pytest.approx(np.zeros((1001, 2)), abs=1e-9)


def test_a_circle_of_a_car() -> None:
    motion = leader_motion(along(circle, np.linspace(0, 20, 401)), CAR, CLOCK, Storage())
    heading = 0.4 * TIMES - 1 + math.pi / 2
    n = np.ones(1001)
    expected = np.column_stack([*circle(TIMES), heading, math.atan(1.2 / 6) * n, 2.4 * n, 0 * n])
    assert motion.state[5:-5] == pytest.approx(expected[5:-5], abs=1e-6)
    assert motion.acceleration[20:-20] == pytest.approx(np.zeros((961, 2)), abs=1e-5)


def test_a_circle_of_a_tractor_trailer() -> None:
    motion = leader_motion(along(circle, np.linspace(0, 20, 401)), TRAILER, CLOCK, Storage())
    heading = 0.4 * TIMES - 1 + math.pi / 2
    n = np.ones(1001)
    expected = np.column_stack([*circle(TIMES), heading, heading + math.atan(1.5 / 6), 2.4 * n, 0.4 * n])
    assert motion.state[5:-5] == pytest.approx(expected[5:-5], abs=1e-6)
    assert motion.acceleration[20:-20] == pytest.approx(np.zeros((961, 2)), abs=1e-5)


def kinematics(vehicle: fc.CarLike | fc.TractorTrailer, pose: np.ndarray, v: float, omega: float) -> list[float]:
    _, _, heading, last = pose
    if isinstance(vehicle, fc.CarLike):
        turn = v * math.tan(last) / vehicle.wheelbase
    else:
        turn = v * math.tan(last - heading) / vehicle.hitch_length
    return [v * math.cos(heading), v * math.sin(heading), turn, omega]


@VEHICLES
def test_the_velocities_drive_the_vehicle_along_the_path(vehicle: fc.CarLike | fc.TractorTrailer) -> None:
    motion = leader_motion(along(eight, np.linspace(0, 20, 81)), vehicle, CLOCK, Storage())
    velocity = make_interp_spline(TIMES, motion.state[:, 4:], k=5)
    driven = solve_ivp(
        lambda t, pose: kinematics(vehicle, pose, *velocity(t)),
        (0, 20),
        motion.state[0, :4],
        t_eval=TIMES,
        rtol=1e-10,
        atol=1e-12,
        max_step=0.02,
    )
    assert pytest.approx(motion.state[:, :4], abs=1e-6) == driven.y.T
    assert np.ptp(motion.state[:, 2]) > math.pi  # the heading is not wrapped
    assert np.abs(np.diff(motion.state[:, 2:4], axis=0)).max() < 0.2


@VEHICLES
def test_the_accelerations_are_the_derivatives_of_the_velocities(vehicle: fc.CarLike | fc.TractorTrailer) -> None:
    clock = Clock(0.001, 20_000)
    motion = leader_motion(along(eight, np.linspace(0, 20, 81)), vehicle, clock, Storage())
    gained = cumulative_simpson(motion.acceleration, x=clock.times, axis=0, initial=0) + motion.state[0, 4:]
    assert gained == pytest.approx(motion.state[:, 4:], abs=1e-9)


def test_every_point_is_passed_in_time() -> None:
    points = np.linspace(0, 20, 51)
    motion = leader_motion(along(eight, points), CAR, CLOCK, Storage())
    assert motion.state[::20, :2] == pytest.approx(np.column_stack(eight(points)), abs=1e-12)


def test_a_table_is_read_in_its_units(tmp_path: Path) -> None:
    points = np.linspace(0, 20, 51)
    x, y = eight(points)
    file = tmp_path / "path.csv"
    rows = np.column_stack([y * 100, points * 1000, x / 1000]).tolist()
    file.write_text("y [cm],time [ms],x [km]\n" + "".join(f"{a!r},{b!r},{c!r}\n" for a, b, c in rows))
    motion = leader_motion(Trajectory((), file, 0.0, WHERE), CAR, CLOCK, Storage())
    expected = leader_motion(along(eight, points), CAR, CLOCK, Storage())
    assert motion.state == pytest.approx(expected.state, abs=1e-7)


def test_smoothing_misses_noisy_points_by_as_much_as_allowed() -> None:
    points = np.linspace(0, 20, 1001)
    noise = np.random.default_rng(1).normal(0, 0.05, (2, 1001))

    def measured(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x, y = eight(t)
        return x + noise[0], y + noise[1]

    with pytest.raises(InputError, match="more than"):
        leader_motion(along(measured, points), CAR, CLOCK, Storage())
    motion = leader_motion(along(measured, points, smoothing=0.07), CAR, CLOCK, Storage())
    missed = np.column_stack(measured(points)) - motion.state[:, :2]
    assert math.sqrt((missed**2).sum() / 1001) == pytest.approx(0.07, rel=0.01)
    true = leader_motion(along(eight, points), CAR, CLOCK, Storage())
    assert np.abs(motion.state[:, :2] - true.state[:, :2]).max() < 0.1


@pytest.mark.parametrize(
    ("count", "smoothing", "message"),
    [
        (10_001, 0.1, "has 10001 points; at most 10000 can be smoothed"),
        (51, 1e-13, "allow more smoothing than 1e-13 m"),
    ],
)
def test_smoothing_that_is_not_possible(count: int, smoothing: float, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        leader_motion(along(eight, np.linspace(0, 20, count), smoothing), CAR, CLOCK, Storage())
    assert caught.value.where == WHERE


@pytest.mark.parametrize(
    ("time", "message"),
    [
        (np.linspace(0, 20, 5), "has 5 points; at least 6 are needed"),
        (np.linspace(0.1, 20, 50), "from 0.1 s to 20 s; they must reach from 0 s to the horizon, 20 s"),
        (np.linspace(0, 19.9, 50), "from 0 s to 19.9 s; they must reach from 0 s to the horizon, 20 s"),
    ],
)
def test_points_that_do_not_suffice(time: np.ndarray, message: str) -> None:
    with pytest.raises(InputError) as caught:
        leader_motion(along(eight, time), CAR, CLOCK, Storage())
    assert message in caught.value.message
    assert caught.value.where == WHERE


def test_a_horizon_that_is_only_computed_is_reached() -> None:
    clock = Clock(0.1 * 3, 4)  # ends at 1.2000000000000002
    motion = leader_motion(along(circle, np.linspace(0, 1.2, 6)), CAR, clock, Storage())
    assert motion.state[-1, :2] == pytest.approx(np.ravel(circle(np.array([1.2]))), abs=1e-9)


@VEHICLES
@pytest.mark.parametrize(
    ("path", "message"),
    [
        (lambda t: ((t - 10) ** 3, 0 * t), "stands still at t = 10 s: its heading is not defined there"),
        (lambda t: (0 * t, 0 * t), "stands still at t = 0 s"),
        (lambda t: ((t - 10.01) ** 2, 0 * t), "at t = 10.02 s: it is no smooth path"),
        (lambda t: (0.2 * np.cos(t), 0.2 * np.sin(t)), "would have to steer by more than 80 degrees at t = 0 s"),
        (lambda t: (1e200 * t, 0 * t), "is too fast to compute with at t = 0 s"),
    ],
    ids=["slows down to rest", "rests", "turns round between two points", "turns tightly", "is beyond all numbers"],
)
def test_paths_that_cannot_be_driven(path: Path2, message: str, vehicle: fc.CarLike | fc.TractorTrailer) -> None:
    with pytest.raises(InputError) as caught:
        leader_motion(along(path, np.linspace(0, 20, 201)), vehicle, CLOCK, Storage())
    assert message in caught.value.message
    assert caught.value.where == WHERE
