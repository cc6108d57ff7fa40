"""The compiled loop: the same numbers in segments of any length as tick by tick, and the same failures."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from formation_controllers.compiled import compiled
from formation_controllers.compiled_law import TeamRecords
from formation_controllers.interface import Floats, TickInputs
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePid, tick

import cosim
from cosim.errors import SimulationError
from cosim.master.simulation import Simulation
from cosim.master.ticks import Ticks
from cosim.scenario.scenario import Scenario

SHORT: dict[str, Any] = {"horizon": 12.0, "expectations": False}
SCENARIOS = (
    "clmr_circle",
    "convoy",
    "differential_drive",
    "formation_change",
    "half_power",
    "heavy_payload",
    "mixed_team",
    "one_sample_delay",
    "sensor_dropout",
    "side_wind",
    "tractor_trailer_circle",
)


def tick_by_tick(scenario: Scenario) -> dict[str, Floats]:
    with Simulation(scenario) as simulation:
        while not simulation.finished:
            simulation.step()
        return arrays(simulation)


def arrays(simulation: Simulation) -> dict[str, Floats]:
    result = simulation.result()
    return {str(name): result[name].values for name in result.data_vars}


@pytest.mark.parametrize("name", SCENARIOS)
def test_segments_of_any_length_give_the_same_numbers(scenarios: Path, name: str) -> None:
    scenario = cosim.read_scenario(scenarios / f"{name}.xml").edited(**SHORT)
    expected = tick_by_tick(scenario)
    random = np.random.default_rng(len(name))
    ran = 0
    with Simulation(scenario) as simulation:
        ticks = simulation._ticks
        while not simulation.finished:
            if random.random() < 0.2 or not ticks.some(int(random.integers(1, 300))):
                simulation.step()
            else:
                ran += 1
        found = arrays(simulation)
    assert ran > (0 if name != "mixed_team" else -1), "a leader of another kind is seen through Python"
    assert found.keys() == expected.keys()
    for variable, values in expected.items():
        assert np.array_equal(found[variable], values, equal_nan=True), variable


@pytest.fixture
def line(scenarios: Path) -> Scenario:
    return cosim.read_scenario(scenarios / "clmr_line.xml").edited(horizon=1.0, expectations=False)


def with_tick(function: Any) -> type:
    return type("Law", (NeuralAdaptivePid,), {"tick": staticmethod(function)})


@compiled
def refuses(inputs: TickInputs, team: TeamRecords, torque: Floats) -> None:
    if team.state[0]["q_hat"][0] < 8.3:
        raise ValueError("too near")
    tick(inputs, team, torque)


@compiled
def overflows(inputs: TickInputs, team: TeamRecords, torque: Floats) -> None:
    tick(inputs, team, torque)
    if team.state[0]["q_hat"][0] < 8.3:
        torque[2, 1] = np.inf


@pytest.fixture(params=["compiled", "tick by tick"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Run with and without the compiled loop; it has been used, or not, at the end."""
    ran = []
    original = Ticks.some

    def some(self: Ticks, most: int) -> bool:
        before = self.tick
        try:
            possible = request.param == "compiled" and original(self, most)
        finally:
            ran.append(self.tick > before)
        return possible

    monkeypatch.setattr(Ticks, "some", some)
    yield request.param
    assert any(ran) == (request.param == "compiled")


@pytest.mark.parametrize(
    ("function", "robot", "sentence"),
    [
        (refuses, "follower_1 and follower_2 and follower_3 and follower_4", "failed: ValueError: too near"),
        (overflows, "follower_3", "failed: the torque is not finite, at range_estimate = "),
    ],
)
def test_a_law_that_fails_is_told_alike(
    line: Scenario, monkeypatch: pytest.MonkeyPatch, way: str, function: Any, robot: str, sentence: str
) -> None:
    monkeypatch.setattr("formation_controllers.registry.Installed.load", lambda found: with_tick(function))
    with Simulation(line) as simulation, pytest.raises(SimulationError, match=r"too near|not finite") as caught:
        simulation.run()
    assert caught.value.robot == robot
    assert sentence in str(caught.value)
    assert caught.value.time > 0.2
    assert simulation.result().sizes["time"] == round(caught.value.time / line.step)
