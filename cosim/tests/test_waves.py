"""Input signals have the scenario's values at every communication point; random ones are white through a low-pass."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from cosim.clock import Clock
from cosim.errors import InputError, Location
from cosim.scenario.grammar import children_of
from cosim.scenario.scenario import InputSource, WaveSource
from cosim.signals.interpolation import interpolated
from cosim.signals.waves import WAVES, add_samples
from cosim.signals.waves.random import MIN_CUTOFF
from plants import units

WHERE = Location("scenario.xml", 7, 3)
STEP = 0.02


def wave(kind: str, value: str = "2 N", start: float = 0.0, stop: float = math.inf, **attributes: str) -> WaveSource:
    return WaveSource(kind, {"value": value} | attributes, WHERE, Path("folder"), start, stop)


def samples(
    *waves: WaveSource,
    unit: str = "N",
    ticks: int = 100,
    step: float = STEP,
    seed: int = 1,
    robot: str = "f",
    name: str = "wind",
) -> np.ndarray:
    source = InputSource(name, waves, Location("scenario.xml", 6, 1))
    course = np.zeros(ticks)
    add_samples(course, source, units.parse(unit), Clock(step, ticks - 1), seed, robot)
    return course


def test_constant_in_any_unit_that_fits() -> None:
    assert samples(wave("constant", "1.5 kN")).tolist() == [1500.0] * 100
    assert samples(wave("constant", "1500 N"), unit="kN").tolist() == [1.5] * 100
    assert samples(wave("constant", "0.5"), unit="1").tolist() == [0.5] * 100


@pytest.mark.parametrize("step", [0.02, 0.03])  # some multiples are above, or below, what the decimal number reads as
def test_step_and_pulse_switch_at_the_point_that_the_decimal_number_means(step: float) -> None:
    for k in range(1, 100):
        at = float(f"{k * step:.2f}")
        assert np.flatnonzero(samples(wave("step", start=at), step=step)).tolist() == list(range(k, 100))
        assert np.flatnonzero(samples(wave("pulse", stop=at), step=step)).tolist() == list(range(k))
    assert samples(wave("step", start=2.5 * step), step=step)[2:4].tolist() == [0.0, 2.0]


def test_neighbouring_pulses_leave_no_gap() -> None:
    course = samples(wave("pulse", "1 N", 0.06, 0.14), wave("pulse", "1 N", 0.14, 0.58))
    assert course[3:29].tolist() == [1.0] * 26
    assert np.count_nonzero(course) == 26


def test_ramp() -> None:
    course = samples(wave("ramp", "3 N", 0.2, 0.8))
    assert course[[0, 10]].tolist() == [0.0, 0.0]
    assert course[[20, 25, 40]] == pytest.approx([1.0, 1.5, 3.0])
    assert course[41:].tolist() == [3.0] * 59


def test_sine_counts_from_its_beginning() -> None:
    times = np.arange(100) * STEP
    course = samples(wave("sine", "2 N", 0.2, 1.2, period="0.8 s", phase="0.3 rad"))
    expected = np.where((times > 0.19) & (times < 1.19), 2 * np.sin(2 * np.pi * (times - 0.2) / 0.8 + 0.3), 0.0)
    assert course == pytest.approx(expected, abs=1e-14)


def test_table_is_interpolated_and_kept_beyond_its_ends(tmp_path: Path) -> None:
    path = tmp_path / "wind.csv"
    path.write_text("time [s],wind [kN]\n0.5,1\n1.0,2\n1.5,-2\n")
    course = samples(wave("table", "", file=str(path), column="wind"))
    assert course[:26].tolist() == [1000.0] * 26
    assert course[[50, 60, 75, 99]] == pytest.approx([2000, 400, -2000, -2000])


@pytest.mark.parametrize("rows", [1, 2, 50])
def test_a_table_has_the_numbers_of_numpy(rows: int) -> None:
    random = np.random.default_rng(rows)
    for _ in range(50):
        known = np.cumsum(random.uniform(1e-9, 1.0, rows) ** random.integers(1, 9))
        values = random.normal(size=rows) * 10.0 ** random.integers(-8, 8)
        beside = [np.nextafter(known, np.inf), np.nextafter(known, -np.inf)]
        times = np.concatenate([random.uniform(known[0] - 1, known[-1] + 1, 100), known, *beside])
        np.testing.assert_allclose(interpolated(times, known, values), np.interp(times, known, values), rtol=1e-12)


def test_a_table_jumps_within_the_smallest_of_times() -> None:
    known, values = np.array([0.0, 5e-324, 1.0]), np.array([0.0, 1.0, 2.0])
    assert interpolated(np.array([0.0, 5e-324, 0.5, 1.0]), known, values).tolist() == [0.0, 1.0, 1.5, 2.0]


def test_signals_add_up() -> None:
    both = samples(wave("constant", "1 N"), wave("ramp", "3 N", 0.2, 0.8))
    assert both == pytest.approx(1.0 + samples(wave("ramp", "3 N", 0.2, 0.8)))
    assert samples().tolist() == [0.0] * 100


def random(cutoff: float, start: float = 0.0, stop: float = math.inf) -> WaveSource:
    return wave("random", start=start, stop=stop, cutoff=f"{cutoff!r} Hz")


def test_random_is_fixed_by_the_seed_and_the_same_in_a_longer_run() -> None:
    course = samples(random(1.0))
    assert np.array_equal(course, samples(random(1.0)))
    assert np.array_equal(course, samples(random(1.0), ticks=5000)[:100])
    assert not np.any(course == samples(random(1.0), seed=2))


def test_random_signals_are_independent() -> None:
    noise = random(5.0)
    n = 20_000
    first, second = (
        samples(noise, ticks=n),
        samples(noise, noise, ticks=n) - samples(noise, ticks=n),
    )
    courses = np.array([first, second, samples(noise, ticks=n, robot="g"), samples(noise, ticks=n, name="push")])
    correlation = np.corrcoef(courses) - np.eye(4)
    effective = n * 5.0 * 2 * STEP
    assert np.abs(correlation).max() < 5 / math.sqrt(effective)


@pytest.mark.parametrize("cutoff", [0.05, 1.0, 10.0, 24.0])
def test_random_has_the_stated_deviation_from_the_first_sample_on(cutoff: float) -> None:
    courses = np.array([samples(random(cutoff), ticks=40, seed=seed) for seed in range(2000)])
    assert courses.std(axis=0) == pytest.approx(np.full(40, 2.0), rel=5 / math.sqrt(2 * 2000))
    assert np.abs(courses.mean(axis=0)).max() < 5 * 2.0 / math.sqrt(2000)


@pytest.mark.parametrize("cutoff", [0.5, 5.0, 20.0])
def test_random_has_the_covariance_of_its_filter(cutoff: float) -> None:
    courses = np.array([samples(random(cutoff), ticks=9, seed=seed) for seed in range(4000)])
    impulse = np.zeros(5000)
    impulse[0] = 1.0
    h = signal.sosfilt(signal.butter(2, cutoff, fs=1 / STEP, output="sos"), impulse)
    expected = np.array([h[: len(h) - lag] @ h[lag:] for lag in range(9)]) / (h @ h)
    for first in (0, 4):
        lags = np.arange(9 - first)
        measured = (courses[:, [first]] * courses[:, first:]).mean(axis=0) / 4.0
        assert measured == pytest.approx(expected[lags], abs=5 * math.sqrt(2 / 4000))


def test_random_has_lost_half_its_power_at_the_cutoff() -> None:
    course = samples(random(5.0), ticks=200_000)
    frequency, power = signal.welch(course, fs=1 / STEP, nperseg=500)
    flat = power[(frequency > 0.3) & (frequency < 1.0)].mean()
    assert power[np.abs(frequency - 5.0) < 0.25].mean() / flat == pytest.approx(0.5, rel=0.15)
    assert power[frequency > 20.0].max() < 0.01 * flat


@pytest.mark.parametrize("part", [1.001 * MIN_CUTOFF, 0.4999, 0.5 - 1.001 * MIN_CUTOFF])
def test_random_at_the_ends_of_its_range(part: float) -> None:
    courses = np.array([samples(random(part), ticks=2, step=1.0, seed=seed) for seed in range(2000)])
    assert courses.std(axis=0) == pytest.approx([2.0, 2.0], rel=5 / math.sqrt(2 * 2000))
    long = samples(random(part), ticks=100_000, step=1.0)
    assert np.abs(long).max() < 2.0 * 6


def test_random_within_a_window_is_the_same_course() -> None:
    whole, part = samples(random(1.0)), samples(random(1.0, start=0.2, stop=0.4))
    assert np.array_equal(part[10:20], whole[10:20])
    assert not part[:10].any()
    assert not part[20:].any()


@pytest.mark.parametrize(
    ("cutoff", "message"),
    [
        (0.5e-6 / STEP, r"the cutoff .* Hz of a random signal is not from 5e-05 Hz to"),
        (0.4999995 / STEP, r"the cutoff .* Hz of a random signal is not from 5e-05 Hz to"),
        (0.5 / STEP, r"the cutoff 25 Hz is not below half of the ticks' frequency, 25 Hz"),
        (1e9, r"the cutoff 1e\+09 Hz is not below half of the ticks' frequency, 25 Hz"),
    ],
)
def test_a_cutoff_out_of_range_is_refused(cutoff: float, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        samples(random(cutoff))
    assert caught.value.where == WHERE


@pytest.mark.parametrize("kind", ["constant", "step", "ramp", "pulse", "sine", "random"])
@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("2 m", "m does not fit"),
        ("2", "the unit is missing"),
        ("2 Nn", "'Nn' is not known"),
        ("1e999 N", "is not a finite number"),
    ],
)
def test_a_value_that_does_not_fit_is_refused_with_its_place(kind: str, value: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        samples(wave(kind, value, 0.0, 1.0, period="1 s", cutoff="1 Hz"))
    assert message in caught.value.message
    assert f'value="{value}" of <{kind}>' in caught.value.message
    assert caught.value.where == WHERE


def test_a_table_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "wind.csv"
    path.write_text("time [s],wind [m]\n0,1\n")
    with pytest.raises(InputError, match="'wind' is in m, but expected a unit such as N"):
        samples(wave("table", "", file=str(path), column="wind"))
    with pytest.raises(InputError, match="did you mean 'wind'") as caught:
        samples(wave("table", "", file=str(path), column="wimd"))
    assert caught.value.where == WHERE


def test_a_sum_beyond_all_numbers_is_refused() -> None:
    with pytest.raises(InputError, match="the signals of the input 'wind' add up to more") as caught:
        samples(wave("constant", "1e308 N"), wave("constant", "1e308 N"))
    assert caught.value.where == Location("scenario.xml", 6, 1)


@pytest.mark.parametrize(
    ("written", "message"),
    [
        (wave("sine", period="0 s"), 'period="0 s" of <sine> must be greater than zero'),
        (wave("sine", period="1 m"), "period=\"1 m\" of <sine>: '1 m': m does not fit"),
        (wave("random", cutoff="0 Hz"), "must be greater than zero"),
    ],
)
def test_what_no_wave_can_be_is_refused_at_its_place(written: WaveSource, message: str) -> None:
    with pytest.raises(InputError) as caught:
        samples(written)
    assert message in caught.value.message
    assert caught.value.where == WHERE


def test_each_kind_is_an_element_of_the_schema() -> None:
    assert set(WAVES) == set(children_of("input"))
