"""Plants that go on from a saved state move as if they had not been left, to the bit."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import plants
from cosim.errors import SimulationError
from cosim.plant.fleet import Fleet
from cosim.plant.saved import FleetState, PlantState
from tests.stub.stub import make_fmu

from .driving import STEP, fleet

TICKS, LEFT = 60, 23
MODEL = {"interface": "model_exchange"}
CVODE = {**MODEL, "solver": "cvode"}
STUBS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "slave 2": ({}, {}),
    "slave 3": ({"fmi": "3.0"}, {}),
    "late": ({"late": "step"}, {"late_outputs": True}),
    "model 2": ({"interface": "model_exchange", "end_stop": 0.05, "time_event": True}, MODEL),
    "model 3": ({"fmi": "3.0", "interface": "model_exchange", "end_stop": 0.05, "step_event": True}, MODEL),
    "cvode 2": ({"interface": "model_exchange", "end_stop": 0.05, "time_event": True}, CVODE),
    "cvode 3": ({"fmi": "3.0", "interface": "model_exchange", "end_stop": 0.05}, CVODE),
    "typed": ({"fmi": "3.0", "types": "single"}, {}),
    "typed model": ({"fmi": "3.0", "types": "single", "interface": "model_exchange"}, MODEL),
}


def torques() -> np.ndarray:
    """Return torques that change now and then, as those of a controller with a period do."""
    random = np.random.default_rng(5)
    return np.repeat(random.normal(0.0, 4.0, (TICKS // 3, 2)), 3, axis=0)


def left_and_taken_up(start: Callable[[], Any], given: np.ndarray) -> tuple[np.ndarray, np.ndarray, FleetState]:
    """Return the states of a drive in one piece, and of one that is left and taken up; and what was saved."""
    whole, parts = np.full((TICKS, 1, 6), np.nan), np.full((TICKS, 1, 6), np.nan)
    with start() as (started, _):
        run(started, 0, given, whole)
    with start() as (started, _):
        run(started, 0, given[:LEFT], parts[:LEFT])
        saved = started.saved(LEFT * STEP)
        run(started, LEFT, given[LEFT:], parts[LEFT:])  # to be saved has changed nothing
    assert np.array_equal(whole, parts)
    parts[LEFT:] = np.nan
    saved = FleetState(
        tuple(PlantState.from_json(one.to_json()) for one in saved.plants), saved.messages, saved.logged, saved.kept
    )
    with start() as (started, state):
        started.restore(saved, LEFT, STEP)
        assert np.array_equal(state, parts[LEFT - 1])
        run(started, LEFT, given[LEFT:], parts[LEFT:])
    return whole, parts, saved


def run(started: Fleet, first: int, given: np.ndarray, out: np.ndarray) -> None:
    started.run(first, STEP, given, out)


@pytest.mark.parametrize("isolated", [False, True], ids=["here", "isolated"])
@pytest.mark.parametrize("kind", STUBS)
def test_a_stub_goes_on_as_if_it_had_not_been_left(tmp_path: Path, kind: str, isolated: bool) -> None:
    made, about = STUBS[kind]
    about = dict(about)
    solver = about.pop("solver", "")
    fmu = make_fmu(tmp_path, **{"save": True} | made)
    options = {**about, "isolated": isolated, **({"solvers": (solver,)} if solver else {})}
    whole, parts, _ = left_and_taken_up(lambda: fleet(fmu, **options), torques())
    assert np.array_equal(whole, parts)
    assert np.ptp(whole[LEFT:], axis=0).max() > 0.0


@pytest.mark.parametrize("solver", ["", "runge_kutta_4", "cvode"])
@pytest.mark.parametrize("fmi", ["2", "3"])
@pytest.mark.parametrize("model", ["car_like"])
def test_a_built_in_plant_goes_on_as_if_it_had_not_been_left(model: str, fmi: str, solver: str) -> None:
    fmu = plants.build(model, fmi=fmi)
    options: dict[str, Any] = {"interface": "model_exchange", "solvers": (solver,)} if solver else {}
    whole, parts, _ = left_and_taken_up(lambda: fleet(fmu, **options), 10.0 * torques())
    assert np.array_equal(whole, parts)


def test_an_fmu_that_does_not_save_its_state_is_named(tmp_path: Path) -> None:
    fmu = make_fmu(tmp_path, name="no_states")
    with fleet(fmu) as (started, _), pytest.raises(SimulationError) as caught:
        started.saved(0.0)
    assert "robot_1 at t = 0 s: the plant no_states.fmu cannot save its state: " in str(caught.value)
    assert "fmi2GetFMUstate is not supported" in str(caught.value)


def test_an_fmu_that_comes_back_elsewhere_is_named(tmp_path: Path) -> None:
    fmu = make_fmu(tmp_path, save=True)
    with fleet(fmu) as (started, _):
        started.run(0, STEP, torques()[:5], np.empty((5, 1, 6)))
        saved = started.saved(5 * STEP)
    plant = saved.plants[0]
    moved = PlantState(plant.fmu, plant.inputs, (1.0, *plant.outputs[1:]), plant.given, plant.next_event, plant.changed)
    with fleet(fmu) as (started, _), pytest.raises(SimulationError) as caught:
        started.restore(FleetState((moved,), (), (), (0,)), 5, STEP)
    assert "the plant stub.fmu comes back with other outputs than it had when it saved its state" in str(caught.value)


def test_a_state_that_the_fmu_refuses_is_named(tmp_path: Path) -> None:
    fmu = make_fmu(tmp_path, save=True)
    for isolated in (False, True):
        with fleet(fmu, isolated=isolated) as (started, _):
            plant = started.saved(0.0).plants[0]
            cut = PlantState(plant.fmu[:10], plant.inputs, plant.outputs)
            with pytest.raises(SimulationError) as caught:
                started.restore(FleetState((cut,), (), (), (0,)), 5, STEP)
        assert "does not take up the state that it has saved: fmi2DeSerializeFMUstate failed" in str(caught.value)
