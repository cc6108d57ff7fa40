"""Set-ups of scenarios whose plants are functions of time and inputs: nothing is built, unpacked or loaded."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import formation_controllers as fc
import numpy as np

from cosim.control.law import find_law
from cosim.fmu.binding import Binding
from cosim.master.result_variables import recorded_signals, result_variables_of
from cosim.master.robot import RobotSetup
from cosim.master.setup import Setup
from cosim.scenario.reader import read_scenario
from cosim.scenario.scenario import LEADER, Scenario
from cosim.signals.desired_places import desired_places
from cosim.storage import Storage
from cosim.tests.driving import scenario as written
from cosim.vehicle.car_like import CAR_LIKE
from cosim.vehicle.columns import run_columns

PLANT = '<plant id="car" model="car_like"/>'


def mock_scenario(folder: Path, **options: Any) -> Scenario:
    """Return a scenario of a leader and a follower with cars."""
    return read_scenario(written(folder / "mock.xml", PLANT, **options))


def mock_setup(scenario: Scenario) -> Setup:
    """Return the set-up of a scenario with cars, to be run with a MockFleet."""
    laws = {name: find_law(source) for name, source in scenario.controllers.items()}
    leader = _robot(scenario, LEADER, scenario.leader)
    followers = tuple(_robot(scenario, follower.id, follower) for follower in scenario.followers)
    storage = Storage()
    columns = run_columns([robot.kind for robot in (leader, *followers)])
    controlled = [(one.id, laws[one.controller]) for one in scenario.followers]
    variables = result_variables_of(columns, controlled, False, laws.values())
    return Setup(
        leader=leader,
        followers=followers,
        motion=None,
        desired=fc.Desired(*desired_places(scenario.followers, scenario.clock, storage)),
        opened={},
        fmus={},
        laws=laws,
        gains=tuple(laws[follower.controller].gains for follower in scenario.followers),
        result_variables=variables,
        signals=recorded_signals(variables, columns, controlled),
        others={},
        storage=storage,
    )


def _robot(scenario: Scenario, name: str, about: Any) -> RobotSetup:
    return RobotSetup(
        name=name,
        where=about.where,
        fmu=cast(Any, SimpleNamespace(binding=Binding(CAR_LIKE, {}))),
        source=scenario.plants[about.plant],
        parameters=(),
        vehicle=fc.CarLike(wheelbase=1.2),
        outline=None,
        pose=(0.0,) * 4,
        sensor=(),
        actuator=(),
        torque=np.zeros((scenario.ticks + 1, 2)),
        inputs=(),
        samples=np.zeros((scenario.ticks + 1, 0)),
        held=(),
        changes={},
    )
