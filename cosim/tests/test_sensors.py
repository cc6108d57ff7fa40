"""Effects of sensors; every robot and channel has noise of its own."""

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cosim.clock import tick_at
from cosim.errors import InputError, Location
from cosim.scenario.grammar import children_of
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import EffectSource
from cosim.signals import normal
from cosim.signals.chain import Chain, apply
from cosim.signals.effects import EFFECTS, Effect, check_channels, understood
from cosim.signals.effects.effect import Rows
from cosim.signals.random import random_stream
from cosim.signals.sensors import pose_sensors

CHANNELS = ("x", "y", "psi", "gamma")
HERE = Location("file.xml", 1, 1)
STEP = 0.02


def effect(kind: str, amount: float, *channels: str, start: float = 0.0, stop: float = np.inf) -> Effect:
    return Effect(kind, amount, channels, start, stop, HERE)


def noise(deviation: tuple[float, ...] = (1e-3,) * 4) -> list[Effect]:
    return [effect("noise", amount, channel) for channel, amount in zip(CHANNELS, deviation, strict=True)]


def measure(
    effects: dict[str, list[Effect]], ticks: int, seed: int = 1, pose: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return measured poses (ticks, robots, 4) for poses (ticks, 4) that all robots share; default: at rest."""
    sensors = pose_sensors(seed, list(effects), [CHANNELS] * len(effects), list(effects.values()), STEP)
    out = np.empty((ticks, len(effects), 4))
    for tick in range(ticks):
        out[tick] = 0.0 if pose is None else pose[tick]
        sensors.make_ready(tick)
        apply(sensors.arrays, tick, out[tick])
    return out


MOVING = np.arange(40)[:, np.newaxis] + np.array([0.0, 100.0, 200.0, 300.0])


def test_same_seed_same_noise_and_another_seed_other_noise() -> None:
    first, again, other = (measure({"a": noise(), "b": noise()}, 1100, seed) for seed in (3, 3, 4))
    assert np.array_equal(first, again)
    assert not np.any(first == other)


def test_another_robot_or_effect_leaves_the_noise_of_the_others_as_it_is() -> None:
    two = measure({"a": noise(), "b": noise()}, 600)
    three = measure({"new": noise(), "a": noise(), "b": noise()}, 600)
    assert np.array_equal(two, three[:, 1:])
    lossy = measure({"a": noise(), "b": [*noise(), effect("dropout", 0.5, "y")]}, 600)
    assert np.array_equal(two[:, 0], lossy[:, 0])
    assert np.array_equal(two[:, 1, [0, 2, 3]], lossy[:, 1, [0, 2, 3]])
    only_x = measure({"a": noise()[:1]}, 600)
    assert np.array_equal(two[:, 0, 0], only_x[:, 0, 0])


def test_channels_are_independent_and_have_the_stated_deviation() -> None:
    deviation = (1e-3, 2e-3, 3e-3, 4e-3)
    measured = measure({"a": noise(deviation), "b": noise(deviation)}, 20_000, 5).reshape(20_000, 8)
    assert measured.std(axis=0) == pytest.approx(np.tile(deviation, 2), rel=0.02)
    correlation = np.corrcoef(measured.T) - np.eye(8)
    assert np.abs(correlation).max() < 5 / np.sqrt(20_000)


def test_two_noises_on_a_channel_add_their_variances() -> None:
    both = [effect("noise", 3e-3, "x"), effect("noise", 4e-3, "x")]
    assert np.array_equal(measure({"a": both}, 50), measure({"a": [effect("noise", 5e-3, "x")]}, 50))


def test_a_sensor_without_effects_measures_the_pose_itself() -> None:
    pose = np.array([[1.0, -2.0, 0.3, 1e-300]])
    assert np.array_equal(measure({"a": []}, 1, pose=pose)[0], pose)


def test_bias_in_a_window_and_on_a_channel() -> None:
    measured = measure({"a": [effect("bias", 0.5, "y", start=0.1, stop=0.2)], "b": []}, 20)
    assert np.flatnonzero(measured[:, 0, 1] == 0.5).tolist() == [5, 6, 7, 8, 9]
    assert np.count_nonzero(measured) == 5


def test_quantisation_rounds_to_the_nearest_step() -> None:
    pose = np.array([[0.26, 0.24, -0.26, 0.1]])
    measured = measure({"a": [effect("quantisation", 0.5, "x", "y", "psi")]}, 1, pose=pose)
    assert measured[0, 0].tolist() == [0.5, 0.0, -0.5, 0.1]


def test_delay_of_a_channel_and_the_start_before_the_start() -> None:
    measured = measure({"a": [effect("delay", 3 * STEP, "x")], "b": [effect("delay", STEP)]}, 40, pose=MOVING)
    assert np.array_equal(measured[3:, 0, 0], MOVING[:-3, 0])
    assert np.array_equal(measured[:3, 0, 0], np.zeros(3))
    assert np.array_equal(measured[:, 0, 1:], MOVING[:, 1:])
    assert np.array_equal(measured[1:, 1], MOVING[:-1])
    assert np.array_equal(measured[0, 1], MOVING[0])


def test_what_is_dropped_holds_the_last_measurement() -> None:
    measured = measure({"a": [effect("dropout", 1.0, "x", start=0.2, stop=0.4)]}, 40, pose=MOVING)
    assert np.array_equal(measured[:10, 0], MOVING[:10])
    assert (measured[10:20, 0, 0] == MOVING[9, 0]).all()
    assert np.array_equal(measured[20:, 0], MOVING[20:])
    assert np.array_equal(measured[:, 0, 1:], MOVING[:, 1:])


def test_dropouts_are_as_frequent_as_stated_and_strike_all_channels_at_once() -> None:
    moving = np.arange(10_000.0)[:, np.newaxis] * np.ones(4)
    lost = measure({"a": [effect("dropout", 0.3)]}, 10_000, pose=moving)[:, 0] != moving
    assert lost.mean() == pytest.approx(0.3, abs=0.02)
    assert (lost.all(axis=1) == lost.any(axis=1)).all()
    assert not lost[0].any(), "there is nothing to hold before the first measurement"


def test_order_is_delay_bias_noise_quantisation_dropout() -> None:
    effects = [
        effect("dropout", 1.0, "x", start=0.1),
        effect("quantisation", 1.0, "x"),
        effect("bias", 0.4, "x"),
        effect("delay", STEP, "x"),
    ]
    measured = measure({"a": effects}, 10, pose=MOVING * 1.2)[:, 0, 0]
    assert measured[:5].tolist() == [0.0, 0.0, 2.0, 3.0, 4.0], "round(1.2 (k - 1) + 0.4)"
    assert (measured[5:] == 4.0).all()


def test_streams_are_named() -> None:
    draws = {random_stream(1, robot, channel).random() for robot in "ab" for channel in CHANNELS}
    assert len(draws) == 8


@pytest.mark.parametrize("seed", [0, 7, 2**32 - 1, 2**32, 2**64 + 5, 2**128 - 1, 2**128, 2**200 + 3])
def test_streams_are_those_of_the_seed_with_the_names_as_spawn_key(seed: int) -> None:
    names = np.frombuffer(hashlib.sha256(b"a/x").digest(), dtype="<u4").tolist()
    expected = np.random.PCG64(np.random.SeedSequence(seed, spawn_key=names))
    assert random_stream(seed, "a", "x").bit_generator.state == expected.state


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("seed", [0, 1, 2**64 + 5, 2**200 + 3])
def test_normal_numbers_are_those_of_numpy(seed: int, compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not compiled:
        monkeypatch.setattr(normal, "ZIGGURAT", None)
    names = [("a", channel) for channel in CHANNELS]
    streams = normal.NormalStreams(names)
    streams.begin(seed)
    drawn = np.zeros((40_000, 6))
    for block in (slice(0, 1), slice(1, 1024), slice(1024, None)):
        streams.draw(np.array([1.0, 2.0, 3.0, 0.1]), drawn[block], np.array([5, 0, 1, 3]))
    for column, deviation, name in zip((5, 0, 1, 3), (1.0, 2.0, 3.0, 0.1), names, strict=True):
        expected = random_stream(seed, *name).standard_normal(len(drawn))
        assert np.array_equal(drawn[:, column], deviation * expected)
        assert np.abs(expected).max() > 3.66, "numbers beyond the last layer of the ziggurat are among them"
    assert (drawn[:, [2, 4]] == 0.0).all()


def test_sensors_that_are_restarted_are_as_good_as_new() -> None:
    effects = [[*noise(), effect("dropout", 0.5), effect("delay", STEP), effect("bias", 0.1, start=0.1)]]

    def rows(seed: int, amount: float = 1e-3) -> Rows:
        own = [*effects[0][:3], effect("noise", amount, "gamma"), *effects[0][4:]]
        return Rows(seed, ["a"], [CHANNELS], [own], STEP, at_rest=False)

    def measured(chain: Chain) -> NDArray[np.float64]:
        values = np.arange(40.0).reshape(10, 1, 4)
        for tick in range(len(values)):
            chain.make_ready(tick)
            apply(chain.arrays, tick, values[tick])
        return values

    chain = Chain(rows(1))
    first = measured(chain)
    assert chain.restart(rows(2))
    second = measured(chain)
    assert chain.restart(rows(1))
    np.testing.assert_array_equal(measured(chain), first)
    np.testing.assert_array_equal(second, measured(Chain(rows(2))))
    assert (first != second).any()
    assert not chain.restart(rows(1, amount=2e-3)), "another sensor"


@pytest.mark.parametrize(
    ("time", "tick"), [(0.0, 0), (0.02, 1), (0.3, 15), (0.7, 35), (0.021, 2), (1e9, 50_000_000_000)]
)
def test_times_become_ticks_without_trouble_from_rounding(time: float, tick: int) -> None:
    assert tick_at(time, STEP) == tick


def test_an_unknown_channel_is_refused_at_its_place() -> None:
    with pytest.raises(InputError, match=r"file.xml:1:1: the pose of a has no channel 'xx': did you mean 'x'"):
        check_channels([effect("noise", 1.0, "xx")], CHANNELS, "the pose of a")


UNITS = {"x": "m", "y": "m", "psi": "rad", "gamma": "rad"}


def read(kind: str, channels: str = "", units: dict[str, str] = UNITS, **attributes: str) -> list[Effect]:
    given = attributes | ({"channels": channels} if channels else {})
    written = EffectSource(kind, given, HERE, Path("folder"), 0.0, np.inf)
    return list(understood([written], units, Times(STEP, 100), "the pose of a"))


def test_an_effect_is_read_in_the_units_of_the_channels() -> None:
    bias = read("bias", x="-2 cm", psi="180 deg")
    assert [(e.amount, e.channels, e.unit) for e in bias] == [(-0.02, ("x",), "m"), (np.pi, ("psi",), "rad")]
    assert bias[0].text == "bias -0.02 m"
    (rate,) = read("rate", units={"v": "m/s", "steering": "m/s"}, limit="1 km/h/s".replace("/h/s", "/(h.s)"))
    assert (rate.unit, rate.amount) == ("m/s2", pytest.approx(1 / 3.6))
    turning = {"left": "rad/s", "right": "deg/s", "back": "rad/s"}
    limits = read("saturation", units=turning, limit="1 rad/s")
    assert [(e.channels, e.unit) for e in limits] == [(("left", "back"), "rad/s"), (("right",), "deg/s")]
    assert [e.amount for e in limits] == pytest.approx([1.0, np.degrees(1.0)])
    assert read("dropout", "x y", probability="0.25")[0].text == "dropout 0.25"


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        (lambda: read("noise", theta_1="1 deg"), "the pose of a has no channel 'theta_1'"),
        (lambda: read("noise", x="1 deg"), "x=\"1 deg\" of <noise>: '1 deg': rad does not fit"),
        (lambda: read("quantisation", x="-1 m"), "must not be negative"),
        (lambda: read("saturation", "x psi", limit="1 m"), "limit=\"1 m\" of <saturation>: '1 m': m does not fit"),
        (lambda: read("delay", "xx", time="20 ms"), "the pose of a has no channel 'xx'"),
    ],
)
def test_an_effect_that_makes_no_sense_is_refused_at_its_place(effects: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError) as caught:
        effects()
    assert message in caught.value.message
    assert caught.value.where == HERE


def test_each_kind_is_an_element_of_the_schema() -> None:
    assert set(EFFECTS) == {*children_of("sensor"), *children_of("actuator")}
