"""A gate holds a run after a tick, lets single ticks through, and changes no number."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from cosim.master.gate import Gate
from cosim.master.pacing import Pacer
from cosim.master.simulation import Simulation
from cosim.results.result import Result
from cosim.scenario.scenario import Scenario


@contextmanager
def run_beside(simulation: Simulation, pacer: Pacer | None = None) -> Iterator[list[Result]]:
    """Run a simulation in a thread, whose result is in the list once the block has ended."""
    results: list[Result] = []
    thread = threading.Thread(target=lambda: results.append(simulation.run_to_end(pacer=pacer)))
    thread.start()
    yield results
    thread.join(60.0)


def wait_for(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def test_a_closed_gate_lets_single_ticks_through(short_line: Scenario) -> None:
    gate = Gate()
    gate.close()
    with Simulation(short_line, observers=[gate]) as simulation:
        with run_beside(simulation) as results:
            for tick in range(4):
                wait_for(lambda tick=tick: gate.tick == tick)
                time.sleep(0.05)
                assert gate.tick == tick
                gate.step()
            wait_for(lambda: gate.tick == 4)
            gate.open()
        [held] = results
        assert gate.held > 0.2
    with Simulation(short_line) as simulation:
        plain = simulation.run_to_end()
    for name, signal in plain.data_vars.items():
        assert np.array_equal(held[name].values, signal.values, equal_nan=True), name


def test_a_run_at_full_speed_is_held_and_goes_on(short_line: Scenario) -> None:
    gate = Gate()
    with Simulation(short_line.edited(horizon=200.0), observers=[gate]) as simulation:
        with run_beside(simulation) as results:
            wait_for(lambda: gate.tick > 0)
            gate.close()
            time.sleep(0.5)  # at least a segment
            tick = gate.tick
            time.sleep(0.1)
            assert gate.tick == tick < simulation.scenario.ticks
            gate.step()
            wait_for(lambda: gate.tick == tick + 1)
            gate.open()
        assert results[0].attrs["status"] == "completed"


def test_the_last_tick_is_not_held(short_line: Scenario) -> None:
    gate = Gate()
    with Simulation(short_line, observers=[gate]) as simulation:
        while simulation.tick < simulation.scenario.ticks:
            simulation.step()
        gate.close()
        simulation.step()
        assert simulation.finished


def test_a_hold_is_no_delay_for_a_pace(short_line: Scenario) -> None:
    gate, pacer = Gate(), Pacer(short_line.step, 4.0)
    gate.close()
    with Simulation(short_line, observers=[gate]) as simulation, run_beside(simulation, pacer):
        wait_for(lambda: gate.tick == 0)
        time.sleep(1.0)
        gate.open()
    assert gate.held >= 1.0
    assert pacer.report.worst < 0.9  # of ticks that would all be late by a second


@pytest.mark.parametrize("closed", [True, False])
def test_every_tick_is_wanted_while_it_is_closed(closed: bool) -> None:
    gate = Gate()
    if closed:
        gate.close()
    assert gate.every_tick is closed
