"""A run is a value: its inputs and outputs can be pickled and come back equal."""

import copy
import copyreg
import importlib
import inspect
import pickle
import pkgutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import formation_controllers
import numpy as np
import pytest

import cosim
import plants
from cosim.errors import Failure, InputError, Location, RunInterrupted, SimulationError
from cosim.fmu.units import UnitContradiction
from cosim.master.robot_inputs import hold
from cosim.master.setup import set_up
from cosim.results.result import Result, Variable
from cosim.results.summary import summarise
from cosim.scenario.edits import (
    set_binding,
    set_controller,
    set_environment,
    set_fmu,
    set_horizon,
    set_seed,
    set_value,
    without_expectations,
)
from cosim.vehicle.kind import Kind
from cosim.vehicle.kinds import kinds
from plants import units

EXAMPLE = Path(__file__).with_name("example.xml")
HERE = Location("scenario.xml", 3, 5)
RESULT = Result({"pose": Variable(("time",), np.array([1.0, np.nan]))}, {}, {"status": "incomplete"})


def again(value: Any) -> Any:
    return pickle.loads(pickle.dumps(value))


# Errors -----------------------------------------------------------------------------------------------------


def exceptions() -> Iterator[type[BaseException]]:
    """Return the public exception classes of the three packages."""
    found = set()
    for package in (cosim, plants, formation_controllers):
        for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            if "tests" not in module.name.split(".") and not module.name.endswith("__main__"):
                members = inspect.getmembers(importlib.import_module(module.name), inspect.isclass)
                found |= {c for _, c in members if issubclass(c, BaseException) and not c.__name__.startswith("_")}
    return (c for c in found if c.__module__.partition(".")[0] in ("cosim", "plants", "formation_controllers"))


MADE: dict[type[BaseException], Callable[[], BaseException]] = {
    InputError: lambda: InputError("there is no such thing", HERE),
    SimulationError: lambda: failed(RESULT),
    RunInterrupted: lambda: RunInterrupted(0.1, RESULT),
    UnitContradiction: lambda: UnitContradiction("v", "kn", units.Unit(), units.Unit(factor=2.0)),
    formation_controllers.ControllerError: lambda: formation_controllers.ControllerError("a gain is wrong", robot=2),
}
"""How those are made that have more than a sentence."""


def failed(result: Result | None) -> SimulationError:
    error = SimulationError("follower_1", 0.34, "it has diverged", "v")
    error.recorded = result
    return error


def made(kind: type[BaseException]) -> BaseException:
    """Return an exception with a text, and with a field where its constructor takes more than that."""
    try:
        return kind("a sentence on what is wrong")
    except TypeError:
        error = kind.__new__(kind, "a sentence on what is wrong")
        vars(error)["where"] = HERE
        return error


@pytest.mark.parametrize("kind", sorted(exceptions(), key=lambda kind: kind.__qualname__))
@pytest.mark.parametrize("sent", [again, copy.copy, copy.deepcopy])
def test_an_error_comes_back_as_itself(
    kind: type[BaseException], sent: Callable[[Any], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Dask makes all exceptions picklable that are there when it is imported.
    monkeypatch.delitem(copyreg.dispatch_table, kind, raising=False)
    error = MADE[kind]() if kind in MADE else made(kind)
    error.add_note("and where it was")
    back = sent(error)
    assert type(back) is type(error)
    assert str(back) == str(error)
    assert back.args == error.args
    assert vars(back).keys() == vars(error).keys()
    for name, value in vars(error).items():
        if isinstance(value, Result):
            assert value.dataset.identical(back.result)
        else:
            assert value == vars(back)[name]


def test_the_walk_finds_them() -> None:
    names = {kind.__name__ for kind in exceptions()}
    assert {
        "FormationError",
        "OutputError",
        "PlantError",
        "NoCompiler",
        "GainError",
        *(k.__name__ for k in MADE),
    } <= names


def test_an_error_is_raised_in_another_process_as_it_was() -> None:
    """`multiprocessing` and others pickle an error and raise the copy."""
    with pytest.raises(SimulationError, match=r"follower_1 at t = 0.34 s: it has diverged") as raised:
        raise again(failed(None))
    assert raised.value.failure == Failure("follower_1", 0.34, "v", "it has diverged")
    assert raised.value.exit_status == 3
    assert raised.value.result is None


# Edits and scenarios ----------------------------------------------------------------------------------------


EDITS = {
    "value": lambda: set_value("simulation/@seed=3"),
    "seed": lambda: set_seed(3),
    "fmu": lambda: set_fmu("clmr", Path("own.fmu")),
    "binding": lambda: set_binding("clmr", Path("own.xml")),
    "horizon": lambda: set_horizon(0.2),
    "expectations": without_expectations,
    "environment": lambda: set_environment("pid", Path("envs/new"), {"neural-adaptive-pid": ("laws", "0.2.0")}),
    "controller": lambda: set_controller("pid", "lqg", "formation-controllers", "0.1.0"),
}


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_comes_back_as_itself(name: str) -> None:
    edit = EDITS[name]()
    assert again(edit) == edit == EDITS[name]()
    assert hash(again(edit)) == hash(edit)
    assert edit not in [other() for key, other in EDITS.items() if key != name]
    assert str(again(edit).words) == edit.words


def test_an_edit_that_was_pickled_does_the_same() -> None:
    edits = [edit() for name, edit in EDITS.items() if name != "binding"]  # which is in a file that is not there
    assert cosim.read_scenario(EXAMPLE, again(edits)) == cosim.read_scenario(EXAMPLE, edits)


def test_scenarios_come_back_as_themselves(scenarios: Path) -> None:
    paths = sorted(scenarios.glob("*.xml"))
    assert paths
    for path in paths:
        scenario = cosim.read_scenario(path)
        assert again(scenario) == scenario, path.name
        assert again(scenario).edited(horizon=0.2, expectations=False) == scenario.edited(
            horizon=0.2, expectations=False
        )


def test_a_scenario_that_was_pickled_is_set_up_alike() -> None:
    """The setup of a scenario can be pickled, too: it is plain data, and the folders that its FMUs are unpacked in."""
    with ExitStack() as cleanup:
        setup = set_up(cosim.read_scenario(EXAMPLE), cleanup, {})
        for other in (again(setup), set_up(again(cosim.read_scenario(EXAMPLE)), cleanup, {})):
            for one, two in zip((setup.leader, *setup.followers), (other.leader, *other.followers), strict=True):
                for part in ("name", "vehicle", "pose", "kind", "source", "actuator"):
                    assert getattr(one, part) == getattr(two, part)
            assert other.gains == setup.gains
            assert other.result_variables == setup.result_variables
            np.testing.assert_array_equal(other.desired.q, setup.desired.q)


@pytest.mark.parametrize("kind", list(kinds()), ids=lambda kind: kind.name)
def test_a_kind_of_vehicle_is_the_same_one_everywhere(kind: Kind) -> None:
    for sent in (again, copy.copy, copy.deepcopy):
        assert sent(kind) is kind


# Results ----------------------------------------------------------------------------------------------------


def test_a_run_that_was_pickled_gives_the_same_result() -> None:
    scenario = cosim.read_scenario(EXAMPLE).edited(horizon=0.2)
    result = cosim.run(again(scenario))
    assert again(result).identical(result)
    assert result.identical(cosim.run(scenario))
    for summary in (summarise(scenario, result), cosim.summary_of(result)):
        assert again(summary) == summary
        assert again(summary).to_json() == summary.to_json()


def test_events_that_hold_until_the_next_one() -> None:
    values = [(1, 1.0), (3, 2.0), (3, 3.0), (7, 4.0), (9, 5.0)]
    one_by_one = np.zeros(8)
    for tick, value in values:
        one_by_one[tick:] = value
    held = np.zeros(8)
    hold(held, values)
    assert held.tolist() == one_by_one.tolist()
    hold(held, [])
    assert held.tolist() == one_by_one.tolist()
