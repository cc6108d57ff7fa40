"""Effects of actuators on commanded torques."""

import numpy as np
from numpy.typing import NDArray

from cosim.errors import Location
from cosim.signals.actuators import actuators
from cosim.signals.chain import apply
from cosim.signals.effects import Effect

CHANNELS = ("tau_drive", "tau_steer")
HERE = Location("file.xml", 1, 1)
STEP = 0.02


def effect(kind: str, amount: float, *channels: str, start: float = 0.0, stop: float = np.inf) -> Effect:
    return Effect(kind, amount, channels, start, stop, HERE)


def acting(effects: list[list[Effect]], commands: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the torques (ticks, robots, 2) of commands (ticks, 2) that all robots share."""
    chain = actuators([CHANNELS] * len(effects), effects, STEP)
    out = np.empty((len(commands), len(effects), 2))
    for tick, command in enumerate(commands):
        out[tick] = command
        chain.make_ready(tick)
        apply(chain.arrays, tick, out[tick])
    return out


RISING = np.arange(1.0, 41.0)[:, np.newaxis] * np.array([10.0, -10.0])


def test_a_healthy_actuator_delivers_what_is_commanded() -> None:
    assert np.array_equal(acting([[]], RISING)[:, 0], RISING)


def test_saturation_of_a_robot_and_of_a_channel() -> None:
    torque = acting([[effect("saturation", 200.0)], [effect("saturation", 50.0, "tau_steer")]], RISING)
    assert np.array_equal(torque[:, 0], np.clip(RISING, -200, 200))
    assert np.array_equal(torque[:, 1, 0], RISING[:, 0])
    assert np.array_equal(torque[:, 1, 1], np.maximum(RISING[:, 1], -50))


def test_of_two_saturations_the_narrower_counts_in_its_window() -> None:
    torque = acting([[effect("saturation", 200.0), effect("saturation", 30.0, start=0.1, stop=0.2)]], RISING)
    assert torque[4:10, 0, 0].tolist() == [50, 30, 30, 30, 30, 30]
    assert torque[10, 0, 0] == 110


def test_a_rate_limit_starts_from_zero_and_follows() -> None:
    steps = np.concatenate([np.full((10, 2), 3.0), np.full((10, 2), -1.0)])
    torque = acting([[effect("rate", 50.0, "tau_drive")]], steps)[:, 0]
    assert torque[:5, 0].tolist() == [1.0, 2.0, 3.0, 3.0, 3.0]
    assert torque[10:15, 0].tolist() == [2.0, 1.0, 0.0, -1.0, -1.0]
    assert np.array_equal(torque[:, 1], steps[:, 1])


def test_a_delay_delivers_nothing_before_the_first_command_arrives() -> None:
    torque = acting([[effect("delay", 2 * STEP)]], RISING)[:, 0]
    assert np.array_equal(torque[2:], RISING[:-2])
    assert not torque[:2].any()


def test_a_loss_of_effectiveness_comes_after_saturation() -> None:
    torque = acting([[effect("effectiveness", 0.5, "tau_drive", start=0.1), effect("saturation", 40.0)]], RISING)[:, 0]
    assert torque[3:6, 0].tolist() == [40.0, 40.0, 20.0]
    assert torque[3:6, 1].tolist() == [-40.0, -40.0, -40.0]


def test_two_losses_multiply() -> None:
    torque = acting([[effect("effectiveness", 0.5), effect("effectiveness", 0.5)]], RISING)[:, 0]
    assert np.array_equal(torque, RISING / 4)
