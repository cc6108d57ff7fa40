"""Noise is white, of the stated size, and each robot's and channel's own."""

import numpy as np
import pytest

from cosim.sensing import PoseSensor, random_stream

CHANNELS = ("x", "y", "psi", "gamma")


def measure(seed: int, robots: list[str], deviation: tuple[float, ...], ticks: int) -> np.ndarray:
    sensor = PoseSensor(seed, robots, CHANNELS, deviation)
    pose = np.zeros((len(robots), 4))
    out = np.empty((ticks, len(robots), 4))
    for tick in range(ticks):
        sensor.measure(tick, pose, out[tick])
    return out


def test_same_seed_same_noise_and_another_seed_other_noise() -> None:
    first, again, other = (measure(seed, ["a", "b"], (1e-3,) * 4, 1100) for seed in (3, 3, 4))
    assert np.array_equal(first, again)
    assert not np.any(first == other)


def test_another_robot_leaves_the_noise_of_the_others_as_it_is() -> None:
    two = measure(1, ["a", "b"], (1e-3,) * 4, 600)
    three = measure(1, ["new", "a", "b"], (1e-3,) * 4, 600)
    assert np.array_equal(two, three[:, 1:])


def test_channels_are_independent_and_have_the_stated_deviation() -> None:
    deviation = np.array([1e-3, 2e-3, 3e-3, 4e-3])
    noise = measure(5, ["a", "b"], tuple(deviation), 20_000).reshape(20_000, 8)
    assert noise.std(axis=0) == pytest.approx(np.tile(deviation, 2), rel=0.02)
    correlation = np.corrcoef(noise.T) - np.eye(8)
    assert np.abs(correlation).max() < 5 / np.sqrt(20_000)


def test_no_noise_measures_the_pose_itself() -> None:
    sensor = PoseSensor(1, ["a"], CHANNELS, (0.0,) * 4)
    pose = np.array([[1.0, -2.0, 0.3, 1e-300]])
    out = np.empty_like(pose)
    sensor.measure(0, pose, out)
    assert np.array_equal(out, pose)


def test_streams_are_named() -> None:
    draws = {random_stream(1, robot, channel).random() for robot in "ab" for channel in CHANNELS}
    assert len(draws) == 8
