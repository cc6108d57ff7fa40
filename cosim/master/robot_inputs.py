"""Values of the inputs of a robot's FMU from the scenario: signals, and values from events on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.clock import tick_at
from cosim.errors import InputError, nearest
from cosim.fmu.binding import BoundRole, BoundVariable, start_of
from cosim.fmu.discrete_values import DISCRETE, Discrete, check_whole, discrete_value
from cosim.fmu.model_description import Variable
from cosim.fmu.parameters import ParameterValue, check_not_initial
from cosim.fmu.units import unit_of_values
from cosim.fmu.vehicle import Fmu
from cosim.master.discrete_inputs import MAX_CHANGES, input_course
from cosim.plant.spec import FLOAT_TYPES
from cosim.quantity import quantity
from cosim.scenario.scenario import InputSource, Scenario, Setting
from cosim.signals.waves import add_samples, understood
from cosim.storage import Storage, constant, fill
from cosim.vehicle.kind import Role
from plants import UnitError, units

INPUT_TYPES = (*FLOAT_TYPES, *DISCRETE)
"""Types of inputs for which a scenario can have values."""


@dataclass(frozen=True)
class RobotInputs:
    """The values of a robot's inputs.

    Attributes
    ----------
    torque : ndarray
        Torques besides the controller's (ticks + 1, torques).
    names, inputs : tuple
        Names of the other real inputs, and the roles that stand for them.
    samples : ndarray
        Their values (ticks + 1, inputs) in the roles' units.
    discrete : dict
        Values of inputs that are no real numbers, by tick; tick 0 has the values at the start.
    """

    torque: NDArray[np.float64]
    names: tuple[str, ...]
    inputs: tuple[BoundRole, ...]
    samples: NDArray[np.float64]
    discrete: Mapping[int, tuple[ParameterValue, ...]]

    @cached_property
    def _given(self) -> dict[tuple[str, int], str]:
        """The names of the inputs that have signals, by what the inputs are."""
        real = [bound.played_by.variable for bound in self.inputs if bound.played_by is not None]
        discrete = (value.variable for given in self.discrete.values() for value in given)
        return {variable.identity: variable.name for variable in (*real, *discrete)}

    def check_free(self, values: Iterable[ParameterValue]) -> None:
        """Refuse an input that has a value and signals.

        Raises
        ------
        InputError
            There is such an input.
        """
        for value in values:
            name = self._given.get(value.variable.identity)
            if value.is_input and name is not None:
                other = "" if name == value.variable.name else f" {name!r}"
                raise InputError(
                    f"the input {value.variable.name!r} is given a value as <parameter> and as <input>{other}: "
                    "remove one",
                    value.where,
                )


@dataclass(frozen=True)
class _Real:
    """A real input: what stands for it, its signals, its unit, and the ticks from which on it has another value."""

    bound: BoundRole
    source: InputSource
    unit: units.Unit
    events: Sequence[tuple[int, float]]


def robot_inputs(
    scenario: Scenario,
    fmu: Fmu,
    robot: str,
    sources: Sequence[InputSource],
    storage: Storage,
    torques: Mapping[int, tuple[float, ...]],
    stop: int,
) -> RobotInputs:
    """Return the values of a robot's inputs.

    Parameters
    ----------
    scenario, fmu, robot
        The scenario, and one of its robots.
    sources
        Its signals in the scenario.
    storage
        Where values over time lie.
    torques
        Torques besides the controller's and the signals, by the tick from which on they act, in order.
    stop
        The tick from which on no torque acts.

    Raises
    ------
    InputError
        The FMU has no such input, or a value makes no sense for it, with the place in the scenario.
    """
    discrete: dict[int, tuple[ParameterValue, ...]] = {}
    real: dict[str, _Real] = {}
    on_torques: dict[int, _Real] = {}
    commands = [role.name for role in fmu.binding.kind.command]
    later: dict[str, list[tuple[int, Setting]]] = {}
    first: dict[tuple[str, int], InputSource] = {}
    for event in scenario.events_by_robot.get(robot, ()):
        for setting in event.inputs:
            later.setdefault(setting.name, []).append((tick_at(event.time, scenario.step), setting))
    for source in _joined([*sources, *(InputSource(name, (), given[0][1].where) for name, given in later.items())]):
        events = later.get(source.name, [])
        player = _player(fmu, source)
        if isinstance(player, Variable) and (before := first.setdefault(player.identity, source)) is not source:
            raise InputError(
                f"the input {source.name!r} of {fmu.path.name} is {before.name!r} by another name, and "
                f"{before.name!r} has a value {before.where.seen_from(source.where)}: remove one",
                source.where,
            )
        if isinstance(player, Variable) and player.type in DISCRETE:
            for tick, value in _course(fmu, source, events, player, scenario).items():
                discrete[tick] = (*discrete.get(tick, ()), ParameterValue(player, value, source.where))
            continue
        bound, unit = _as_role(fmu, source, player, events)
        if source.name in commands and events:
            raise InputError(
                f"an event cannot set {source.name!r}, which a controller or the <torque> of the leader commands; "
                "<step> and <pulse> of an <input> add to it",
                events[0][1].where,
            )
        own = _Real(bound, source, unit, [(tick, _number(setting, unit)) for tick, setting in events])
        if source.name in commands:
            on_torques[commands.index(source.name)] = own
        else:
            real[source.name] = own
    return RobotInputs(
        _torque(scenario, robot, storage, torques, on_torques, stop),
        tuple(real),
        tuple(own.bound for own in real.values()),
        _samples(scenario, robot, storage, list(real.values())),
        discrete,
    )


def _torque(
    scenario: Scenario,
    robot: str,
    storage: Storage,
    torques: Mapping[int, tuple[float, ...]],
    signals: Mapping[int, _Real],
    stop: int,
) -> NDArray[np.float64]:
    samples = scenario.ticks + 1
    if not signals and len(torques) == 1 and stop >= samples:
        return constant(np.array(torques[0]), samples)
    found = storage.empty((samples, len(torques[0])))
    hold(found, list(torques.items()))
    for column, own in signals.items():
        add_samples(found[:, column], own.source, own.unit, scenario.clock, scenario.seed, robot)
    fill(found[stop:], 0.0)
    return found


def _samples(scenario: Scenario, robot: str, storage: Storage, inputs: Sequence[_Real]) -> NDArray[np.float64]:
    if not inputs:
        return constant(np.zeros(0), scenario.ticks + 1)
    found = storage.empty((scenario.ticks + 1, len(inputs)))
    for column, own in enumerate(inputs):
        course = found[:, column]
        fill(course, 0.0 if own.source.waves else at_rest(own.bound))
        add_samples(course, own.source, own.unit, scenario.clock, scenario.seed, robot)
        hold(course, own.events)
    return found


def hold(samples: NDArray[np.float64], values: Sequence[tuple[int, ArrayLike]]) -> None:
    """Let each of some values, in the order of their ticks, hold until the tick of the next one."""
    until = len(samples)
    for tick, value in reversed(values):
        fill(samples[tick:until], value)
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
    driving = (*kind.command, *kind.disturbance)
    for bound in fmu.binding.of(driving):
        if bound is not None and bound.role.name == source.name:
            return bound
    variable = fmu.inputs.get(source.name)
    if variable is None or variable.type not in INPUT_TYPES:
        known = [name for name, v in fmu.inputs.items() if v.type in INPUT_TYPES]
        raise InputError(
            f"the FMU {fmu.path.name} has no input {source.name!r}: {nearest(source.name, known)}", source.where
        )
    if (role := fmu.binding.role_of(variable, driving)) is not None:
        raise InputError(
            f"the input {source.name!r} of {fmu.path.name} plays the role {role.name!r}: write that name", source.where
        )
    if (role := fmu.binding.role_of(variable, kind.geometry.values())) is not None:
        raise InputError(
            f"the input {source.name!r} of {fmu.path.name} plays the role {role.name!r} of the geometry, which has one "
            f'value for the whole run: write <parameter name="{role.name}" value="..."/>',
            source.where,
        )
    check_not_initial(fmu, variable, source.where)
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


def at_rest(bound: BoundRole) -> float:
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
    scenario: Scenario,
) -> dict[int, Discrete]:
    """Return the values of an input that is no real number, by the ticks at which it changes."""
    most = MAX_CHANGES // (1 + len(scenario.followers))
    course = input_course(source, variable, scenario.clock, most) if source.waves else {}
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
