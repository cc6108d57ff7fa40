"""A simulation step by step: poses to read and torques to give between ticks."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.errors import Failure, InputError, RunInterrupted, SimulationError
from cosim.master.loop import Part
from cosim.master.mock_fleet import MockFleet, Motion
from cosim.master.observer import Observer, Watched
from cosim.master.simulation import Simulation
from cosim.master.ticks import Ticks
from cosim.scenario.reader import read_scenario
from cosim.scenario.scenario import Scenario
from cosim.tests.driving import FailsAt
from cosim.tests.without_fmus import mock_scenario, mock_setup


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


def test_a_torque_of_the_leader_reaches_no_other_run(short_line: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also not one that goes on, in another thread, while this torque acts."""
    with Simulation(short_line) as driven, Simulation(short_line) as other:
        do = Ticks._do

        def meanwhile(ticks: Ticks, parts: Part, tick: int) -> None:
            do(ticks, parts, tick)
            if ticks is driven._ticks and parts == Part.ACT:
                other.step()

        monkeypatch.setattr(Ticks, "_do", meanwhile)
        driven.step({"leader": (50.0, 1.0)})
        assert driven.result().leader_torque.values.tolist() == [[50.0, 1.0]]
        assert other.result().leader_torque.values.tolist() == [[8.0, 0.0]]


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
        ({"follower_1": (0.0,)}, "the torque of follower_1 is (0.0,); expected two finite numbers [N.m]"),
        ({"follower_1": (0.0, float("nan"))}, "expected two finite numbers"),
        ({"follower_1": ("much", 0.0)}, "expected two finite numbers"),
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


# A fleet that is a function: no FMU ------------------------------------------------------------------------------


def apart(time: float, given: np.ndarray) -> np.ndarray:
    """A leader that drives along x, and a follower two metres behind it."""
    state = np.zeros((2, 6))
    state[:, 0] = time * 0.5 + np.array([0.0, -2.0])
    state[:, 4] = 0.5
    return state


def mock(folder: Path, motion: Motion = apart, observers: Sequence[Observer] = ()) -> Simulation:
    scenario = mock_scenario(folder)
    return Simulation(scenario, mock_setup(scenario), observers=observers, fleet=partial(MockFleet, motion))


def test_a_fleet_made_from_a_function(tmp_path: Path) -> None:
    given = []

    def motion(time: float, inputs: np.ndarray) -> np.ndarray:
        given.append((time, inputs.copy()))
        return apart(time, inputs)

    with mock(tmp_path, motion) as simulation:
        result = simulation.run()
    assert np.array_equal(result.leader_pose.values[:, 0], 0.5 * result.time.values)
    assert result.attrs["status"] == "completed"
    assert [time for time, _ in given] == result.time.values.tolist()
    assert all(
        np.array_equal(inputs[2:], torque)
        for (_, inputs), torque in zip(given[1:], result.torque[:-1, 0].values, strict=True)
    )


class Watching:
    """An observer that records its calls."""

    def __init__(self) -> None:
        self.told: list[object] = []
        self.seen: list[np.ndarray] = []

    def started(self, run: Watched) -> None:
        self.run = run
        self.told.append(("started", run.tick))

    def ticked(self, tick: int) -> None:
        self.told.append(tick)
        self.seen.append(self.run.state.copy())

    def ended(self, failure: Failure | None) -> None:
        self.told.append(failure)


def test_an_observer_sees_what_is_recorded(tmp_path: Path) -> None:
    observer = Watching()
    with mock(tmp_path, observers=[observer]) as simulation:
        result = simulation.run()
    assert observer.told == [("started", 0), *range(51), None], "it is told once that the run has ended"
    assert np.array_equal(np.array(observer.seen)[:, 1, :4], result.pose[:, 0].values)
    assert observer.run.robots == ("leader", "follower_1")


@pytest.mark.parametrize("name", ["state", "measured", "torque"])
def test_an_observer_cannot_change_the_run(tmp_path: Path, name: str) -> None:
    observer = Watching()
    with mock(tmp_path, observers=[observer]), pytest.raises(ValueError, match="read-only"):
        getattr(observer.run, name)[0, 0] = 1.0


def test_progress_ends_with_its_run_and_others_go_on(tmp_path: Path) -> None:
    observer, ticks = Watching(), []

    def tell(tick: int) -> None:
        ticks.append(tick)
        if tick == 3:
            raise KeyboardInterrupt

    with mock(tmp_path, observers=[observer]) as simulation:
        with pytest.raises(RunInterrupted):
            simulation.run(tell)
        assert observer.told[-1] == 3
    assert ticks == [0, 1, 2, 3]
    assert observer.told[-1] is None


def test_an_observer_that_fails_ends_the_run_with_its_records(tmp_path: Path) -> None:
    observer = Watching()
    with (
        mock(tmp_path, observers=[observer, FailsAt(5, IndexError("off by one"))]) as simulation,
        pytest.raises(SimulationError) as caught,
    ):
        simulation.run()
    assert str(caught.value) == "the master at t = 0.1 s: IndexError: off by one"
    assert observer.told[-1] == caught.value.failure
    assert caught.value.result.sizes["time"] == 6


def test_the_fleet_is_closed(tmp_path: Path) -> None:
    fleets = []

    def start(*arguments: Any) -> MockFleet:
        fleets.append(MockFleet(apart, *arguments))
        return fleets[0]

    scenario = mock_scenario(tmp_path)
    with Simulation(scenario, mock_setup(scenario), fleet=start):
        assert not fleets[0].closed
    assert fleets[0].closed


def test_there_is_no_step_after_a_failure(tmp_path: Path) -> None:
    """A controller refuses to see a pose that is not a number."""

    def lost(time: float, given: np.ndarray) -> np.ndarray:
        state = apart(time, given)
        state[1, 0] += np.nan if time > 0.01 else 0.0
        return state

    with mock(tmp_path, lost) as simulation:
        simulation.step()
        with pytest.raises(SimulationError) as caught:
            simulation.step()
        with pytest.raises(InputError) as refused:
            simulation.step()
    assert str(refused.value) == f"the run cannot go on: {caught.value}"
