"""A simulation step by step: poses to read and torques to give between ticks."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from cosim.errors import InputError, SimulationError
from cosim.master.simulation import Simulation
from cosim.scenario.reader import read_scenario
from cosim.scenario.scenario import Scenario


@pytest.fixture
def simulation(short_line: Scenario) -> Iterator[Simulation]:
    with Simulation(short_line) as simulation:
        yield simulation


def test_poses_are_those_of_the_tick_to_come(simulation: Simulation) -> None:
    assert list(simulation.poses) == ["leader", "follower_1", "follower_2", "follower_3", "follower_4"]
    poses, velocities = [], []
    while not simulation.finished:
        assert simulation.time == simulation.tick * 0.02
        poses.append(simulation.poses["follower_2"].copy())
        velocities.append(simulation.velocities["follower_2"].copy())
        simulation.step()
    result = simulation.result()
    assert np.array_equal(poses, result.pose.sel(robot="follower_2"))
    assert np.array_equal(velocities, result.velocity.sel(robot="follower_2"))
    assert np.ptp(poses, axis=0).min() > 0


def test_poses_cannot_be_written(simulation: Simulation) -> None:
    with pytest.raises(ValueError, match="read-only"):
        simulation.poses["follower_1"][0] = 1.0


def test_a_torque_of_ones_own_for_one_tick(simulation: Simulation) -> None:
    simulation.step()
    simulation.step({"follower_1": (12.0, -3.0), "leader": [1.0, 0.5]})
    simulation.step({"follower_1": (1e4, 0.0)})
    simulation.step()
    torque = simulation.result().torque.values
    assert torque[1, 0].tolist() == [12.0, -3.0]
    assert torque[2, 0].tolist() == [200.0, 0.0]  # through the actuators
    assert torque[3, 0].tolist() not in ([12.0, -3.0], [200.0, 0.0])
    leader = simulation.result().leader_torque.values
    assert leader[1].tolist() == [1.0, 0.5]
    assert leader[2].tolist() == leader[0].tolist()


def test_what_the_others_do_does_not_depend_on_it(short_line: Scenario) -> None:
    results = []
    for torque in (None, {"follower_1": (12.0, -3.0)}):
        with Simulation(short_line) as simulation:
            while not simulation.finished:
                simulation.step(torque)
            results.append(simulation.result())
    plain, driven = (result.pose.sel(robot=["follower_2", "follower_3", "follower_4"]) for result in results)
    assert plain.equals(driven)
    assert (results[1].torque.sel(robot="follower_1").values == [12.0, -3.0]).all()


def test_a_held_command_is_held_beyond_an_override(short_line: Scenario) -> None:
    def thrice(root):  # the controllers tick every third step
        root.find("simulation").set("period", "30 ms")

    with Simulation(short_line.edited(["//simulation/@step=10 ms", thrice])) as simulation:
        simulation.step()
        simulation.step({"follower_1": (12.0, -3.0)})
        simulation.step()
        torque = simulation.result().torque.values[:, 0]
    assert torque[1].tolist() == [12.0, -3.0]
    assert torque[2].tolist() == torque[0].tolist()


@pytest.mark.parametrize(
    ("torques", "sentence"),
    [
        ({"follower1": (0.0, 0.0)}, "the scenario has no robot 'follower1': did you mean 'follower_1'?"),
        ({"follower_1": (0.0,)}, "the torque of follower_1 is (0.0,); expected are two finite numbers [N.m]"),
        ({"follower_1": (0.0, float("nan"))}, "expected are two finite numbers"),
        ({"follower_1": ("much", 0.0)}, "expected are two finite numbers"),
    ],
)
def test_torques_that_cannot_be(simulation: Simulation, torques: dict[str, tuple[float, ...]], sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        simulation.step(torques)
    assert sentence in str(caught.value)
    assert simulation.tick == 0
    simulation.step()


def test_a_leader_on_a_trajectory_takes_no_torque(scenarios: Path) -> None:
    with Simulation(read_scenario(scenarios / "figure_eight.xml")) as simulation:
        assert np.isfinite(simulation.poses["leader"]).all()
        with pytest.raises(InputError, match="no torque drives it"):
            simulation.step({"leader": (1.0, 0.0)})


def test_there_is_no_step_after_the_end(simulation: Simulation) -> None:
    simulation.step()
    simulation.close()
    with pytest.raises(InputError, match="the run cannot go on: it is closed"):
        simulation.step()
    assert simulation.result().sizes["time"] == 1


def test_there_is_no_step_after_a_failure(simulation: Simulation) -> None:
    simulation.step()
    simulation._now.state[2, 0] = np.nan  # a controller refuses to see this
    with pytest.raises(SimulationError) as caught:
        simulation.step()
    with pytest.raises(InputError) as refused:
        simulation.step()
    assert str(refused.value) == f"the run cannot go on: {caught.value}"
