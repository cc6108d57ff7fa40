"""Values of the inputs of a robot's FMU from the scenario: signals, and values from events on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.clock import tick_at
from cosim.errors import InputError, nearest
from cosim.fmu.binding import BoundRole, BoundVariable, start_of
from cosim.fmu.discrete_values import DISCRETE, Discrete, check_whole, discrete_value
from cosim.fmu.model_description import Variable
from cosim.fmu.package import Fmu
from cosim.fmu.parameters import ParameterValue
from cosim.fmu.units import unit_of_values
from cosim.master.discrete_inputs import input_course
from cosim.plant.spec import FLOAT_TYPES
from cosim.quantity import quantity
from cosim.scenario.scenario import InputSource, Scenario, Setting
from cosim.signals.waves import input_samples, understood
from cosim.vehicle.kind import Role
from plants import UnitError, units

INPUT_TYPES = (*FLOAT_TYPES, *DISCRETE)
"""Types of inputs for which a scenario can have values."""


@dataclass
class RobotInputs:
    """The values of a robot's inputs.

    Attributes
    ----------
    torque : dict
        Signals added to a torque, (ticks + 1,) [N.m], by its place among the torques.
    samples : dict
        Other real inputs by name: the role that stands for it and its values (ticks + 1,) in the role's unit.
    discrete : dict
        Values of inputs that are no real numbers, by tick; tick 0 has the values at the start.
    """

    torque: dict[int, NDArray[np.float64]] = field(default_factory=dict)
    samples: dict[str, tuple[BoundRole, NDArray[np.float64]]] = field(default_factory=dict)
    discrete: dict[int, tuple[ParameterValue, ...]] = field(default_factory=dict)

    @cached_property
    def _names(self) -> frozenset[str]:
        discrete = (value.variable.name for given in self.discrete.values() for value in given)
        return frozenset((*self.samples, *discrete))

    def check_free(self, values: Iterable[ParameterValue]) -> None:
        """Refuse an input that has a value and signals.

        Raises
        ------
        InputError
            There is such an input.
        """
        for value in values:
            if value.is_input and value.variable.name in self._names:
                raise InputError(
                    f"the input {value.variable.name!r} is given a value as <parameter> and as <input>: remove one",
                    value.where,
                )


def robot_inputs(
    scenario: Scenario, fmu: Fmu, robot: str, sources: Sequence[InputSource], times: NDArray[np.float64]
) -> RobotInputs:
    """Return the values of a robot's inputs.

    Parameters
    ----------
    scenario, fmu, robot
        The scenario, and one of its robots.
    sources
        Its signals in the scenario.
    times
        The communication points (ticks + 1,) [s].

    Raises
    ------
    InputError
        The FMU has no such input, or a value makes no sense for it, with the place in the scenario.
    """
    found = RobotInputs()
    torques = [role.name for role in fmu.binding.kind.command]
    later: dict[str, list[tuple[int, Setting]]] = {}
    for event in scenario.events_by_robot.get(robot, ()):
        for setting in event.inputs:
            later.setdefault(setting.name, []).append((tick_at(event.time, scenario.step), setting))
    for source in _joined([*sources, *(InputSource(name, (), given[0][1].where) for name, given in later.items())]):
        events = later.get(source.name, [])
        player = _player(fmu, source)
        if isinstance(player, Variable) and player.type in DISCRETE:
            for tick, value in _course(fmu, source, events, player, times).items():
                found.discrete[tick] = (*found.discrete.get(tick, ()), ParameterValue(player, value, source.where))
            continue
        bound, unit = _as_role(fmu, source, player, events)
        if source.name in torques and events:
            raise InputError(
                f"an event cannot set {source.name!r}, which a controller or the <torque> of the leader commands; "
                "<step> and <pulse> of an <input> add to it",
                events[0][1].where,
            )
        samples = input_samples(source, unit, times, scenario.step, scenario.seed, robot)
        if not source.waves:
            samples[:] = _at_rest(fmu, bound)
        hold(samples, [(tick, _number(setting, unit)) for tick, setting in events])
        if source.name in torques:
            found.torque[torques.index(source.name)] = samples
        else:
            found.samples[source.name] = (bound, samples)
    return found


def hold(samples: NDArray[np.float64], values: Sequence[tuple[int, ArrayLike]]) -> None:
    """Let each of some values, in the order of their ticks, hold until the tick of the next one."""
    until = len(samples)
    for tick, value in reversed(values):
        samples[tick:until] = value
        until = tick


def _joined(sources: Iterable[InputSource]) -> Iterator[InputSource]:
    """Return one source for each name, with the signals of all: each of them then has random numbers of its own."""
    joined: dict[str, list[InputSource]] = {}
    for source in sources:
        joined.setdefault(source.name, []).append(source)
    for name, same in joined.items():
        yield InputSource(name, tuple(wave for source in same for wave in source.waves), same[0].where)


def _player(fmu: Fmu, source: InputSource) -> BoundRole | Variable:
    """Return the role of an FMU that a source names, or else the input of this name."""
    kind = fmu.binding.kind
    roles = [fmu.binding.bound.get(role.name) for role in (*kind.command, *kind.disturbance)]
    for bound in roles:
        if bound is not None and bound.role.name == source.name:
            return bound
    variable = fmu.inputs.get(source.name)
    if variable is None or variable.type not in INPUT_TYPES:
        known = [name for name, v in fmu.inputs.items() if v.type in INPUT_TYPES]
        raise InputError(
            f"the FMU {fmu.path.name} has no input {source.name!r}: {nearest(source.name, known)}", source.where
        )
    for bound in roles:
        if bound is not None and bound.played_by is not None and bound.played_by.variable is variable:
            raise InputError(
                f"the input {source.name!r} of {fmu.path.name} plays the role {bound.role.name!r}: write that name",
                source.where,
            )
    if variable.dimensions:
        raise InputError(
            f"the input {source.name!r} of {fmu.path.name} cannot be used: it is an array: a binding gives one of its "
            "elements a role",
            source.where,
        )
    return variable


# Real inputs ------------------------------------------------------------------------------------------------


def _as_role(
    fmu: Fmu, source: InputSource, player: BoundRole | Variable, events: Sequence[tuple[int, Setting]]
) -> tuple[BoundRole, units.Unit]:
    """Return the role that stands for an input, perhaps its own role, and the unit of its samples."""
    if isinstance(player, BoundRole):
        return player, units.parse(player.role.unit)
    values = [value for wave in source.waves if (value := understood(wave).value)]
    try:
        unit = unit_of_values(fmu.description, player, [*values, *(setting.value for _, setting in events)])
        start_of(player)  # its causality and variability must allow the exchange
    except (ValueError, UnitError) as error:
        raise InputError(
            f"the input {source.name!r} of {fmu.path.name} cannot be used: {error}", source.where
        ) from None
    return BoundRole(Role(source.name, "input", str(unit)), BoundVariable(player, 0, 1.0, 0.0)), unit


def _at_rest(fmu: Fmu, bound: BoundRole) -> float:
    """Return the FMU's own start value of an input, in the unit of the role that stands for it."""
    assert bound.played_by is not None
    number = start_of(bound.played_by.variable)[bound.played_by.element]
    return bound.played_by.scale * number + bound.played_by.offset


def _number(setting: Setting, unit: units.Unit) -> float:
    try:
        return quantity(setting.value, unit)
    except ValueError as error:
        raise _refused(setting, error) from None


def _refused(setting: Setting, error: ValueError) -> InputError:
    return InputError(f'value="{setting.value}" of the input {setting.name!r}: {error}', setting.where)


# Others -----------------------------------------------------------------------------------------------------


def _course(
    fmu: Fmu,
    source: InputSource,
    events: Sequence[tuple[int, Setting]],
    variable: Variable,
    times: NDArray[np.float64],
) -> dict[int, Discrete]:
    """Return the values of an input that is no real number, by the ticks at which it changes."""
    course = input_course(source, variable, times) if source.waves else {}
    if events:
        course = {tick: value for tick, value in course.items() if tick < events[0][0]}
    for tick, setting in events:
        try:
            value = discrete_value(variable, setting.value)
            check_whole(variable, value, setting.value)
        except ValueError as error:
            raise _refused(setting, error) from None
        course[tick] = value
    return course
