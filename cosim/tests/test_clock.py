"""The communication points, and times that fall on none."""

from pathlib import Path

import numpy as np
import pytest

from cosim.clock import NEVER, Clock, acting, in_seconds, tick_at, whole
from cosim.errors import InputError
from cosim.results.expectations import KINDS, Recording
from cosim.scenario.reader import read_scenario
from cosim.tests.driving import scenario

CAR = '<plant id="car" model="car_like"/>'


def test_times_are_products() -> None:
    clock = Clock(0.1, 3)
    assert clock.times.tolist() == [0.0, 0.1, 0.2, 0.1 * 3]
    assert clock.horizon == clock.times[-1]


@pytest.mark.parametrize("tick", [0, 1, 3, 7, 12345, 9_999_999])
def test_rounding_never_moves_a_time_off_its_tick(tick: int) -> None:
    clock = Clock(0.1, 10_000_000)
    for time in (tick * 0.1, float(f"{tick / 10:.1f}"), np.nextafter(tick * 0.1, 2.0 * tick)):
        assert clock.off_tick(time) == ""
        assert tick_at(time, 0.1) == tick


@pytest.mark.parametrize(("minutes", "tick"), [(0.6666666667, 2000), (0.01666666667, 50), (1666.6666666667, 5_000_000)])
def test_a_rounded_time_acts_at_the_tick_that_it_is_taken_for(minutes: float, tick: int) -> None:
    clock, time = Clock(0.02, 10_000_000), 60 * minutes
    assert time > tick * 0.02
    assert clock.off_tick(time) == ""
    assert tick_at(time, 0.02) == tick
    assert abs(clock.meant(time) - tick * 0.02) <= 1e-9
    assert clock.meant(1.011) == 1.011


def test_a_time_between_two_ticks_is_told_both() -> None:
    problem = "falls between two ticks, which are 0.02 s apart: write 1 s or 1.02 s"
    assert Clock(0.02, 100).off_tick(1.011) == problem
    assert tick_at(1.011, 0.02) == 51
    assert tick_at(float("inf"), 0.02) == NEVER


@pytest.mark.parametrize(
    ("time", "text"),
    [(0.0, "0.00 s"), (95 * 0.02, "1.90 s"), (40.5, "40.50 s"), (4 * 0.001, "0.004 s"), (0.1 / 3, "0.033333333 s")],
)
def test_times_in_sentences_have_the_decimals_that_they_need(time: float, text: str) -> None:
    assert in_seconds(time) == text


def test_whole_numbers() -> None:
    assert whole(3.0000000001) == 3
    assert whole(3.00001) is None
    assert whole(1e-12) == 0


def test_a_window_holds_its_start_and_not_its_end() -> None:
    times = Clock(0.1, 10).times
    assert np.flatnonzero(acting(times, 0.3, 0.6)).tolist() == [3, 4, 5]
    assert Clock(0.1, 10).samples_within(0.3, 0.6) == 4
    assert Clock(0.1, 10).samples_within(0.9, 5.0) == 2


@pytest.mark.parametrize(
    ("more", "named"),
    [
        ('<event at="0.511 s" robots="follower_1"><stop/></event>', 'at="0.511 s" of <event>'),
        ('<expect><rms signal="range" below="9 m" from="0.511 s"/></expect>', 'from="0.511 s" of <rms>'),
        ('<expect><rms signal="range" below="9 m" to="511 ms"/></expect>', 'to="511 ms" of <rms>'),
        ('<expect><settled by="0.511 s" range="1 m" bearing="1 deg"/></expect>', 'by="0.511 s" of <settled>'),
        ('<input name="tau_drive"><step value="1 N.m" at="0.511 s"/></input>', 'at="0.511 s" of <step>'),
        ('<input name="tau_drive"><pulse value="1 N.m" from="0 s" to="0.511 s"/></input>', 'to="0.511 s" of <pulse>'),
        (
            '<input name="tau_drive"><sine value="1 N.m" period="1 s" from="0.511 s"/></input>',
            'from="0.511 s" of <sine>',
        ),
        ('<sensor><bias x="1 m" from="0.511 s"/></sensor>', 'from="0.511 s" of <bias>'),
        ('<sensor><dropout probability="1" to="0.511 s"/></sensor>', 'to="0.511 s" of <dropout>'),
    ],
)
def test_a_jump_between_two_ticks_is_refused(tmp_path: Path, more: str, named: str) -> None:
    path = written(tmp_path, more)
    with pytest.raises(InputError) as caught:
        checked(path)
    where = caught.value.where
    assert where is not None
    assert path.read_text(encoding="utf-8").splitlines()[where.line - 1].strip().startswith("<")
    assert where.file == str(path)
    assert f"{named} falls between two ticks, which are 0.02 s apart: write 0.5 s or 0.52 s" in caught.value.message


@pytest.mark.parametrize("of", ["peak", "final"])
def test_the_end_of_a_run_is_within_it_however_it_is_rounded(tmp_path: Path, of: str) -> None:
    """3 times 0.7 s is less than 2.1 s to a computer."""
    expectation = f'<{of} signal="range" below="9 m" to="2.1 s"/>'
    more = f'<event at="2.1 s" robots="follower_1"><stop/></event><expect>{expectation}</expect>'
    read = read_scenario(scenario(tmp_path / "odd.xml", CAR, horizon="2.1 s", step="0.7 s", more=more))
    assert read.horizon < 2.1 == read.expectations[0].stop
    KINDS[of](read.expectations[0]).check_within(read.horizon)


@pytest.mark.parametrize(
    "more",
    [
        '<input name="tau_drive"><ramp value="1 N.m" from="0.011 s" to="0.511 s"/></input>',
        '<expect><rms signal="range" below="9 m" from="500 ms" to="0.98 s"/></expect>',
        '<event at="0.52 s" robots="follower_1"><stop/></event>',
        '<sensor><bias x="1 m" from="0 s" to="100 s"/></sensor>',
    ],
)
def test_a_change_that_takes_its_time_may_begin_between_ticks(tmp_path: Path, more: str) -> None:
    checked(written(tmp_path, more))


def written(folder: Path, more: str) -> Path:
    inside = more.startswith(("<input", "<sensor"))
    path = scenario(folder / "s.xml", CAR, more="" if inside else more)
    if inside:
        text = path.read_text(encoding="utf-8")
        path.write_text(text.replace("</follower>", f"{more}\n  </follower>", 1), encoding="utf-8")
    return path


def checked(path: Path) -> None:
    """Read a scenario and its expectations; nothing is set up."""
    read = read_scenario(path)
    for expectation in read.expectations:
        kind = KINDS[expectation.kind](expectation)
        if expectation.kind == "settled":
            kind.check(Recording(read, {}), lambda _: Recording(read, {}))
