"""The sensor and the actuators of followers without their own."""

from __future__ import annotations

from collections.abc import Iterable

from cosim.errors import InputError
from cosim.master.robot import RobotSetup
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import Scenario
from cosim.signals.effects import check_values
from cosim.vehicle.kind import units_of


def check_common_effects(scenario: Scenario, followers: Iterable[RobotSetup]) -> None:
    """Check the common effects; they must fit some follower, even if every follower has its own.

    Raises
    ------
    InputError
        A value makes no sense, with the place in the scenario.
    """
    times = Times(scenario.step, scenario.ticks)
    refused: InputError | None = None
    for kind in {robot.kind.name: robot.kind for robot in followers}.values():
        try:
            check_values(scenario.sensor, units_of(kind.pose), times)
            check_values(scenario.actuator, units_of(kind.command), times)
            return
        except InputError as error:
            refused = error
    if refused is not None:
        raise refused
