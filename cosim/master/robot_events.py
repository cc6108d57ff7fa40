"""Events of the robots during a run: actuators that stop, parameters and inputs that change."""

from __future__ import annotations

from collections.abc import Iterable

from cosim.clock import tick_at
from cosim.errors import InputError
from cosim.fmu.parameters import ParameterValue
from cosim.fmu.vehicle import Fmu
from cosim.master.robot_inputs import RobotInputs
from cosim.master.used_fmus import understood
from cosim.scenario.scenario import PlantSource, Scenario
from cosim.signals.effects import Effect


def stops(scenario: Scenario, robot: str) -> Iterable[Effect]:
    """Return the ends of a robot's actuators, as losses of all effectiveness."""
    return (
        Effect("effectiveness", 0.0, (), event.time, float("inf"), event.where)
        for event in scenario.events_by_robot.get(robot, ())
        if event.stops
    )


def changes_of(
    scenario: Scenario,
    fmu: Fmu,
    source: PlantSource,
    robot: str,
    inputs: RobotInputs,
) -> dict[int, tuple[ParameterValue, ...]]:
    """Return the values that a robot's FMU gets during the run, by tick: inputs, then parameters.

    Raises
    ------
    InputError
        An event sets a variable that the FMU does not have, or one that cannot change during a run.
    """
    changes = {tick: list(values) for tick, values in inputs.discrete.items() if tick > 0}
    for event in scenario.events_by_robot.get(robot, ()):
        values = understood(fmu, source, event.parameters)
        check_changeable(fmu, values)
        inputs.check_free(values)
        changes.setdefault(tick_at(event.time, scenario.step), []).extend(values)
    return {tick: tuple(values) for tick, values in changes.items() if values}


def check_changeable(fmu: Fmu, values: Iterable[ParameterValue]) -> None:
    """Refuse to change parameters of an FMU during a run that are fixed for it, and those of the geometry.

    Controllers, results and verdicts have one geometry for the whole run.

    Raises
    ------
    InputError
        With the place in the scenario.
    """
    for value in values:
        if value.variable.variability != "tunable" and not value.is_input:
            raise InputError(
                f"the parameter {value.variable.name!r} of {fmu.path.name} is {value.variable.variability}: only a "
                "tunable parameter can change during a run",
                value.where,
            )
        role = fmu.binding.role_of(value.variable, fmu.binding.kind.geometry.values())
        if role is not None:
            raise InputError(
                f"the {value.variable.causality} {value.variable.name!r} of {fmu.path.name} plays the role "
                f"{role.name!r} of the geometry, which cannot change during a run: controllers, results and verdicts "
                "have one geometry for the whole run. Give it this value from the start of a run",
                value.where,
            )
