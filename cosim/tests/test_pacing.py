"""Pacing against a clock of the tests' own, and a run that really takes its time."""

import time

import pytest

from cosim.master.pacing import Pacer
from cosim.master.simulation import Simulation
from cosim.scenario.scenario import Scenario


class Clock:
    """A clock that sleeping advances, always by a bit too much."""

    def __init__(self, late: float = 0.0) -> None:
        self.now = 100.0
        self.late = late

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.now += seconds + self.late


def test_ticks_begin_when_they_are_due() -> None:
    clock = Clock(late=0.001)
    pacer = Pacer(0.02, 2.0, clock, clock.sleep)
    began = []
    for tick in range(5):
        pacer.wait(tick)
        began.append(clock.now - 100.0)
        clock.now += 0.004
    assert began == pytest.approx([0.0, 0.011, 0.021, 0.031, 0.041])  # lateness does not add up
    report = pacer.report
    assert (report.ticks, report.overruns, report.worst) == (5, 0, 0.0)
    assert report.jitter == pytest.approx(0.001)
    assert str(report) == ("paced at 2 times real time: 0 of 5 ticks overran; the others began at most 1 ms late")


def test_an_overrun_is_counted_and_made_up_for() -> None:
    clock = Clock()
    pacer = Pacer(0.02, 1.0, clock, clock.sleep)
    for tick in range(6):
        pacer.wait(tick)
        clock.now += 0.05 if tick == 1 else 0.001
    report = pacer.report
    assert (report.ticks, report.overruns) == (6, 2)  # ticks 2 and 3 were due at 0.04 s and 0.06 s
    assert report.worst == pytest.approx(0.03)
    assert report.worst_time == pytest.approx(0.04)
    assert clock.now == pytest.approx(100.101)
    assert "2 of 6 ticks overran, the worst by 30 ms at t = 0.04 s" in str(report)


def test_waiting_can_be_given_up() -> None:
    clock = Clock()
    pacer = Pacer(0.02, 1e-300, clock, clock.sleep)
    pacer.wait(0)
    pacer.wait(1, lambda: clock.now > 101.1)
    assert clock.now == pytest.approx(101.2)


@pytest.mark.parametrize("factor", [0.0, -1.0, float("inf"), float("nan")])
def test_a_pace_is_positive(factor: float) -> None:
    with pytest.raises(ValueError, match="must be a positive number"):
        Pacer(0.02, factor)


def test_a_run_takes_its_time_and_gives_the_same_numbers(short_line: Scenario) -> None:
    results = []
    for pacer in (None, Pacer(0.02, 5.0)):
        with Simulation(short_line) as simulation:
            simulation.step()  # which may compile
            started = time.perf_counter()
            results.append(simulation.run(pacer=pacer))
            seconds = time.perf_counter() - started
    assert seconds >= 49 * 0.02 / 5.0  # waits are never shorter than asked for
    assert pacer is not None
    assert pacer.report.ticks == 50
    assert results[0].equals(results[1])
